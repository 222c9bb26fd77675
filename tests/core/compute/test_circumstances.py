"""By what a process could give other bytes than another."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from pipeline.core.compute.circumstances import _arithmetic, _code, _folder, difference

ROOT = Path(__file__).parents[3]


def elsewhere(expression: str, **variables: str) -> str:
    """The expression in another process."""
    command = (
        "from pipeline.core.compute.circumstances import *; from "
        f"pipeline.core.compute.circumstances import _arithmetic; print({expression})"
    )
    environment = os.environ | {"PYTHONPATH": "."} | variables
    done = subprocess.run(
        [sys.executable, "-c", command],
        cwd=ROOT,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout.strip()


def test_equal_processes_have_equal_arithmetic():
    assert elsewhere("_arithmetic()") == _arithmetic()


def test_the_instruction_set_shows_in_the_arithmetic():
    assert elsewhere("_arithmetic()", OPENBLAS_CORETYPE="Prescott") != _arithmetic()


def test_the_variable_shows_by_its_name():
    value = elsewhere("circumstances()['OPENBLAS_CORETYPE']", OPENBLAS_CORETYPE="Prescott")
    assert value == "Prescott"


def test_an_edit_of_the_code_shows_and_another_file_does_not(tmp_path):
    (tmp_path / "module.py").write_text("a = 1\n")
    before = _code(tmp_path)
    (tmp_path / "notes.txt").write_text("remark\n")
    assert _code(tmp_path) == before
    (tmp_path / "module.py").write_text("a = 2\n")
    edited = _code(tmp_path)
    (tmp_path / "module.py").rename(tmp_path / "other.py")
    assert len({before, edited, _code(tmp_path)}) == 3


def test_a_copy_of_the_project_is_another_folder(tmp_path, monkeypatch):
    folders = []
    for name in ("project", "copy"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "dvc.yaml").write_text("stages:\n")
        monkeypatch.chdir(tmp_path / name)
        folders.append(_folder())
    monkeypatch.chdir(tmp_path)
    assert len({*folders, _folder()}) == 3


def test_the_first_difference_is_named_with_both_states():
    here = {"python": "3.11.7", "numpy": "2.4.0", "absent there": "1"}
    assert difference(here, {"python": "3.11.7", "numpy": "2.4.0", "absent here": "2"}) is None
    assert (
        difference(here, {"python": "3.11.7", "numpy": "2.3.0"})
        == "numpy is 2.3.0 there and 2.4.0 here"
    )
