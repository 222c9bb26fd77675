"""Errors, random streams, YAML, the environment on which bytes depend; and bounds on the reading of
files: a crash, a hang, an exception or all memory taken ends with its reason, and the next call is
made.
"""

import json
import os
import pickle
import signal
import subprocess
import sys
import time
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from case_tables import cases_beside
from omegaconf import OmegaConf
from project_copy import ROOT

from pipeline.core import environment
from pipeline.core.bounds import Reading, Sandbox, bounds, within
from pipeline.core.compute.cluster import fingerprint
from pipeline.core.environment import BOUNDS
from pipeline.core.errors import ConfigError, PipelineError, RecordingError
from pipeline.core.rng import stream
from pipeline.core.typed_yaml import read_yaml
from pipeline.tools.audit.command import agree


@pytest.mark.parametrize("kind", [PipelineError, *PipelineError.__subclasses__()])
def test_an_error_keeps_its_evidence_in_the_message_and_across_processes(kind):
    evidence = {"file": "a.csv", "line": 7}
    raised = kind("the column is torn", **evidence, take=None)
    error = pickle.loads(pickle.dumps(raised))

    assert type(error) is kind
    assert str(error) == "the column is torn [file a.csv, line 7]"
    assert error.message == "the column is torn"
    assert error.evidence == evidence
    assert str(kind("no evidence")) == "no evidence"


cases = cases_beside(__file__)


def elsewhere(code: str, **variables: str) -> str:
    """Output of ``code`` in another process of the project's root."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": "."} | variables,
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout.strip()


def test_equal_arguments_give_equal_streams_in_every_process():
    # strings hash differently in every process; the streams must not
    code = "from pipeline.core.rng import stream; print(stream(7, 'filter', 3).random(5).tolist())"
    first = stream(7, "filter", 3).random(5).tolist()

    assert stream(7, "filter", 3).random(5).tolist() == first
    assert json.loads(elsewhere(code)) == first


def test_streams_of_another_seed_stage_or_trial_are_others():
    keys = [(7, "filter"), (8, "filter"), (7, "record"), (7, "filter", 0)]
    keys += [(7, "filter", 1), (7, "filter", 0, 1), (7, "filter", 1, 0)]
    assert len({stream(*key).random() for key in keys}) == len(keys)


def test_values_of_yaml_are_those_that_omegaconf_reads(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text(
        "a: 1e-3\nb: 2024-01-01\nc: [1, 0x10, 1_000, .5, yes, ~, 'ü']\nd: {e: 1.0e+5, f: '${a}', "
        "g: 12:30}\n",
        encoding="utf-8",
    )
    values = read_yaml(file)
    assert values == OmegaConf.to_container(OmegaConf.load(file))
    assert values["a"] == 0.001
    assert values["d"]["f"] == "${a}"

    file.write_text("# nothing yet\n")
    assert read_yaml(file) == {}


@cases("ambiguous", ["a: \xff\n"])
def test_yaml_that_is_ambiguous_or_holds_no_keys_is_refused_with_its_file(
    tmp_path,
    content,
):
    file = tmp_path / "a.yaml"
    file.write_text(content, encoding="latin-1")

    with pytest.raises(ConfigError) as caught:
        read_yaml(file)
    assert caught.value.evidence["file"] == file


DEEP = [
    ["a: " + "[" * 40_000 + "]" * 40_000, "line 1 nests more than 100 levels"],
    ["a:\n  " + "- " * 40_000 + "1\n", "line 2 nests more than 100 levels"],
    ["{a: " * 40_000, "line 1 nests more than 100 levels"],
]


@cases("no values", *DEEP)
def test_yaml_that_cannot_be_values_is_refused_in_plain_words(tmp_path, content, words):
    file = tmp_path / "a.yaml"
    file.write_text(content)

    with pytest.raises(ConfigError, match=words) as refused:
        read_yaml(file)
    assert "\n" not in str(refused.value)


def test_the_time_of_a_mapping_grows_with_its_keys(tmp_path):
    """Ten times the keys take 100 times as long if each is compared with all others."""
    seconds = {}
    for keys in (2_000, 20_000):
        file = tmp_path / f"{keys}.yaml"
        file.write_text("".join(f"k{i}: 1\n" for i in range(keys)))
        start = process_time()
        assert len(read_yaml(file)) == keys
        seconds[keys] = process_time() - start

    assert seconds[20_000] < 40 * seconds[2_000]


def test_a_users_own_setting_is_overwritten_by_the_command():
    code = (
        "import pipeline.__main__, os; print(*map(os.environ.get, %r), sep=chr(10))"
        % [*BOUNDS]
    )
    printed = elsewhere(code, OMP_NUM_THREADS="4", OPENBLAS_CORETYPE="Prescott")
    assert printed.splitlines() == [*BOUNDS.values()]


@cases("processors")
def test_a_processor_without_avx2_runs_at_its_own_level(
    machine,
    flags,
    variable,
    equal,
    tmp_path,
    monkeypatch,
):
    (tmp_path / "cpuinfo").write_text(f"processor : 0\nflags : fpu {flags}\n")
    monkeypatch.setattr(environment, "FLAGS", tmp_path / "cpuinfo")
    monkeypatch.setattr(environment.platform, "machine", lambda: machine)
    monkeypatch.setenv(environment.PROCESSOR, variable)

    assert environment.has_equal_bytes() == equal


def test_without_avx2_the_arithmetic_is_the_processors():
    code = "import pipeline.core.environment as e; print(*sorted(e.BOUNDS))"
    names = "NUMBA_DISABLE_INTEL_SVML OMP_NUM_THREADS OPENBLAS_NUM_THREADS"
    assert elsewhere(code, PIPELINE_PROCESSOR="any") == names


def test_the_audit_of_another_processor_allows_rounding_and_no_more():
    assert agree("a,1.0,x2", "a,1.000001,x2")
    for line in ("a,1.0001,x2", "a,1.0000000001,y2", "a,1.0000000001"):
        assert not agree("a,1.0,x2", line)


def test_loading_an_exported_model_leaves_a_colleagues_environment():
    code = (
        "import os; before = dict(os.environ); import pipeline.models.exported.reader; "
        "print(before == dict(os.environ))"
    )
    assert elsewhere(code, OMP_NUM_THREADS="4") == "True"


@pytest.mark.parametrize("changed", [{}, {"OPENBLAS_CORETYPE": "Prescott"}])
def test_the_fingerprint_tells_arithmetic_apart_and_nothing_else(changed):
    code = (
        "import json; from pipeline.core.compute.cluster import fingerprint; "
        "print(json.dumps(fingerprint()))"
    )
    if changed:  # before numpy, and not assigned again
        code = (
            "import os, sys, types; m = types.ModuleType('pipeline.core.environment'); "
            f"m.BOUNDS = {dict(BOUNDS)!r}; sys.modules[m.__name__] = m; " + code
        )
    there = json.loads(elsewhere(code, **changed))
    names = {name for name, state in fingerprint().items() if there[name] != state}

    assert names == ({"OPENBLAS_CORETYPE", "numpy's arithmetic"} if changed else set())


SMALL = Reading(seconds=1, memory_mib=256)


def _crash(by: signal.Signals) -> None:
    os.kill(os.getpid(), by)


def _fill() -> None:
    Path("/dev/full").write_text("no space")


def _recurse(level: int = 0) -> int:
    return _recurse(level + 1) + 1


def _refuse() -> None:
    raise RecordingError("no marker", file="a.csv", line=3)


def _outcome(sandbox: Sandbox, function, *arguments: object) -> object:
    return within(SMALL, sandbox.call, function, *arguments)


BAD_ENDS = [  # function, its arguments, words of the refusal
    (_crash, [signal.SIGSEGV], r"ends the process \(SIGSEGV\)"),
    (_crash, [signal.SIGKILL], "was killed, as where a machine lacks memory"),
    (_fill, [], "no space left on device at .*: free some space, or set TMPDIR"),
    (import_module, ["pipeline.absent"], r"a package is missing \(No module named"),
    (os.listdir, ["/absent"], r"cannot be read \(No such file"),
    (time.sleep, [60], r"not read within 1 s.*dataset\.reading\.seconds"),
    (np.ones, [1 << 29], r"more than 256 MiB of memory.*dataset\.reading\.memory_mib"),
    (_recurse, [], "nests too deeply"),
    (_refuse, [], r"^no marker \[file a.csv, line 3\]$"),
    (int, ["1" * 5000], "its reader fails on it .ValueError: Exceeds"),
    (sys.exit, [3], r"ends the process \(exit code 3\)"),
]


@pytest.mark.parametrize(("function", "arguments", "words"), BAD_ENDS)
def test_what_ends_badly_is_refused_and_the_next_call_is_made(
    function,
    arguments,
    words,
):
    with Sandbox() as sandbox:
        with pytest.raises(RecordingError, match=words):
            _outcome(sandbox, function, *arguments)
        assert _outcome(sandbox, np.ones, 1 << 20).sum() == 1 << 20
        first = sandbox.call(os.getpid)
        second = sandbox.call(os.getpid)

    assert first == second != os.getpid()
    with pytest.raises(ProcessLookupError):  # the process ends with the statement
        os.kill(first, 0)


def test_bounds_hold_for_what_is_called_within_them_and_in_its_processes():
    def most() -> int:
        with Sandbox() as sandbox:
            return sandbox.call(bounds).file_mib

    assert within(Reading(file_mib=3), most) == 3 != bounds().file_mib


def _hang() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # the traceback that its end writes
    within(Reading(seconds=0.2), Sandbox().call, time.sleep, 60.0)


def test_a_reader_that_hangs_ends_a_worker_that_may_have_no_process():
    """Workers of Dask are daemons, and started anew."""
    worker = get_context("spawn").Process(target=_hang, daemon=True)
    worker.start()
    worker.join(30)

    assert worker.exitcode == 1
