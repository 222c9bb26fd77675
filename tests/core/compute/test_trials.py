"""Trials in this process and in worker processes."""

from __future__ import annotations

import math
import operator
import os
import signal
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.compute import trials as module
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ComputeError, ConfigError, RecordingError
from pipeline.core.options.analysis import Compute
from pipeline.core.rng import stream
from pipeline.formats.delimited import read_text
from tests.core.compute.example_trials import peak

SERIAL, TWO = Compute(1), Compute(2)


@pytest.fixture
def at_once(monkeypatch):
    """Workers are started after the first trial, however short it was."""
    monkeypatch.setattr(module, "START", 0.0)


@pytest.mark.parametrize("workers", [0, 1, 2, 5])
def test_results_and_their_order_do_not_depend_on_the_workers(workers):
    streams = run_trials(
        partial(stream, 7, "test"), range(6), compute=Compute(workers), label="trials"
    )
    assert [each.random() for each in streams] == [
        stream(7, "test", trial).random() for trial in range(6)
    ]


@pytest.mark.parametrize("compute", [SERIAL, TWO])
def test_no_trials_give_no_results(compute):
    assert list(run_trials(math.sqrt, [], compute=compute, label="trials")) == []


@pytest.mark.slow
@pytest.mark.parametrize("compute", [SERIAL, TWO])
def test_trials_may_come_from_a_generator(compute, at_once):
    assert list(
        run_trials(operator.neg, (trial for trial in range(40)), compute=compute, label="trials")
    ) == [-n for n in range(40)]


@pytest.mark.parametrize("compute", [SERIAL, TWO])
def test_a_trials_error_arrives_with_its_evidence(compute, tmp_path, at_once):
    file = tmp_path / "good.txt"
    file.write_text("1\n")
    with pytest.raises(RecordingError, match="absent") as raised:
        list(
            run_trials(
                read_text, [file, tmp_path / "absent.txt", file], compute=compute, label="trials"
            )
        )
    assert raised.value.evidence["file"] == tmp_path / "absent.txt"


def begin(number: int, folder: Path) -> None:
    (folder / str(number)).touch()
    if number == 1:
        raise ConfigError("refused")


def test_an_error_stops_what_has_not_begun(tmp_path):
    with pytest.raises(ConfigError):
        list(run_trials(partial(begin, folder=tmp_path), range(5), compute=SERIAL, label="trials"))
    assert {file.name for file in tmp_path.iterdir()} == {"0", "1"}


def edge(array: np.ndarray) -> tuple[bool, np.ndarray]:
    return array.flags.c_contiguous, array[:, :-1]


@pytest.mark.parametrize("compute", [SERIAL, TWO])
def test_arrays_are_laid_out_alike_wherever_the_trial_runs(compute, at_once):
    part = np.zeros((4, 6))[:, :-1]
    assert not any(array.flags.c_contiguous for array in (part, edge(np.zeros((4, 6)))[1]))
    for laid_out, result in run_trials(edge, [part] * 3, compute=compute, label="trials"):
        assert laid_out and result.flags.c_contiguous


def deplete(trial: int, shared: list[int]) -> int:
    return shared.pop()


@pytest.mark.slow
@pytest.mark.parametrize("compute", [SERIAL, TWO])
def test_no_trial_sees_what_another_did_to_what_they_share(compute, monkeypatch):
    monkeypatch.setattr(module, "START", 0.0)
    assert (
        list(
            run_trials(partial(deplete, shared=[1, 2]), range(50), compute=compute, label="trials")
        )
        == [2] * 50
    )


def process(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


@pytest.mark.slow
def test_workers_are_started_where_that_is_worth_it_alone(monkeypatch):
    monkeypatch.setattr(module, "START", 0.4)
    monkeypatch.setattr(module, "LOADING", 0.2)
    assert set(run_trials(process, [0.001] * 20, compute=TWO, label="trials")) == {os.getpid()}
    # a first trial within LOADING says little, as it may have had to load what is compiled; one
    # that takes longer is enough
    first, second, *elsewhere = run_trials(process, [0.12] * 12, compute=TWO, label="trials")
    assert first == second == os.getpid() and os.getpid() not in elsewhere
    first, *elsewhere = run_trials(process, [0.6] * 6, compute=TWO, label="trials")
    assert first == os.getpid() and os.getpid() not in elsewhere


def test_an_error_in_a_worker_stops_what_has_not_begun():
    begin = time.perf_counter()
    with pytest.raises(TypeError):
        list(run_trials(time.sleep, [0.2, "no number", *[0.2] * 200], compute=TWO, label="trials"))
    # all of them would take 20 s
    assert time.perf_counter() - begin < 10


def give_up(number: int) -> None:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)


def test_a_worker_process_that_is_killed_is_named_as_the_reason(at_once):
    with pytest.raises(ComputeError, match=r"memory runs out.*filter: takes"):
        list(run_trials(give_up, range(6), compute=TWO, label="filter: takes"))


@pytest.mark.parametrize("compute", [SERIAL, TWO])
def test_memory_does_not_grow_with_the_number_of_trials(compute, at_once, monkeypatch):
    monkeypatch.setattr(module, "WINDOW", 4)

    def trials(number: int) -> Iterator[np.ndarray]:
        return run_trials(
            np.negative,
            (np.full(50_000, n) for n in range(number)),
            compute=compute,
            label="trials",
        )

    few, many = peak(trials(20)), peak(trials(100))
    assert many < 1.3 * few
    # who keeps the results has them all in memory
    assert peak(list(trials(100)) for _ in range(1)) > 3 * few


def test_a_log_sees_one_line(capsys):
    list(run_trials(operator.neg, [1, 2, 3], compute=SERIAL, label="filter: takes"))
    assert capsys.readouterr() == ("filter: takes: 3 done\n", "")
