"""What crashes, hangs, raises or takes all memory ends with its reason; the next call is made."""

from __future__ import annotations

import os
import signal
import sys
import time

import numpy as np
import pytest

from pipeline.core.bounds import Reading, Sandbox, bounds, within
from pipeline.core.errors import RecordingError

SMALL = Reading(seconds=1, memory_mib=256)


def _crash() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _recurse(level: int = 0) -> int:
    return _recurse(level + 1) + 1


def _refuse() -> None:
    raise RecordingError("no marker", file="a.csv", line=3)


def _outcome(sandbox: Sandbox, function, *arguments: object) -> object:
    return within(SMALL, sandbox.call, function, *arguments)


@pytest.mark.parametrize(
    ("function", "arguments", "words"),
    [
        (_crash, (), r"ends the process \(exit code -9\)"),
        (time.sleep, (60,), r"not read within 1 s.*dataset\.reading\.seconds"),
        (np.ones, (1 << 29,), r"more than 256 MiB of memory.*dataset\.reading\.memory_mib"),
        (_recurse, (), "nests too deeply"),
        (int, ("1" * 5000,), "its reader fails on it .ValueError: Exceeds"),
        (sys.exit, (3,), r"ends the process \(exit code 3\)"),
    ],
)
def test_what_ends_badly_is_refused_and_the_next_call_is_made(function, arguments, words):
    with Sandbox() as sandbox:
        with pytest.raises(RecordingError, match=words):
            _outcome(sandbox, function, *arguments)
        assert _outcome(sandbox, divmod, 7, 2) == (3, 1)
        assert _outcome(sandbox, np.ones, 1 << 20).sum() == 1 << 20


def test_a_refusal_keeps_its_evidence():
    with Sandbox() as sandbox, pytest.raises(RecordingError) as caught:
        sandbox.call(_refuse)
    assert caught.value.evidence == {"file": "a.csv", "line": 3}


def test_calls_that_end_well_share_a_process_which_ends_with_the_statement():
    with Sandbox() as sandbox:
        first, second = sandbox.call(os.getpid), sandbox.call(os.getpid)
    assert first == second != os.getpid()
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)


def test_bounds_hold_for_what_is_called_within_them_and_in_its_processes():
    def most() -> int:
        with Sandbox() as sandbox:
            return sandbox.call(bounds).file_mib

    assert within(Reading(file_mib=3), most) == 3 != bounds().file_mib
