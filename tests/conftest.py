"""Fixtures that several packages share, and the order and the durations of the tests."""

from __future__ import annotations

import faulthandler
import fcntl
import os
import shutil
from pathlib import Path

import pytest
from durations import pytest_addoption, pytest_terminal_summary  # noqa: F401 - hooks of pytest
from project_copy import GIT, SMOKE, copy_project, run, set_parameters

import pipeline.core.environment  # noqa: F401 - before numpy: it fixes the arithmetic

# a forked child that a damaged file crashes reports by its exit code, without a dump of its stack
os.register_at_fork(after_in_child=faulthandler.disable)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest tests run first, so that no worker is left with one at the end."""
    items.sort(
        key=lambda item: (
            "reproduced" not in getattr(item, "fixturenames", ()),
            item.get_closest_marker("slow") is None,
        )
    )


@pytest.fixture(scope="session")
def reproduced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone-like copy of the project, under git, in which ``dvc repro`` has run on the smoke
    scale; one for all workers.
    """
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
