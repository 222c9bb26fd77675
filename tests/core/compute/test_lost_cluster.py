"""A Dask cluster that is lost, absent or unfit is named, with what to do about it."""

from __future__ import annotations

import gc
import operator
import pickle
import signal
import time
from threading import Thread

import pytest
from distributed.utils import LoopRunner

from pipeline.core.compute.cluster import cluster
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ComputeError
from pipeline.core.options.analysis import Compute, Dask
from tests.core.compute.example_trials import (
    give_up,
    pause,
    time_out,
)


@pytest.mark.slow
def test_a_lost_scheduler_is_named_at_once(start):
    started = start()
    results = run_trials(pause, [0.05] * 400, compute=started.compute(), label="trials")
    next(results)
    started.scheduler.kill()
    begin = time.monotonic()
    with pytest.raises(ComputeError, match="has been lost; start it anew") as raised:
        list(results)
    assert raised.value.evidence["address"] == started.address
    # the trials alone would take 20 s
    assert time.monotonic() - begin < 15


@pytest.mark.slow
def test_a_scheduler_that_no_longer_answers_is_named_after_the_timeout(start):
    started = start()
    results = run_trials(pause, [0.05] * 400, compute=started.compute(timeout=5.0), label="trials")
    next(results)
    started.scheduler.send_signal(signal.SIGSTOP)
    begin = time.monotonic()
    with pytest.raises(ComputeError, match="has been lost"):
        list(results)
    assert time.monotonic() - begin < 40


@pytest.mark.slow
def test_a_scheduler_that_no_longer_answers_when_a_result_is_there_is_named_too(start):
    started = start()
    with cluster(pickle.dumps(operator.neg), started.compute(timeout=3.0), "trials") as running:
        results = running.submit([pickle.dumps(1)])
        # the client knows now that it is done, and has not asked for it
        time.sleep(3)
        started.scheduler.send_signal(signal.SIGSTOP)
        with pytest.raises(ComputeError, match="has been lost"):
            results()


@pytest.mark.slow
def test_a_trials_own_timeout_is_its_error(running):
    with pytest.raises(TimeoutError, match="of trial 0"):
        list(run_trials(time_out, [0], compute=running.compute(), label="trials"))


def test_a_scheduler_that_is_not_there_is_named_within_the_timeout():
    begin = time.monotonic()
    with pytest.raises(
        ComputeError, match=r"no Dask scheduler answers within 1 s.*tcp://127.0.0.1:9"
    ):
        list(
            run_trials(
                operator.neg,
                [1],
                compute=Compute(dask=Dask("tcp://127.0.0.1:9", 1.0)),
                label="trials",
            )
        )
    assert time.monotonic() - begin < 15


@pytest.mark.parametrize(
    "address", ["nowhere", "127.0.0.1", "http://127.0.0.1:9", "tcp://127.0.0.1:port", ""]
)
def test_what_is_no_address_of_a_scheduler_is_refused(address):
    with pytest.raises(ComputeError, match="no Dask scheduler answers"):
        list(
            run_trials(operator.neg, [1], compute=Compute(dask=Dask(address, 1.0)), label="trials")
        )


def test_a_client_that_found_no_scheduler_is_garbage_whose_collection_waits_for_no_other():
    gc.collect()
    with pytest.raises(ComputeError):
        list(
            run_trials(
                operator.neg, [1], compute=Compute(dask=Dask("nowhere", 1.0)), label="trials"
            )
        )
    # as another client holds it that is just being started
    with LoopRunner._lock:
        collecting = Thread(target=gc.collect, daemon=True)
        collecting.start()
        collecting.join(20)
        assert not collecting.is_alive()


def test_a_scheduler_without_workers_is_waited_for_and_then_named(idle):
    with pytest.raises(ComputeError, match="without workers for 1 s"):
        list(run_trials(operator.neg, [1], compute=idle.compute(timeout=1.0), label="trials"))


@pytest.mark.parametrize(
    ("threads", "variables", "reason"),
    [
        (2, {"PYTHONPATH": "."}, "threads is 2 there and 1 here"),
        (
            1,
            {"PYTHONPATH": ".", "OPENBLAS_CORETYPE": "Prescott"},
            "(OPENBLAS_CORETYPE|numpy's arithmetic) is .* there and .* here",
        ),
        (1, {}, "cannot import what it needs: No module named 'pipeline'"),
    ],
)
def test_a_worker_that_might_not_give_the_same_bytes_is_refused_with_the_reason(
    threads, variables, reason, idle
):
    with idle.worker(threads, **variables), pytest.raises(ComputeError, match=reason):
        list(run_trials(operator.neg, [1], compute=idle.compute(), label="trials"))


@pytest.mark.slow
def test_trials_that_end_their_workers_are_named(running):
    with pytest.raises(
        ComputeError, match=r"ended 4 workers.*memory runs out.*trials wishart: takes-0"
    ):
        list(run_trials(give_up, [1], compute=running.compute(), label="trials wishart: takes"))
