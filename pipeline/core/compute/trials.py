"""Where trials run: in this process, in worker processes or on a Dask cluster, with the same
results in the same order.
"""

from __future__ import annotations

import math
import os
import pickle
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from multiprocessing import get_context
from operator import length_hint

import pipeline
from pipeline.core.compute.block import Results, Submit, run_block
from pipeline.core.errors import ComputeError
from pipeline.core.options.compute import Compute

# s, about the processor time of two workers until they compute: imports in the server that they are
# forks of, and in each of them what is compiled; what they save by the clock has to be worth it
START = 4.0
LOADING = 2.0  # s, of which the first trial here may take so much to load what is compiled
# s of trials that are handed to a worker at a time, against which the handing over is little
BLOCK = 0.2
# per worker, that the trials that are left are cut into at least: towards the end blocks shrink, so
# that workers end together
PARTS = 8
# blocks per worker that are handed out before the first of them is taken back, so that a long trial
# holds up no other worker
AHEAD = 16


def run_trials(function: Callable, trials: Iterable, *, compute: Compute, label: str) -> Iterator:
    """Yield ``function(trial)`` of every trial, in order; neither the values nor a byte of them
    depend on ``compute``.

    ``function``, the trials and the results are pickled. Trials are taken, and results held, a
    bounded number at a time, however many there are. A person at a terminal sees a bar with an
    estimate of what is left, a log sees one line. An exception of any trial stops the rest and is
    raised here; so is ComputeError where workers are lost, and those that would not give the same
    bytes are refused.
    """
    total = length_hint(trials) or None
    results = _results(pickle.dumps(function), trials, compute, label)
    if sys.stderr.isatty():
        from tqdm import tqdm

        yield from tqdm(results, total=total, desc=label, unit="trial")
        return
    done = 0
    for result in results:
        done += 1
        yield result
    print(f"{label}: {done} done", flush=True)


def _results(function: bytes, trials: Iterable, compute: Compute, label: str) -> Iterator:
    # a number that is not known is taken for a great one
    left = length_hint(trials) or math.inf
    if compute.dask is not None:
        # imported here: who computes on this machine does not pay for it
        from pipeline.core.compute.cluster import cluster

        with cluster(function, compute, label) as running:
            yield from _in_order(running.submit, running.workers, iter(trials), left)
        return
    trials = iter(trials)
    processes = compute.workers or len(os.sched_getaffinity(0))
    taken, pace = 0, 0.0  # s
    # the first trials run here, and tell whether the others take so long that it is worth starting
    # workers
    for trial in trials:
        took, (result,) = run_block(function, [pickle.dumps(trial)])
        yield pickle.loads(result)
        # of the first, what it took for itself; then the mean of the others
        pace = pace + (took - pace) / taken if taken else max(took - LOADING, 0.0)
        left, taken = left - 1, taken + 1
        processes = min(processes, left)
        # half of what is left at the pace so far, against the start of the workers
        if processes > 1 and pace * left * (1 - 1 / processes) > START:
            with _processes(function, processes, label) as (submit, workers):
                yield from _in_order(submit, workers, trials, left)


def _in_order(
    submit: Submit, workers: Callable[[], int], trials: Iterator, left: float
) -> Iterator:
    """The results of the ``left`` trials, handed out in blocks: single ones, or as many as fill
    BLOCK at the pace of the last.
    """
    waiting: deque[Callable[[], Results]] = deque()
    size = 1
    while True:
        ahead = AHEAD * workers()
        while len(waiting) < ahead:
            most = math.ceil(left / (PARTS * workers())) if left < math.inf else size
            block = [pickle.dumps(trial) for trial in islice(trials, max(1, min(size, most)))]
            if not block:
                break
            left -= len(block)
            waiting.append(submit(block))
        if not waiting:
            return
        for _ in range(1 + len(waiting) // 2):
            seconds, results = waiting.popleft()()
            yield from map(pickle.loads, results)
        size = max(1, int(BLOCK * len(results) / seconds))


@contextmanager
def _processes(
    function: bytes, number: int, label: str
) -> Iterator[tuple[Submit, Callable[[], int]]]:
    # forks of a server that has imported what this process has and computed nothing: a fork of this
    # process would lose the threads that the rendering and BLAS libraries have started here, and a
    # worker that is spawned imports everything anew
    context = get_context("forkserver")
    context.set_forkserver_preload(
        [name for name in sys.modules if name.split(".")[0] == pipeline.__name__]
    )
    pool = ProcessPoolExecutor(number, mp_context=context)
    try:
        yield lambda block: pool.submit(run_block, function, block).result, lambda: number
    except BrokenProcessPool:
        raise ComputeError(
            "a worker process has been ended from outside, as it is where memory runs out; "
            "choose fewer workers, or compute: serial",
            trials=label,
        ) from None
    finally:
        # until the trials that have begun are through: what they write would outlast what their
        # stage cleans up
        pool.shutdown(cancel_futures=True)
