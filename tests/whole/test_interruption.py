"""A run that is killed at any moment leaves a state from which ``dvc repro`` alone completes, to
the bytes of a run left alone.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from project_copy import SMOKE, copy_project, outputs, run, set_parameters

pytestmark = pytest.mark.slow

# raw files, tables and trials in workers lie before the end of the last of them
STAGES = ("choose", "configure", "record", "files", "ingest@motion", "ingest@depth", "track")
LAST = "articulate"
# what appears as a stage is in the midst of its work, or has ended and DVC takes what it wrote into
# its cache
MOMENTS = (
    "data/raw/youbot/.recordings.partial/kinect",
    "data/ingest/.motion.partial/markers.parquet",
    "data/track/joints.parquet",
    "data/.articulate.partial",
)
PATIENCE = 120  # s


def kill_when(moment: Path, cwd: Path) -> None:
    """Start ``dvc repro`` and kill it and all that it started, without notice, as soon as
    ``moment`` exists.
    """
    environment = os.environ | {
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    }
    with open(cwd / "killed.log", "ab") as log:
        running = subprocess.Popen(
            ["dvc", "repro", LAST],
            cwd=cwd,
            env=environment,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    try:
        end = time.monotonic() + PATIENCE
        while not moment.exists():
            assert running.poll() is None and time.monotonic() < end, (
                cwd / "killed.log"
            ).read_text()
            time.sleep(0.001)
    finally:
        if running.poll() is None:
            os.killpg(running.pid, signal.SIGKILL)
    # a run that had ended could not be killed
    assert running.wait() == -signal.SIGKILL


def in_order(folder: Path) -> dict[str, dict]:
    """What ``dvc.lock`` holds of the stages up to the last, in its order."""
    stages = OmegaConf.to_container(OmegaConf.load(folder / "dvc.lock"))["stages"]
    return {name: stage for name, stage in stages.items() if name in (*STAGES, LAST)}


def test_a_run_killed_at_any_moment_completes_to_the_same_bytes(reproduced, tmp_path):
    folder = tmp_path / "killed"
    copy_project(folder)
    set_parameters(folder, **SMOKE)
    # nor does what an earlier run left half-written enter
    for left in ("data/.track.partial", "data/ingest/depth", "data/.files.partial"):
        (folder / left).mkdir(parents=True)
        (folder / left / "stray.parquet").write_text("half a table")
    for moment in MOMENTS:
        assert not (folder / moment).exists()
        kill_when(folder / moment, folder)
    assert (folder / "data/.articulate.partial").exists()
    done = run("dvc", "repro", LAST, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    expected = outputs(reproduced, *STAGES, LAST)
    assert len(expected) == 8 and outputs(folder, *STAGES, LAST) == expected
    assert not [
        file
        for file in folder.glob("data/**/*")
        if file.match(".*.partial") or file.match("stray.parquet")
    ]
    # and to the lock file of a run left alone, whatever the order in which they ran
    lock = (folder / "dvc.lock").read_text()
    head, *entries = re.split(r"^  (?=\S)", lock, flags=re.MULTILINE)
    (folder / "dvc.lock").write_text(head + "".join(f"  {entry}" for entry in entries[::-1]))
    for project in (folder, copy_of_lock(reproduced, tmp_path)):
        sorted_by_us = run("python", "-m", "pipeline", "lock", cwd=project)
        assert sorted_by_us.returncode == 0, sorted_by_us.stderr
    left_alone = in_order(tmp_path / "left alone")
    assert list(in_order(folder).items()) == list(left_alone.items()) and len(left_alone) == 7


def copy_of_lock(reproduced: Path, folder: Path) -> Path:
    """A project of the lock file that was reproduced without being killed, to sort."""
    other = folder / "left alone"
    other.mkdir()
    for name in ("params.yaml", "dvc.yaml", "dvc.lock", "pipeline"):
        (other / name).symlink_to(reproduced / name)
    return other
