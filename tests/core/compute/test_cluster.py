"""Trials on a Dask cluster: a real scheduler and worker processes, over loopback."""

from __future__ import annotations

import operator
import os
import signal
from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from distributed import Client

from pipeline.core.compute import cluster as module
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import RecordingError
from pipeline.core.options.analysis import Compute
from pipeline.formats.delimited import read_text
from tests.core.compute.example_trials import (
    articulated,
    filtered,
    late,
    layout,
    pause,
    peak,
)

SERIAL = Compute(1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "function", [partial(filtered, steps=np.full((30, 3), 1e-3)), partial(articulated, width=0.004)]
)
def test_the_bytes_are_those_of_this_process(function, running):
    tables = [
        list(run_trials(function, range(6), compute=compute, label="takes"))
        for compute in (SERIAL, running.compute())
    ]
    # of the numbers: a pickle also tells apart arrays whose types are equal but not one object, as
    # those of cached machine code may be
    of_this_process, of_the_cluster = [
        [table.to_numpy().tobytes() for table in parts] for parts in tables
    ]
    assert len(set(of_this_process)) == 6
    assert of_the_cluster == of_this_process


@pytest.mark.slow
def test_trials_and_results_are_laid_out_as_in_this_process(running):
    # what Dask sends without pickle may be read-only or lie in another order
    trials = [np.zeros((4, 6))[:, :-1], np.zeros((300, 300)).T, np.zeros((300, 300))[:, ::2]]
    layouts = []
    for compute in (SERIAL, running.compute()):
        results = list(
            run_trials(partial(layout, kept=[1, 2]), trials * 4, compute=compute, label="trials")
        )
        layouts.append([(kept, flags, str(result.flags)) for kept, flags, result in results])
    assert layouts[0] == layouts[1]
    assert len(set(layouts[0])) > 1


def tasks_of(address: str) -> set[str]:
    """The names by which the dashboard groups the tasks that the scheduler has now."""
    with Client(address, set_as_default=False) as client:
        return client.run_on_scheduler(
            lambda dask_scheduler: {task.prefix.name for task in dask_scheduler.tasks.values()}
        )


def test_the_dashboard_shows_the_trials_by_their_name(running):
    results = run_trials(
        pause, [0.3] * 12, compute=running.compute(), label="filter wishart: takes"
    )
    next(results)
    assert tasks_of(running.address) == {
        "filter wishart: takes",
        "filter wishart: takes, what they share",
    }
    assert len(list(results)) == 11
    assert tasks_of(running.address) == set()


def test_short_trials_go_out_in_blocks(running, monkeypatch):
    blocks = []

    def submit(client: Client, *arguments, **options):
        blocks.append(options["key"])
        return submitted(client, *arguments, **options)

    submitted = Client.submit
    monkeypatch.setattr(Client, "submit", submit)
    trials = (number for number in range(3000))
    assert list(run_trials(operator.neg, trials, compute=running.compute(), label="trials")) == [
        -number for number in range(3000)
    ]
    assert len(blocks) == len(set(blocks)) < 300


def test_an_error_of_a_trial_arrives_with_its_evidence_and_stops_the_rest(running, tmp_path):
    taken = []

    def files() -> Iterator[Path]:
        (tmp_path / "good.txt").write_text("1\n")
        for number in range(2000):
            taken.append(number)
            yield tmp_path / ("absent.txt" if number == 5 else "good.txt")

    with pytest.raises(RecordingError, match="absent") as raised:
        list(run_trials(read_text, files(), compute=running.compute(), label="trials"))
    assert raised.value.evidence["file"] == tmp_path / "absent.txt"
    assert len(taken) < 100


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_costs_time_alone(running):
    results = run_trials(late, range(150), compute=running.compute(), label="trials")
    first = list(islice(results, 10))
    lost = first[-1][1]
    os.kill(lost, signal.SIGKILL)
    rest = list(results)
    assert [number for number, _ in first + rest] == list(range(150))
    assert lost not in {pid for _, pid in rest[-20:]}


@pytest.mark.slow
def test_memory_of_this_process_does_not_grow_with_the_number_of_trials(running, monkeypatch):
    monkeypatch.setattr(module, "AHEAD", 1)
    monkeypatch.setattr(module, "BLOCK", 0.0)

    def trials(number: int) -> Iterator[np.ndarray]:
        return run_trials(
            np.negative,
            (np.full(100_000, n) for n in range(number)),
            compute=running.compute(),
            label="trials",
        )

    few, many = peak(trials(15)), peak(trials(60))
    assert many < 1.5 * few
    # who keeps the results has them all in memory
    assert peak(list(trials(60)) for _ in range(1)) > 2 * many
