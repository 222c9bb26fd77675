"""Where trials run: in this process or in worker processes, with the same results in the same order."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from tqdm import tqdm


def run_trials(function: Callable, trials: Iterable, *, workers: int, label: str) -> list:
    """``[function(trial) for trial in trials]``, spread over ``workers`` processes (0: one per available core).

    ``function`` and the trials are pickled; order and values do not depend on ``workers``. A person at a terminal sees a
    bar with an estimate of what is left, a log sees one line. An exception of any trial stops the rest and is raised here.
    """
    trials = list(trials)
    workers = min(workers or len(os.sched_getaffinity(0)), len(trials))
    watched = sys.stderr.isatty()
    progress = {"total": len(trials), "desc": label, "disable": not watched, "unit": "trial"}
    if workers <= 1:
        results = [function(trial) for trial in tqdm(trials, **progress)]
    else:
        # spawn, not fork: the rendering and BLAS libraries start threads that a fork would lose
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            try:
                results = list(tqdm(pool.map(function, trials), **progress))
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    if not watched:
        print(f"{label}: {len(trials)} done", flush=True)
    return results
