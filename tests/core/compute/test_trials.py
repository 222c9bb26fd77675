"""Trials in this process and in worker processes."""

from __future__ import annotations

import operator
import os
import signal
from collections.abc import Iterator
from functools import partial

import numpy as np
import pytest

from pipeline.core.compute import trials as module
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ComputeError, ConfigError
from pipeline.core.options.analysis import Compute
from pipeline.core.rng import stream
from tests.core.compute.example_trials import begin, pause, peak

SERIAL, TWO = Compute(1), Compute(2)
each_way = pytest.mark.parametrize("compute", [SERIAL, TWO], ids=["serial", "processes"])


@pytest.fixture
def at_once(monkeypatch):
    """Workers are started after the first trial, however short it was."""
    monkeypatch.setattr(module, "START", 0.0)


@pytest.mark.parametrize("workers", [0, 1, 2, 5])
def test_results_and_their_order_do_not_depend_on_the_workers(workers):
    function, compute = partial(stream, 7, "test"), Compute(workers)
    drawn = [each.random() for each in run_trials(function, range(6), compute=compute, label="")]
    assert drawn == [stream(7, "test", trial).random() for trial in range(6)]


@each_way
def test_a_trials_error_arrives_with_its_evidence_and_stops_the_rest(compute, tmp_path, at_once):
    with pytest.raises(ConfigError, match="refused") as raised:
        list(run_trials(partial(begin, folder=tmp_path), range(400), compute=compute, label=""))
    assert raised.value.evidence == {"key": "a"}
    begun = {file.name for file in tmp_path.iterdir()}
    assert begun == {"0", "1"} if compute is SERIAL else len(begun) < 300


def edge(array: np.ndarray) -> tuple[bool, np.ndarray]:
    return array.flags.c_contiguous, array[:, :-1]


@each_way
def test_arrays_are_laid_out_alike_wherever_the_trial_runs(compute, at_once):
    part = np.zeros((4, 6))[:, :-1]
    assert not any(array.flags.c_contiguous for array in (part, edge(np.zeros((4, 6)))[1]))
    for laid_out, result in run_trials(edge, [part] * 3, compute=compute, label="trials"):
        assert laid_out and result.flags.c_contiguous


def deplete(trial: int, shared: list[int]) -> int:
    return shared.pop()


@pytest.mark.slow
@each_way
def test_no_trial_sees_what_another_did_to_what_they_share(compute, at_once):
    function = partial(deplete, shared=[1, 2])
    assert [*run_trials(function, range(50), compute=compute, label="trials")] == [2] * 50


@pytest.mark.slow
def test_workers_are_started_where_that_is_worth_it_alone(monkeypatch):
    monkeypatch.setattr(module, "START", 0.4)
    monkeypatch.setattr(module, "LOADING", 0.2)
    assert {*run_trials(pause, [0.001] * 20, compute=TWO, label="trials")} == {os.getpid()}
    # a first trial within LOADING says little, as it may have had to load what is compiled; one
    # that takes longer is enough
    first, second, *elsewhere = run_trials(pause, [0.12] * 12, compute=TWO, label="trials")
    assert first == second == os.getpid() and os.getpid() not in elsewhere
    first, *elsewhere = run_trials(pause, [0.6] * 6, compute=TWO, label="trials")
    assert first == os.getpid() and os.getpid() not in elsewhere


def give_up(number: int) -> None:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)


def test_a_worker_process_that_is_killed_is_named_as_the_reason(at_once):
    with pytest.raises(ComputeError, match=r"memory runs out.*filter: takes"):
        list(run_trials(give_up, range(6), compute=TWO, label="filter: takes"))


@each_way
def test_memory_does_not_grow_with_the_number_of_trials(compute, at_once, monkeypatch):
    monkeypatch.setattr(module, "WINDOW", 4)

    def trials(number: int) -> Iterator[np.ndarray]:
        arrays = (np.full(50_000, n) for n in range(number))
        return run_trials(np.negative, arrays, compute=compute, label="trials")

    few, many = peak(trials(20)), peak(trials(100))
    assert many < 1.3 * few
    # who keeps the results has them all in memory
    assert peak(list(trials(100)) for _ in range(1)) > 3 * few


def test_a_log_sees_one_line(capsys):
    list(run_trials(operator.neg, [1, 2, 3], compute=SERIAL, label="filter: takes"))
    assert capsys.readouterr() == ("filter: takes: 3 done\n", "")
