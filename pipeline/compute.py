"""Where trials run: in this process or in worker processes, with the same results in the same order."""

from __future__ import annotations

import os
import pickle
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from tqdm import tqdm

START = 2.0  # s, about what it takes until worker processes have imported what they need


def run_trials(function: Callable, trials: Iterable, *, workers: int, label: str) -> list:
    """``[function(trial) for trial in trials]``, spread over ``workers`` processes (0: one per available core).

    ``function`` and the trials are pickled; order and values do not depend on ``workers``. The first trials run here, and tell whether
    the others take so long that it is worth starting workers. A person at a terminal sees a bar with an estimate of what is left, a log
    sees one line. An exception of any trial stops the rest and is raised here.
    """
    trials = list(trials)
    workers = min(workers or len(os.sched_getaffinity(0)), len(trials))
    watched = sys.stderr.isatty()
    results: list = []
    with tqdm(total=len(trials), desc=label, disable=not watched, unit="trial") as progress:

        def done(result: object) -> None:
            results.append(result)
            progress.update()

        begin = time.perf_counter()
        for trial in trials:
            left, elapsed = len(trials) - len(results), time.perf_counter() - begin
            # half of what is left at the pace so far, against the start of the workers
            if workers > 1 and results and elapsed / len(results) * left * (1 - 1 / workers) > START:
                break
            # as a worker is given them: arrays come out laid out anew, and the last bit of a sum follows the layout
            copied, argument = pickle.loads(pickle.dumps((function, trial)))
            done(copied(argument))
        if len(results) < len(trials):
            # spawn, not fork: the rendering and BLAS libraries start threads that a fork would lose
            with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
                try:
                    for result in pool.map(function, trials[len(results) :]):
                        done(result)
                except BaseException:
                    pool.shutdown(wait=False, cancel_futures=True)
                    raise
    if not watched:
        print(f"{label}: {len(trials)} done", flush=True)
    return results
