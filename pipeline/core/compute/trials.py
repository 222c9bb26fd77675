"""Trials in this process, in worker processes or on a Dask cluster, with equal results in order."""

import math
import os
import pickle
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import chain, islice
from operator import length_hint
from typing import TYPE_CHECKING

from pipeline.core.compute.pickled import call_pickled
from pipeline.core.errors import ComputeError

if TYPE_CHECKING:
    from pipeline.core.options.analysis import Compute

START = 2.0  # s until workers compute; they must save more than this
LOADING = 4.0  # s of the first trial attributed to imports and compiled code
WINDOW = 64  # trials per worker that are submitted before the first of their results is taken


def run_trials(
    function: Callable,
    trials: Iterable,
    *,
    compute: "Compute",
    label: str,
) -> Iterator:
    """Yield ``function(trial)`` of every trial in order; no byte of a value depends on ``compute``.

    ``function``, trials and results are pickled, a bounded number of them at a time. A terminal
    shows a bar, a log one line. Raises the first exception of a trial, which stops the trials, and
    ComputeError where workers are lost or might compute other bytes.
    """
    results = _results(pickle.dumps(function), trials, compute, label)
    if sys.stderr.isatty():
        from tqdm import tqdm

        total = length_hint(trials) or None
        yield from tqdm(results, total=total, desc=label, unit="trial")
        return
    done = 0
    for result in results:
        done += 1
        yield result
    print(f"{label}: {done} done", flush=True)


def _results(
    function: bytes,
    trials: Iterable,
    compute: "Compute",
    label: str,
) -> Iterator:
    """Yield results of this process until workers save more time than their start takes; a running
    cluster computes all.
    """
    left = length_hint(trials) or math.inf
    trials = iter(trials)
    if compute.dask is not None and compute.dask.address is not None:
        from pipeline.core.compute.cluster import results_of_cluster

        yield from results_of_cluster(function, trials, compute, label)
        return
    workers = compute.workers or len(os.sched_getaffinity(0))
    # s per trial: first trial without loading, then the mean of later trials
    pace = 0.0
    for done, trial in enumerate(trials):
        begin = time.perf_counter()
        result = call_pickled(function, pickle.dumps(trial))
        took = time.perf_counter() - begin
        yield pickle.loads(result)
        if done:
            pace += (took - pace) / done
        else:
            pace = max(took - LOADING, 0.0)
        left -= 1
        workers = min(workers, left)
        if workers > 1 and pace * left * (1 - 1 / workers) > START:
            if compute.dask is None:
                yield from _by_processes(function, trials, int(workers), label)
            else:
                from pipeline.core.compute.cluster import results_of_cluster

                yield from results_of_cluster(function, trials, compute, label)


def _by_processes(
    function: bytes,
    trials: Iterator,
    workers: int,
    label: str,
) -> Iterator:
    """Yield the results in order; trials are submitted a window at a time."""
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    call = delayed(call_pickled)
    try:
        with Parallel(workers, backend="loky", return_as="generator") as parallel:
            for first in trials:
                window = chain([first], islice(trials, WINDOW * workers - 1))
                results = parallel(
                    call(function, pickle.dumps(trial)) for trial in window
                )
                yield from map(pickle.loads, results)
    except TerminatedWorkerError:
        message = "a worker process was killed, as happens when memory runs out; "
        message += "choose fewer workers, or compute: serial"
        raise ComputeError(message, trials=label) from None
