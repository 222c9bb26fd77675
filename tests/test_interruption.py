"""A run that is killed at any moment leaves a state from which ``dvc repro`` alone completes, to the bytes of a run left alone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import run
from omegaconf import OmegaConf
from smoke import SMOKE, copy_project, set_parameters

pytestmark = pytest.mark.slow

LAST = "noise"  # stage: raw files, tables, trials in workers and numbers of a model lie before its end
# what appears as a stage is in the midst of its work, or has ended and DVC takes what it wrote into its cache
MOMENTS = (
    "data/raw/youbot/.recordings.partial/kinect",
    "data/.ingest.partial/markers.parquet",
    "data/track/joints.parquet",
    "data/.articulate.partial",
)
PATIENCE = 120  # s


def kill_when(moment: Path, cwd: Path) -> None:
    """Start ``dvc repro`` and kill it and all that it started, without notice, as soon as ``moment`` exists."""
    environment = os.environ | {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}
    with open(cwd / "killed.log", "ab") as log:
        running = subprocess.Popen(["dvc", "repro", LAST], cwd=cwd, env=environment, stdout=log, stderr=log, start_new_session=True)
    try:
        end = time.monotonic() + PATIENCE
        while not moment.exists():
            assert running.poll() is None and time.monotonic() < end, (cwd / "killed.log").read_text()
            time.sleep(0.001)
    finally:
        if running.poll() is None:
            os.killpg(running.pid, signal.SIGKILL)
    # a run that had ended could not be killed
    assert running.wait() == -signal.SIGKILL


def outputs(folder: Path) -> dict[str, str]:
    """Hash of every output of the stages up to the last, as DVC recorded it."""
    locked = {}
    for file in (folder / "dvc.lock", folder / "data/raw/youbot/dvc.lock"):
        stages = OmegaConf.to_container(OmegaConf.load(file))["stages"]
        names = ("configure", "record", "ingest", "track", "articulate", LAST)
        locked |= {out["path"]: out["md5"] for name in names if name in stages for out in stages[name]["outs"]}
    return locked


def test_a_run_killed_at_any_moment_completes_to_the_same_bytes(reproduced, tmp_path):
    folder = tmp_path / "killed"
    copy_project(folder)
    set_parameters(folder, **SMOKE)
    # nor does what an earlier run left half-written enter
    for left in ("data/.track.partial", f"data/{LAST}", f"data/.{LAST}.partial"):
        (folder / left).mkdir(parents=True)
        (folder / left / "stray.parquet").write_text("half a table")
    for moment in MOMENTS:
        assert not (folder / moment).exists()
        kill_when(folder / moment, folder)
    assert (folder / "data/.articulate.partial").exists()
    done = run("dvc", "repro", LAST, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    expected = outputs(reproduced)
    assert len(expected) == 7 and outputs(folder) == expected
    assert not [file for file in folder.glob("data/**/*") if file.match(".*.partial") or file.match("stray.parquet")]
