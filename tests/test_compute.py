"""Trials in this process and in workers."""

from __future__ import annotations

import math
import operator
import time
from functools import partial

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


def test_an_error_stops_what_has_not_begun():
    started = []

    def trial(number: int) -> None:
        started.append(number)
        if number == 1:
            raise ConfigError("refused")

    with pytest.raises(ConfigError):
        run_trials(trial, range(5), workers=1, label="trials")
    assert started == [0, 1]


def test_an_error_in_a_worker_stops_what_has_not_begun():
    begin = time.perf_counter()
    with pytest.raises(TypeError):
        run_trials(time.sleep, ["no number", *[0.2] * 200], workers=2, label="trials")
    # all of them would take 20 s
    assert time.perf_counter() - begin < 10


def test_a_log_sees_one_line(capsys):
    run_trials(operator.neg, [1, 2, 3], workers=1, label="filter: takes")
    assert capsys.readouterr() == ("filter: takes: 3 done\n", "")
