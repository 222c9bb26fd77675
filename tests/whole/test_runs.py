"""Runs that are killed or queued: the results equal an undisturbed run's, or are as
pipeline/core/compute/README.md documents.
"""

import os
import re
import signal
import subprocess
import sys
from contextlib import suppress
from io import StringIO
from pathlib import Path
from time import monotonic, sleep

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
KILLED = ("choose", "configure", "record", "files", "ingest@motion", "ingest@depth", "track")
LAST = "articulate"
# these appear while a stage writes, or when it has ended and DVC moves its outputs to the cache
MOMENTS = (
    "data/raw/youbot/.recordings.*.partial/kinect",
    "data/track/joints.parquet",
    "data/.articulate.*.partial",
)
PATIENCE = 120  # s; a worker without work ends by itself sooner
LONGEST = 400  # s that the experiment may take
# the option that was set, and a result that depends on it
SET, FITTED = "overrides.models.wishart.decomposition", "sigma_b"


def kill_when(moment: str, cwd: Path) -> None:
    """Start ``dvc repro`` and kill its process group, without notice, as soon as ``moment``
    exists.
    """
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    command, environment = ["dvc", "repro", LAST], os.environ | {"PATH": path}
    running = subprocess.Popen(command, cwd=cwd, env=environment, start_new_session=True, **streams)
    try:
        end = monotonic() + PATIENCE
        while not any(cwd.glob(moment)):
            assert running.poll() is None and monotonic() < end, moment
            sleep(0.001)
    finally:
        if running.poll() is None:
            os.killpg(running.pid, signal.SIGKILL)
    # a run that had ended could not be killed
    assert running.wait() == -signal.SIGKILL


def test_a_run_killed_at_any_moment_completes_to_the_same_bytes(reproduced, tmp_path):
    folder = tmp_path / "killed"
    copy_project(folder)
    set_parameters(folder, **SMOKE)
    # half-written files of an earlier run are not used either
    ended = "999999999.partial"  # no process has this number
    for left in (f"data/.track.{ended}", "data/ingest/depth", f"data/.files.{ended}"):
        (folder / left).mkdir(parents=True)
        (folder / left / "stray.parquet").write_text("half a table")
    for moment in MOMENTS:
        assert not any(folder.glob(moment))
        kill_when(moment, folder)
    assert any(folder.glob(MOMENTS[-1]))
    succeeds("dvc", "repro", LAST, cwd=folder)
    expected = outputs(reproduced, *KILLED, LAST)
    assert len(expected) == 8 and outputs(folder, *KILLED, LAST) == expected
    files = [*folder.glob("data/**/*")]
    assert not [file for file in files if file.match(".*.partial") or file.match("stray.parquet")]


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


def test_a_sweep_is_queued_run_shown_and_applied_and_the_workspace_stays_until_then(queueing):
    copy = queueing
    commands = shell_commands("pipeline/core/compute/README.md", "--queue")
    queue_decompositions, queue_seeds, status, run_all, show, apply = commands
    succeeds(*queue_decompositions, cwd=copy)
    # a range ends before its second number
    seeds = re.findall(r"'seed=(\d+)'", succeeds(*queue_seeds, cwd=copy))
    assert seeds == ["1", "2", "3"]
    queued = re.findall(
        r"^\w{7}\s+(\S+)\s.*Queued", succeeds(*status, cwd=copy), flags=re.MULTILINE
    )
    assert len(queued) == 5
    # one is enough, and experiments with other seeds would run every stage
    assert "Removed" in succeeds("dvc", "queue", "remove", queued[0], *queued[2:], cwd=copy)
    # DVC's worker at times reads a half-written message and waits forever; its results are read
    # all the same
    with suppress(subprocess.TimeoutExpired):
        succeeds(*run_all, cwd=copy, seconds=LONGEST)
    assert succeeds("git", "status", "--porcelain", cwd=copy) == ""

    shown = pd.read_csv(StringIO(succeeds(*show, cwd=copy)))
    assert shown.rev.tolist()[:2] == ["workspace", "main"]
    assert shown[2:].set_index("Experiment")[SET].to_dict() == {queued[1]: "qr_transposed"}
    # another law, which has another σ_B at the recorded level
    assert shown[FITTED].nunique() == 2

    succeeds(*apply[:-1], queued[1], cwd=copy)
    wishart = OmegaConf.load(copy / "data/config.yaml").models.wishart
    assert wishart.decomposition == "qr_transposed"
    status = succeeds("git", "status", "--porcelain", cwd=copy).splitlines()
    changed = {line[3:] for line in status if not line[3:].startswith("reports/")}
    assert changed == {"params.yaml", "data/config.yaml", "dvc.lock"}
