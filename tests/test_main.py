"""The command that runs a stage, a study or a tool: all found by their places, and what is refused
before anything runs.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from source_code import ROOT

from pipeline.__main__ import main


def refusal(monkeypatch, *words: str) -> str:
    """What the command says as it ends without running anything."""
    monkeypatch.setattr(sys, "argv", ["pipeline", *words])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert isinstance(stopped.value.code, str)  # Python prints it and ends with 1
    return stopped.value.code


def test_an_unknown_name_is_answered_with_those_there_are(monkeypatch):
    said = refusal(monkeypatch, "nonsense")
    assert said.endswith("error: there is no 'nonsense'")
    listed = {kind: line.split()[1:] for line in said.splitlines() for kind in line.split()[:1]}
    stages = [file.stem for file in (ROOT / "pipeline/stages").glob("[a-z]*.py")]
    assert listed["stages"] == sorted(stages) and {"track", "report"} < set(stages)
    assert listed["studies"] == sorted(
        file.parent.name for file in (ROOT / "pipeline/studies").glob("*/stage.py")
    )
    assert {"audit", "inspect", "lock", "new-dataset"} <= set(listed["tools"])


@pytest.mark.parametrize("words", [[], ["--help"], ["-h"]])
def test_without_a_name_or_when_asked_it_says_what_there_is(monkeypatch, capsys, words):
    monkeypatch.setattr(sys, "argv", ["pipeline", *words])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 0
    assert capsys.readouterr().out.startswith("usage: python -m pipeline NAME")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["fit"], "error: fit runs for one item: name it"),
        (["track", "wishart"], "error: track takes no item"),
        (["fit", "wishart", "gaussian"], "error: fit runs for one item: name it"),
    ],
)
def test_the_wrong_number_of_items_is_refused(monkeypatch, words, says):
    assert refusal(monkeypatch, *words) == says


def test_a_refusal_is_one_line_that_names_the_stage(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["pipeline", "configure"])
    assert main() == 1
    assert (
        capsys.readouterr().err
        == "error: configure: no such file; run the pipeline from the project's root [file "
        "params.yaml]\n"
    )


def bare(*words: str) -> subprocess.CompletedProcess:
    """The command by a Python that has the standard library alone."""
    command = [sys.executable, "-S", "-E", "-m", "pipeline", *words]
    path = {"PATH": os.environ["PATH"]}
    return subprocess.run(command, cwd=ROOT, env=path, capture_output=True, text=True, check=False)


def test_without_the_environment_one_line_says_how_to_get_it():
    done = bare("track")
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: track: no module ") and done.returncode == 1
    assert "`make`" in line and ".venv/bin/activate" in line
    # what is there can be asked without it
    assert bare("--help").returncode == 0


def test_a_module_of_the_project_that_is_missing_is_no_matter_of_the_environment(monkeypatch):
    def lost(*_: object) -> None:
        raise ModuleNotFoundError("No module named 'pipeline.lost'", name="pipeline.lost")

    monkeypatch.setattr(sys, "argv", ["pipeline", "track"])
    monkeypatch.setattr("pipeline.__main__._chosen", lost)
    with pytest.raises(ModuleNotFoundError):
        main()


def test_output_that_nobody_reads_further_ends_the_command_quietly():
    command = f"{sys.executable} -m pipeline inspect {Path('data/raw/youbot')} | true"
    done = subprocess.run(
        ["sh", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert "Traceback" not in done.stderr
