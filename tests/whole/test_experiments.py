"""Queues and sweeps as pipeline/core/compute/README.md documents them: what is queued, what comes
out, and that the workspace stays as it is.
"""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Iterator
from contextlib import suppress
from io import StringIO
from pathlib import Path
from subprocess import TimeoutExpired
from time import monotonic, sleep

import pandas as pd
import pytest
from omegaconf import OmegaConf
from project_copy import GIT, ROOT, run

pytestmark = pytest.mark.slow

PAGE = ROOT / "pipeline/core/compute/README.md"
PATIENCE = 120  # s; a worker that has nothing to do ends by itself sooner
LONGEST = 400  # s that the two experiments may take
SET, FITTED = (
    "overrides.models.wishart.decomposition",
    "sigma_b",
)  # what was set, and what came of it


def documented() -> list[list[str]]:
    """The commands of its block on queues, in their order."""
    blocks = re.findall(r"```sh\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (block,) = (block for block in blocks if "--queue" in block)
    return [shlex.split(line, comments=True) for line in block.splitlines()]


def said(*command: str, cwd: Path, seconds: float | None = None) -> str:
    """What a command that succeeds says on standard output; TimeoutExpired after ``seconds``."""
    done = run(*command, cwd=cwd, seconds=seconds)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture
def copy(reproduced: Path, tmp_path: Path) -> Iterator[Path]:
    """The reproduced project, to queue experiments in; no worker of its queue is left behind."""
    folder = tmp_path / "copy"
    shutil.copytree(reproduced, folder, symlinks=True)
    said(*GIT, "add", "-A", cwd=folder)
    said(*GIT, "commit", "-qm", "copy", "--allow-empty", cwd=folder)
    yield folder
    run("dvc", "queue", "stop", cwd=folder)
    patient_until = monotonic() + PATIENCE
    while "0 active, 0 idle" not in said("dvc", "queue", "status", cwd=folder):
        assert monotonic() < patient_until
        sleep(1)


def test_a_sweep_is_queued_run_shown_and_applied_and_the_workspace_stays_until_then(copy):
    queue_decompositions, queue_seeds, status, run_all, show, apply = documented()
    said(*queue_decompositions, cwd=copy)
    # a range ends before its second number
    assert re.findall(r"'seed=(\d+)'", said(*queue_seeds, cwd=copy)) == ["1", "2", "3"]
    queued = re.findall(r"^\w{7}\s+(\S+)\s.*Queued", said(*status, cwd=copy), re.MULTILINE)
    assert len(queued) == 5
    # those of the seeds would run everything anew
    assert "Removed" in said("dvc", "queue", "remove", *queued[2:], cwd=copy)
    # DVC's worker at times reads a message that is half written and waits ever after; what it ran
    # is judged all the same
    with suppress(TimeoutExpired):
        said(*run_all, cwd=copy, seconds=LONGEST)
    assert said("git", "status", "--porcelain", cwd=copy) == ""

    shown = pd.read_csv(StringIO(said(*show, cwd=copy)))
    assert shown.rev.tolist()[:2] == ["workspace", "main"]
    experiments = shown[2:].set_index("Experiment")
    assert set(experiments.index) == set(queued[:2]) and set(experiments[SET]) == {
        "qr",
        "qr_transposed",
    }
    # each decomposition is another law and has another σ_B at the recorded level
    assert shown[FITTED].nunique() == 3

    (chosen,) = experiments.index[experiments[SET] == "qr_transposed"]
    said(*apply[:-1], chosen, cwd=copy)
    assert OmegaConf.load(copy / "data/config.yaml").models.wishart.decomposition == (
        "qr_transposed"
    )
    changed = {line[3:] for line in said("git", "status", "--porcelain", cwd=copy).splitlines()}
    assert changed == {
        "params.yaml",
        "data/config.yaml",
        "dvc.lock",
    } | {name for name in changed if name.startswith("reports/")}
