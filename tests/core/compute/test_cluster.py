"""Trials on a Dask cluster: a real scheduler and worker processes, over loopback. A cluster that is
lost, absent or unfit is named, with what to do about it.
"""

from __future__ import annotations

import gc
import operator
import os
import pickle
import signal
import time
from collections.abc import Iterator
from functools import partial
from itertools import islice
from threading import Thread

import numpy as np
import pytest
from distributed import Client
from distributed.utils import LoopRunner

from pipeline.core.compute import cluster as module
from pipeline.core.compute.cluster import TrialCluster, connected
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ComputeError, ConfigError
from pipeline.core.options.analysis import Compute, Dask
from tests.core.compute.example_trials import (
    articulated,
    begin,
    filtered,
    give_up,
    late,
    layout,
    pause,
    peak,
    time_out,
)


@pytest.mark.slow
@pytest.mark.parametrize("function", [partial(filtered, steps=np.full((30, 3), 1e-3)), articulated])
def test_the_bytes_are_those_of_this_process(function, running):
    here, there = (
        list(run_trials(function, range(6), compute=compute, label="takes"))
        for compute in (Compute(1), running.compute())
    )
    assert len({*here}) == 6 and there == here


@pytest.mark.slow
def test_trials_and_results_are_laid_out_as_in_this_process(running):
    # what Dask sends without pickle may be read-only or lie in another order
    trials = [np.zeros((4, 6))[:, :-1], np.zeros((300, 300)).T, np.zeros((300, 300))[:, ::2]]
    function, layouts = partial(layout, kept=[1, 2]), []
    for compute in (Compute(1), running.compute()):
        results = run_trials(function, trials * 4, compute=compute, label="trials")
        layouts.append([(kept, flags, str(result.flags)) for kept, flags, result in results])
    assert layouts[0] == layouts[1] and len(set(layouts[0])) > 1


def test_trials_go_out_in_blocks_that_the_dashboard_shows_by_name(running, monkeypatch):
    blocks, submitted = [], Client.submit

    def submit(client: Client, *arguments, **options):
        blocks.append(options["key"])
        return submitted(client, *arguments, **options)

    def tasks(dask_scheduler) -> set[str]:
        return {task.prefix.name for task in dask_scheduler.tasks.values()}

    monkeypatch.setattr(Client, "submit", submit)
    trials, label = (number for number in range(3000)), "filter wishart: takes"
    results = run_trials(operator.neg, trials, compute=running.compute(), label=label)
    first = next(results)
    with Client(running.address, set_as_default=False) as client:
        assert client.run_on_scheduler(tasks) >= {label, f"{label}, what they share"}
        assert [first, *results] == [-number for number in range(3000)]
        assert not client.run_on_scheduler(tasks)
    assert len(blocks) == len(set(blocks)) < 300


def test_an_error_of_a_trial_arrives_with_its_evidence_and_stops_the_rest(running, tmp_path):
    taken = (number for number in range(2000))
    with pytest.raises(ConfigError, match="refused") as raised:
        list(
            run_trials(partial(begin, folder=tmp_path), taken, compute=running.compute(), label="")
        )
    assert raised.value.evidence == {"key": "a"}
    assert next(taken) < 100 and len([*tmp_path.iterdir()]) < 100


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
        arrays = (np.full(100_000, n) for n in range(number))
        return run_trials(np.negative, arrays, compute=running.compute(), label="trials")

    few, many = peak(trials(15)), peak(trials(60))
    assert many < 1.5 * few
    # who keeps the results has them all in memory
    assert peak(list(trials(60)) for _ in range(1)) > 2 * many


@pytest.mark.slow
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_scheduler_that_is_lost_or_silent_is_named(start, end):
    started = start()
    compute = started.compute(timeout=5.0)
    results = run_trials(pause, [0.05] * 400, compute=compute, label="trials")
    next(results)
    started.scheduler.send_signal(end)
    before = time.monotonic()
    with pytest.raises(ComputeError, match="is lost; start it again") as raised:
        list(results)
    assert raised.value.evidence["address"] == started.address
    # the trials alone would take 20 s; a killed one is missed at once
    assert time.monotonic() - before < 18


@pytest.mark.slow
def test_a_scheduler_that_no_longer_answers_when_a_result_is_there_is_named_too(start):
    started = start()
    with connected(started.compute(timeout=3.0)) as client:
        running = TrialCluster(client, pickle.dumps(operator.neg), 3.0, "trials")
        future = running.submit([pickle.dumps(1)])
        # the client knows now that it is done, and has not asked for it
        time.sleep(3)
        started.scheduler.send_signal(signal.SIGSTOP)
        with pytest.raises(ComputeError, match="scheduler is lost"):
            running.result(future)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere", "http://127.0.0.1:9", ""])
def test_what_is_no_address_of_a_scheduler_is_refused(address):
    compute = Compute(dask=Dask(address, 1.0))
    with pytest.raises(ComputeError, match="no Dask scheduler answers"):
        list(run_trials(operator.neg, [1], compute=compute, label="trials"))


def test_the_collection_of_a_client_without_a_scheduler_waits_for_no_other():
    gc.collect()
    with pytest.raises(ComputeError), connected(Compute(dask=Dask("nowhere", 1.0))):
        pass
    with LoopRunner._lock:  # as another client holds it that is just being started
        collecting = Thread(target=gc.collect, daemon=True)
        collecting.start()
        collecting.join(20)
        assert not collecting.is_alive()


def test_a_scheduler_without_workers_is_waited_for_and_then_named(idle):
    with pytest.raises(ComputeError, match="without workers for 1 s"):
        list(run_trials(operator.neg, [1], compute=idle.compute(timeout=1.0), label="trials"))


PROJECT = {"PYTHONPATH": "."}


@pytest.mark.parametrize(
    ("threads", "variables", "reason"),
    [
        (2, PROJECT, "threads is 2 there and 1 here"),
        (1, PROJECT | {"OPENBLAS_CORETYPE": "Prescott"}, "(CORETYPE|arithmetic) is .* there and"),
        (1, {}, "cannot import what it needs: No module named 'pipeline'"),
    ],
)
def test_a_worker_that_might_not_give_the_same_bytes_is_refused_with_the_reason(
    threads, variables, reason, idle
):
    with idle.worker(threads, **variables), pytest.raises(ComputeError, match=reason):
        list(run_trials(operator.neg, [1], compute=idle.compute(), label="trials"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("function", "error", "words"),
    [
        (give_up, ComputeError, r"4 workers ended.*memory runs out.*trials wishart: takes-0"),
        (time_out, TimeoutError, "of the trial itself"),
    ],
)
def test_trials_that_end_their_workers_or_time_out_by_themselves(running, function, error, words):
    trials = run_trials(function, [1], compute=running.compute(), label="wishart: takes")
    with pytest.raises(error, match=words.replace("trials wishart", "wishart")):
        list(trials)
