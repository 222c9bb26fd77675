"""Committed files name no place on one machine and no registry."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from project_copy import GIT, ROOT

# the brackets keep this file from matching itself
PLACES = re.compile(
    rb"(?<![\w.])/(hom[e]|roo[t]|User[s]|wor[k]|tm[p]|op[t]|mn[t])/\w|[A-Z]:\\\\?User[s]"
)
REGISTRIES = re.compile(
    rb"pyp[i]\.org|pythonhoste[d]\.|anacond[a]\.org|artifactor[y]|index-ur[l]\s*=|extra-index-ur[l]"
)


def committed(project: Path) -> list[Path]:
    """The files of ``project`` that git has, as they lie there; what else lies there is its
    user's own.
    """
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=project, capture_output=True, text=True, check=False
    )
    if listed.returncode:
        pytest.skip("not a git repository")
    files = [project / name for name in listed.stdout.split("\0") if name]
    return [file for file in files if file.is_file()]


def matches(pattern: re.Pattern[bytes], project: Path) -> dict[str, list]:
    """Matches of ``pattern`` in the committed files, by file; only files where it finds
    something.
    """
    hits = {
        str(file.relative_to(project)): pattern.findall(file.read_bytes())
        for file in committed(project)
    }
    return {file: places for file, places in hits.items() if places}


def test_no_file_names_a_place_on_one_machine():
    assert matches(PLACES, ROOT) == {}


def test_no_file_names_a_package_registry():
    assert matches(REGISTRIES, ROOT) == {}


def test_a_users_own_log_is_not_looked_at_until_it_is_committed(tmp_path):
    subprocess.run([*GIT, "init", "-q"], cwd=tmp_path, check=True)
    (tmp_path / "run.log").write_text("wrote " + "/".join(["", "home", "me", "data"]))
    assert matches(PLACES, tmp_path) == {}
    subprocess.run([*GIT, "add", "run.log"], cwd=tmp_path, check=True)
    assert list(matches(PLACES, tmp_path)) == ["run.log"]
