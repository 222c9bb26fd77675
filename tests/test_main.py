"""The command that runs a stage, a study or a tool, each found by its place; and its refusals."""

import errno
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Callable

import pytest
from case_tables import cases_beside
from source_code import ROOT

from pipeline import __main__ as command
from pipeline.core.errors import ConfigError

cases = cases_beside(__file__)
STAGES = sorted(file.stem for file in (ROOT / "pipeline/stages").glob("[a-z]*.py"))
STUDIES = sorted(
    file.parent.name for file in (ROOT / "pipeline/studies").glob("*/stage.py")
)
TOOLS = sorted(
    file.parent.name.replace("_", "-")
    for file in (ROOT / "pipeline/tools").glob("*/command.py")
)


def run(monkeypatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["pipeline", *words])
    return command.main()


def test_an_unknown_name_and_the_wrong_number_of_items_are_refused(monkeypatch, capsys):
    assert run(monkeypatch, "nonsense") == 1
    message = capsys.readouterr().err
    assert message.endswith("error: nonsense: there is no such stage, study or tool\n")

    listed = {}
    for line in message.splitlines():
        kind, *names = line.split() or [""]
        listed[kind] = names
    assert listed["stages"] == STAGES and {"track", "report"} < set(STAGES)
    assert listed["studies"] == STUDIES and listed["tools"] == TOOLS
    for words, refused in (
        ("fit", "fit: takes one item (model), got none"),
        ("track wishart", "track: takes no item, got wishart"),
        ("fit a b", "fit: takes one item (model), got a b"),
    ):
        assert run(monkeypatch, *words.split()) == 1
        assert capsys.readouterr().err == f"error: {refused}\n"


@cases("notation of hydra")
def test_an_option_in_the_notation_of_hydra_is_rejected_with_the_way_that_works(
    monkeypatch,
    capsys,
    words,
    refused,
):
    assert run(monkeypatch, *words.split()) == 1

    message = capsys.readouterr().err
    assert f"error: {refused}" in message
    assert "`overrides: {filter: {particles: 100}}`" in message
    assert "`dvc exp run -S dataset=ur5`" in message and "--queue" in message


def test_help_lists_the_names_and_names_each_stage_study_and_tool(monkeypatch, capsys):
    for words in ([], ["--help"], ["-h"]):
        assert run(monkeypatch, *words) == 0
        assert capsys.readouterr().out.startswith("usage: python -m pipeline NAME")

    for name in STAGES + STUDIES:
        assert run(monkeypatch, name, "--help") == 0
        (line,) = capsys.readouterr().out.splitlines()
        assert line.startswith(name) and ": " in line
    for tool in TOOLS:
        assert run(monkeypatch, tool, "--help") == 0
        assert capsys.readouterr().out.startswith(f"usage: python -m pipeline {tool}")


FULL = OSError(errno.ENOSPC, "", "a.parquet")
LIMITED = OSError(errno.EFBIG, "", "a.parquet")
READ_ONLY = OSError(errno.EROFS, "", "a", None, "b")
INVALID = ConfigError("must be > 0, got -0.1", key="a.b")
FAULTS = [  # exit code, words of the message
    (INVALID, 1, ["must be > 0, got -0.1 [key a.b]"]),
    (FULL, 1, ["a.parquet: No space left on device", "free some space"]),
    (LIMITED, 1, ["a.parquet: File too large", "ulimit -f"]),
    (READ_ONLY, 1, ["b: Read-only file system", "in a copy that"]),
    (RuntimeError("no\nfile"), 1, ["RuntimeError: no file", "PIPELINE_TRACEBACK=1"]),
    (MemoryError(), 1, ["out of memory"]),
    (ImportError("x.so: failed to map segment"), 1, ["out of memory", "ulimit -v"]),
    (KeyboardInterrupt(), 130, ["interrupted"]),
]


def raises(fault: BaseException) -> Callable[[], None]:
    def run() -> None:
        raise fault

    return run


@pytest.mark.parametrize(("fault", "code", "words"), FAULTS)
def test_every_error_is_one_line_that_names_the_stage(
    monkeypatch,
    capsys,
    fault,
    code,
    words,
):
    monkeypatch.setattr(command, "_find_call", lambda *_: raises(fault))
    assert run(monkeypatch, "track") == code
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: track: ") and all(word in line for word in words)

    monkeypatch.setenv(command.TRACE, "1")
    assert run(monkeypatch, "track") == code
    assert ("in run" in capsys.readouterr().err) == (code == 1)


def called(
    words: str,
    shell: bool = False,
    **environment: str,
) -> subprocess.CompletedProcess:
    """Call of Python in the project's root."""
    line = f"{shlex.quote(sys.executable)} {words}"
    command = ["sh", "-c", line] if shell else shlex.split(line)
    return subprocess.run(
        command,
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
    )


def test_without_the_environment_one_line_names_the_command_that_makes_it():
    def bare(words: str) -> subprocess.CompletedProcess:
        return called(f"-S -E -m pipeline {words}", PATH=os.environ["PATH"])

    done = bare("track")
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: track: no module ") and done.returncode == 1
    assert "`make env`" in line and ".venv/bin/activate" in line
    assert bare("--help").returncode == bare("fit --help").returncode == 0


@pytest.mark.parametrize("output", ["| true", ">&-"])
def test_output_that_nobody_reads_ends_without_a_message(output):
    done = called(f"-m pipeline --help {output}", shell=True, **os.environ)
    assert done.returncode == 0 and done.stderr == ""


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_that_cannot_be_written_ends_without_a_traceback(unbuffered):
    environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    done = called("-m pipeline --help > /dev/full", shell=True, **environment)
    assert done.returncode == 1

    (line,) = done.stderr.splitlines()
    assert "standard output: No space left on device" in line


def test_characters_that_the_locale_lacks_are_replaced(tmp_path):
    (tmp_path / "Prüfstand … 1.csv").write_text("t,a,b\n0,1,2\n1,2,3\n")
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = called(f"-m pipeline inspect {shlex.quote(str(tmp_path))}", **ascii_only)

    assert done.returncode == 0 and done.stderr == ""
    assert "Pr?fstand ? 1.csv" in done.stdout


@pytest.mark.parametrize("name", ["inspect", "track"])
def test_without_docstrings_the_help_is_the_same(monkeypatch, capsys, name):
    without = called(f"-OO -m pipeline {name} --help", **os.environ)
    monkeypatch.setenv("COLUMNS", "80")

    assert run(monkeypatch, name, "--help") == 0
    assert capsys.readouterr().out == without.stdout


def test_a_stage_ends_with_the_program_that_started_it(tmp_path):
    stage = "import pipeline.__main__ as m, signal, time"
    stage += "; signal.signal(signal.SIGINT, signal.SIG_IGN)"
    stage += "; m._end_with_parent(); open('begun', 'w')"
    stage += "\ntry:\n time.sleep(60)\nexcept KeyboardInterrupt:\n open('ended', 'w')"
    starter = "import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', sys.argv[1]])"
    command = [sys.executable, "-c", f"{starter}; time.sleep(60)", stage]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    parent = subprocess.Popen(command, cwd=tmp_path, env=environment)
    for name in ("begun", "ended"):
        until = time.monotonic() + 30
        while not (tmp_path / name).exists():
            assert time.monotonic() < until, name
            time.sleep(0.01)
        parent.kill()
        parent.wait()
