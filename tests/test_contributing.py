"""The examples of CONTRIBUTING.md, applied to a copy of the project as they stand there: what they add works, and is clean."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest
from conftest import run
from smoke import ROOT, copy_project

pytestmark = pytest.mark.slow

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
EXAMPLES = ("A model", "A figure", "An instrument")


class Block(NamedTuple):
    """A block of code: its language, the file that it is or the word ``run``, and its text."""

    language: str
    place: str
    text: str


def blocks(heading: str) -> list[Block]:
    """The blocks below a heading of the page."""
    section = re.search(rf"^## {heading}\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)[1]
    return [Block(*found) for found in re.findall(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)]


def added() -> list[str]:
    """The Python files that the page adds."""
    return [block.place for heading in EXAMPLES for block in blocks(heading) if block.language == "python"]


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """A copy of the project with all that the page adds and changes."""
    folder = tmp_path_factory.mktemp("contributing") / "project"
    copy_project(folder)
    for block in (block for heading in EXAMPLES for block in blocks(heading)):
        if block.language == "diff":
            applied = subprocess.run(["git", "apply", "-"], cwd=folder, input=block.text, capture_output=True, text=True, check=False)
            assert applied.returncode == 0, applied.stderr
        elif block.place != "run":
            assert block.place and not (folder / block.place).exists()
            (folder / block.place).write_text(block.text, encoding="utf-8")
    return folder


@pytest.mark.parametrize("heading", EXAMPLES)
def test_an_example_passes_its_own_tests_when_it_is_put_in_place(project, heading):
    ((command,),) = [block.text.splitlines() for block in blocks(heading) if block.place == "run"]
    words = shlex.split(command)
    # the tests that it runs are those that it adds
    assert set(words) & set(added()) == {file for file in words if file.endswith(".py")}
    done = run(*words, cwd=project)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout and "skipped" not in done.stdout


def test_the_model_composes_with_the_others_and_the_instrument_is_recognised_by_the_command(project):
    parameters = (project / "params.yaml").read_text()
    (project / "params.yaml").write_text(re.sub(r"^models: \[.*?\]", "models: [additive, drifting]", parameters, flags=re.MULTILINE))
    assert run("python", "-m", "pipeline", "configure", cwd=project).returncode == 0
    assert "drifting:\n    kind: drifting" in (project / "data/config.yaml").read_text()
    (project.parent / "take.tsv").write_text("NO_OF_FRAMES\t1\nFREQUENCY\t100\nMARKER_NAMES\tA\n1\t2\t3\n")
    inspected = run("python", "-m", "pipeline", "inspect", "../take.tsv", cwd=project)
    assert "Qualisys TSV" in inspected.stdout and "100" in inspected.stdout


def test_what_the_page_adds_is_clean(project):
    for command in (["ruff", "check"], ["ruff", "format", "--check"]):
        done = run(*command, *added(), cwd=project)
        assert done.returncode == 0, done.stdout
    # the control: a file that is not is found out
    (project / "unclean.py").write_text("import os\n")
    assert run("ruff", "check", "unclean.py", cwd=project).returncode != 0
