"""The examples of CONTRIBUTING.md, applied to a copy of the project as they stand there: each adds
files, edits none, works, and is clean.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import NamedTuple

import pytest
from project_copy import ROOT, copy_project, run

from pipeline.core.typed_yaml import read_yaml

pytestmark = pytest.mark.slow

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
EXAMPLES = ("A model", "A figure", "A format", "A study")


class Block(NamedTuple):
    """A block of code: its language, the file that it is or the word ``run``, and its text."""

    language: str
    place: str
    text: str


def blocks(heading: str) -> list[Block]:
    """The blocks below a heading of the page."""
    section = re.search(rf"^## {heading}\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)[1]
    return [
        Block(*match)
        for match in re.findall(
            r"^```(\w+)(?: (\S+))?\n(.*?)^```$", section, re.MULTILINE | re.DOTALL
        )
    ]


def added() -> list[str]:
    """The Python files that the page adds."""
    return [
        block.place
        for heading in EXAMPLES
        for block in blocks(heading)
        if block.language == "python"
    ]


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """A copy of the project with all that the page adds."""
    folder = tmp_path_factory.mktemp("contributing") / "project"
    copy_project(folder)
    for block in (block for heading in EXAMPLES for block in blocks(heading)):
        if block.place != "run":
            file = folder / block.place
            assert block.place and not file.exists(), f"{block.place} is an edit"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(block.text, encoding="utf-8")
    return folder


@pytest.mark.parametrize("heading", EXAMPLES)
def test_an_example_passes_its_own_tests_when_it_is_put_in_place(project, heading):
    ((command,),) = [block.text.splitlines() for block in blocks(heading) if block.place == "run"]
    words = shlex.split(command)
    # the tests that it runs are those that it adds
    assert set(words) & set(added()) == {file for file in words if file.endswith(".py")} != set()
    done = run(*words, cwd=project)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout and "skipped" not in done.stdout


@pytest.mark.parametrize("heading", EXAMPLES)
def test_an_example_adds_files_and_edits_none(heading):
    kinds = {block.language for block in blocks(heading)}
    assert kinds <= {"python", "yaml", "sh"}
    places = [block.place for block in blocks(heading) if block.place != "run"]
    assert places and not [place for place in places if (ROOT / place).exists()]
    # one folder or file of code, its option file apart
    code = {place for place in places if place.startswith("pipeline/")}
    options = {place for place in code if place.startswith("pipeline/conf/")}
    assert len({str(Path(place).parent) for place in code - options}) == 1


def test_what_is_added_is_found_by_its_place(project):
    parameters = (project / "params.yaml").read_text()
    chosen = re.sub(r"(?m)^models: \[.*?\]", "models: [additive, independent]", parameters)
    (project / "params.yaml").write_text(chosen)
    assert run("python", "-m", "pipeline", "configure", cwd=project).returncode == 0
    assert "independent:\n    kind: independent" in (project / "data/config.yaml").read_text()
    fields = [f"{name}_q_{j}" for name in ("actual", "target") for j in range(6)]
    rows = [f"{0.008 * k:.3f}" + " 0.5" * 12 for k in range(3)]
    (project.parent / "log.csv").write_text(
        "\n".join([" ".join(["timestamp", *fields]), *rows, ""])
    )
    inspected = run("python", "-m", "pipeline", "inspect", "../log.csv", cwd=project)
    assert "UR RTDE log" in inspected.stdout and "125 Hz" in inspected.stdout
    assert " repeatability" in run("python", "-m", "pipeline", "--help", cwd=project).stdout
    stages = run("dvc", "stage", "list", "--all", "--name-only", cwd=project)
    assert "pipeline/studies/repeatability/dvc.yaml:repeatability" in stages.stdout


def test_the_way_of_a_take_names_files_and_functions_that_exist():
    way = re.search(r"^## The way of one take\n(.*?)(?=^## )", PAGE, re.MULTILINE | re.DOTALL)[1]
    assert 1 <= len(re.findall(r"^\d\. ", way, re.MULTILINE)) <= 7
    files = [ROOT / name for name in re.findall(r"`(pipeline/[\w/]+\.py)`", way)]
    assert files and all(file.is_file() for file in files)
    code = "\n".join(file.read_text(encoding="utf-8") for file in files)
    functions = {name for name in re.findall(r"`([a-z_]+)`", way) if f"def {name}(" in code}
    assert {"read_take", "read_motive", "track_rows", "process_noise", "draw"} <= functions
    # what else stands in such marks is a table, or the figure
    tables = read_yaml(ROOT / "pipeline/core/tables.yaml")
    assert {*re.findall(r"`([a-z_]+)`", way)} - functions - {*tables} == {"joint_std"}


def test_what_the_page_adds_is_clean(project):
    for command in (["ruff", "check"], ["ruff", "format", "--check"]):
        done = run(*command, *added(), cwd=project)
        assert done.returncode == 0, done.stdout
    # the control: a file that is not is found out
    (project / "unclean.py").write_text("import os\n")
    assert run("ruff", "check", "unclean.py", cwd=project).returncode != 0
