"""Fixtures that several rooms share."""

from __future__ import annotations

import os
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


# first, as xdist reads the groups in a hook of the same name
@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes longest goes first, so that all workers end at about the same time; one of them has the reproduced project."""
    for item in items:
        if "reproduced" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.xdist_group("reproduced"))
    items.sort(key=lambda item: ("reproduced" not in getattr(item, "fixturenames", ()), item.get_closest_marker("slow") is None))


@pytest.fixture(scope="session")
def reproduced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone-like copy of the project, under git, in which ``dvc repro`` has run on the smoke scale."""
    folder = tmp_path_factory.mktemp("reproduced")
    copy_project(folder)
    (folder / ".dvc/config.local").unlink()
    set_parameters(folder, **SMOKE)
    for command in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "start"]):
        assert run(*GIT, *command, cwd=folder).returncode == 0
    done = run("dvc", "repro", cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    run(*GIT, "add", "-A", cwd=folder)
    run(*GIT, "commit", "-qm", "reproduced", cwd=folder)
    return folder
