"""Fixtures that several rooms share."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import pipeline  # noqa: F401 - before numpy: it fixes the arithmetic

sys.path.insert(0, str(Path(__file__).parent))
from smoke import SMOKE, copy_project, set_parameters

GIT = ["git", "-c", "user.name=test", "-c", "user.email=test@example.org", "-c", "init.defaultBranch=main"]


def run(*command: str, cwd: Path) -> subprocess.CompletedProcess:
    """Run a command in ``cwd`` as a person without our environment variables would, output captured."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {"PATH": path, "HOME": str(cwd), "GIT_CONFIG_NOSYSTEM": "1"} | {
        f"GIT_{who}_{what}": "test@example.org" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")
    }
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes longest goes first: a worker that has nothing left takes over from the end of another's list."""
    items.sort(key=lambda item: ("reproduced" not in getattr(item, "fixturenames", ()), item.get_closest_marker("slow") is None))


@pytest.fixture(scope="session")
def reproduced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone-like copy of the project, under git, in which ``dvc repro`` has run on the smoke scale; one for all workers."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "reproduced"
    whole = folder.with_suffix(".whole")
    # the first worker that needs it makes it, others wait
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not whole.exists():
            reproduce(folder)
            whole.touch()
    return folder


def reproduce(folder: Path) -> None:
    """Copy the project, run it and commit what it wrote."""
    shutil.rmtree(folder, ignore_errors=True)
    copy_project(folder)
    (folder / ".dvc/config.local").unlink()
    set_parameters(folder, **SMOKE)
    for command in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "start"]):
        assert run(*GIT, *command, cwd=folder).returncode == 0
    done = run("dvc", "repro", cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    run(*GIT, "add", "-A", cwd=folder)
    run(*GIT, "commit", "-qm", "reproduced", cwd=folder)
