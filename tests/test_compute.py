"""Trials in this process and in workers."""

from __future__ import annotations

import math
import operator
import os
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pipeline.compute import run_trials
from pipeline.errors import ConfigError, RecordingError
from pipeline.instruments.delimited import read_text
from pipeline.rng import stream


@pytest.mark.parametrize("workers", [0, 1, 2, 5])
def test_results_and_their_order_do_not_depend_on_the_workers(workers):
    streams = run_trials(partial(stream, 7, "test"), range(6), workers=workers, label="trials")
    assert [each.random() for each in streams] == [stream(7, "test", trial).random() for trial in range(6)]


@pytest.mark.parametrize("workers", [1, 2])
def test_no_trials_give_no_results(workers):
    assert run_trials(math.sqrt, [], workers=workers, label="trials") == []


def test_trials_may_come_from_a_generator():
    assert run_trials(operator.neg, (trial for trial in (1, 2)), workers=1, label="trials") == [-1, -2]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_trials_error_arrives_with_its_evidence(workers, tmp_path):
    file = tmp_path / "good.txt"
    file.write_text("1\n")
    with pytest.raises(RecordingError, match="absent") as raised:
        run_trials(read_text, [file, tmp_path / "absent.txt"], workers=workers, label="trials")
    assert raised.value.evidence["file"] == tmp_path / "absent.txt"


def begin(number: int, folder: Path) -> None:
    (folder / str(number)).touch()
    if number == 1:
        raise ConfigError("refused")


def test_an_error_stops_what_has_not_begun(tmp_path):
    with pytest.raises(ConfigError):
        run_trials(partial(begin, folder=tmp_path), range(5), workers=1, label="trials")
    assert {file.name for file in tmp_path.iterdir()} == {"0", "1"}


def contiguous(array: np.ndarray) -> bool:
    return array.flags.c_contiguous


@pytest.mark.parametrize("workers", [1, 2])
def test_an_array_is_laid_out_alike_wherever_the_trial_runs(workers):
    part = np.zeros((4, 6))[:, :-1]
    assert not contiguous(part)
    assert run_trials(contiguous, [part] * 3, workers=workers, label="trials") == [True] * 3


def process(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def test_workers_are_started_where_that_is_worth_it_alone():
    assert set(run_trials(process, [0.01] * 20, workers=2, label="trials")) == {os.getpid()}
    here, *elsewhere = run_trials(process, [0.5] * 12, workers=2, label="trials")
    assert here == os.getpid() and os.getpid() not in elsewhere


def test_an_error_in_a_worker_stops_what_has_not_begun():
    begin = time.perf_counter()
    with pytest.raises(TypeError):
        run_trials(time.sleep, [0.2, "no number", *[0.2] * 200], workers=2, label="trials")
    # all of them would take 20 s
    assert time.perf_counter() - begin < 10


def test_a_log_sees_one_line(capsys):
    run_trials(operator.neg, [1, 2, 3], workers=1, label="filter: takes")
    assert capsys.readouterr() == ("filter: takes: 3 done\n", "")
