"""Runs that are killed or queued: the results equal an undisturbed run's, or are as
pipeline/core/compute/README.md documents.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from io import StringIO
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pandas as pd
import pytest
from omegaconf import OmegaConf
from project_copy import (
    GIT,
    SMOKE,
    copy_project,
    copy_reproduced,
    outputs,
    run,
    set_parameters,
    shell_commands,
    succeeds,
)

pytestmark = pytest.mark.slow

# raw files, tables and trials in workers are written before the end of the last stage
KILLED = "choose configure record files ingest@motion ingest@depth track".split()
WRITTEN = "data/ingest data/track data/raw/youbot/recordings .dvc/cache".split()
LAST = "articulate"
KILLS = 10
KILL_SEED = 2017
DELAY = (0.5, 4.0)  # s between start and kill
PATIENCE = 120  # s; a worker without work ends by itself sooner
LONGEST = 400  # s that the experiment may take
# the option that was set, and a result that depends on it
SET = "overrides.models.wishart.decomposition"
FITTED = "sigma_b"


def kill_after(seconds: float, whole: bool, cwd: Path) -> bool:
    """Start ``dvc repro`` and kill it without notice after ``seconds``, the ``whole`` process group
    or DVC alone; return False if it has ended before.
    """
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    with (cwd / "printed").open("wb") as printed:
        running = subprocess.Popen(
            ["dvc", "repro", LAST],
            cwd=cwd,
            env=os.environ | {"PATH": path},
            stdout=printed,
            stderr=printed,
            start_new_session=True,
        )
    try:
        assert running.wait(seconds) == 0, (cwd / "printed").read_text()
        return False
    except subprocess.TimeoutExpired:
        kill = os.killpg if whole else os.kill
        kill(running.pid, signal.SIGKILL)
    return running.wait() == -signal.SIGKILL


def test_a_run_killed_at_any_moment_completes_to_the_same_bytes(reproduced, tmp_path):
    folder = tmp_path / "killed"
    rng = np.random.default_rng(KILL_SEED)
    mend = ["make", "-o", ".venv/.ready", "mend"]
    copy_project(folder)
    set_parameters(folder, **SMOKE)
    # half-written files of an earlier run are not used either
    ended = "999999999.partial"  # no process has this number
    for left in (f"data/.track.{ended}", "data/ingest/depth", f"data/.files.{ended}"):
        (folder / left).mkdir(parents=True)
        (folder / left / "stray.parquet").write_text("half a table")
    kills = 0
    while kills < KILLS:
        if kill_after(rng.uniform(*DELAY), kills % 2 == 0, folder):
            kills += 1
            succeeds(*mend, cwd=folder)
        else:  # start from nothing
            for name in WRITTEN:
                shutil.rmtree(folder / name)
    succeeds("dvc", "repro", LAST, cwd=folder)
    expected = outputs(reproduced, *KILLED, LAST)

    assert len(expected) == 9 and outputs(folder, *KILLED, LAST) == expected
    assert not [
        *folder.glob("data/**/.*.partial"),
        *folder.glob("data/**/stray.parquet"),
    ]


@pytest.fixture
def queueing(reproduced: Path, tmp_path: Path):
    """A copy to queue experiments in; no worker of its queue is left behind."""
    folder = copy_reproduced(reproduced, tmp_path / "copy")
    succeeds(*GIT, "commit", "-aqm", "copy", "--allow-empty", cwd=folder)
    yield folder
    run("dvc", "queue", "stop", cwd=folder)
    patient_until = monotonic() + PATIENCE
    while "0 active, 0 idle" not in succeeds("dvc", "queue", "status", cwd=folder):
        assert monotonic() < patient_until
        sleep(1)


def test_a_sweep_is_queued_run_shown_and_applied_and_the_workspace_stays_until_then(
    queueing,
):
    copy = queueing
    commands = shell_commands("pipeline/core/compute/README.md", "--queue")
    queue_decompositions, queue_seeds, status, run_all, show, apply = commands
    succeeds(*queue_decompositions, cwd=copy)
    # a range ends before its second number
    seeds = re.findall(r"'seed=(\d+)'", succeeds(*queue_seeds, cwd=copy))
    assert seeds == ["1", "2", "3"]
    queued = re.findall(r"(?m)^\w{7}\s+(\S+)\s.*Queued", succeeds(*status, cwd=copy))
    assert len(queued) == 5
    # one is enough, and experiments with other seeds would run every stage
    others = queued[0], *queued[2:]
    assert "Removed" in succeeds("dvc", "queue", "remove", *others, cwd=copy)
    # DVC's worker at times reads a half-written message and waits forever; its results are read
    # all the same
    with suppress(subprocess.TimeoutExpired):
        succeeds(*run_all, cwd=copy, seconds=LONGEST)
    assert succeeds("git", "status", "--porcelain", cwd=copy) == ""

    shown = pd.read_csv(StringIO(succeeds(*show, cwd=copy)))
    assert shown.rev.tolist()[:2] == ["workspace", "main"]
    experiments = shown[2:].set_index("Experiment")[SET]
    assert experiments.to_dict() == {queued[1]: "qr_transposed"}
    # another law, which has another σ_B at the recorded level
    assert shown[FITTED].nunique() == 2

    succeeds(*apply[:-1], queued[1], cwd=copy)
    wishart = OmegaConf.load(copy / "data/config.yaml").models.wishart
    assert wishart.decomposition == "qr_transposed"
    status = succeeds("git", "status", "--porcelain", cwd=copy).splitlines()
    changed = {line[3:] for line in status}
    results = {name for name in changed if name.startswith("reports/")}
    assert changed - results == {"params.yaml", "data/config.yaml", "dvc.lock"}
