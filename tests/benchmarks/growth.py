"""Processor time and memory over particles, takes, steps, joints and agents: ``python
tests/benchmarks/growth.py`` writes reports/benchmarks/growth.csv.
"""

from __future__ import annotations

import gc
import re
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]
import pipeline.core.environment  # noqa: F401 - before numpy: it fixes the arithmetic

import numpy as np  # isort: skip
import pandas as pd
from scenario import ROOT, Take, many_joints, take

from pipeline.core.compute.trials import run_trials
from pipeline.core.options.analysis import Compute
from pipeline.wrench.bounds import Bounds
from pipeline.wrench.study import run_study

OUT = ROOT / "reports/benchmarks/growth.csv"
REPEATS = 2  # of which the shortest time and the least memory are kept
LEAST_MEMORY = 1.0  # MB; less depends on the allocator, not on the size
# of the paper's study: T̲ in N, θ̲ in rad, σ_T in N, κ
CABLES = Bounds((1.0, 15.0), (0.0, 2 * np.pi), (0.5, 2.0), (150.0, 2500.0))
SIZES = {
    "particles": [1000 * 2**k for k in range(9)],
    "steps": [10 * 2**k for k in range(9)],
    "takes": [2**k for k in range(8)],
    "joints": [2, 3, 4, 5, 6, 7, 8, 10, 12],
    "agents": [2 * 2**k for k in range(6)],
}
LIMITS = {"joints": 3.0}  # greatest slope of the time


def call_of(over: str, size: int) -> Callable[[], object]:
    """A call whose cost grows with ``size``."""
    rng = np.random.default_rng(1)
    match over:
        case "particles":
            return partial(take(40).filtered, size, rng)
        case "steps":
            return partial(take(size).filtered, 1000, rng)
        case "joints":
            return partial(take(40, many_joints(size)).filtered, 10_000, rng)
        case "agents":
            return partial(run_study, CABLES, [size], 1000, 1000, 1, rng)
    trials = partial(_filtered, motion=take(40)), range(size)
    return lambda: list(run_trials(*trials, compute=Compute(1), label=f"{over}: {size}"))


def _filtered(number: int, motion: Take) -> np.ndarray:
    return motion.filtered(1000, np.random.default_rng(number)).mean


def in_a_process(function: Callable, *arguments: object) -> object:
    """``function(*arguments)`` of a process that starts as this one is now."""
    here, there = get_context("fork").Pipe(duplex=False)
    process = get_context("fork").Process(target=_answer, args=(there, function, arguments))
    process.start()
    there.close()
    try:
        return here.recv()
    finally:
        process.join()


def _answer(there: Connection, function: Callable, arguments: tuple) -> None:
    there.send(function(*arguments))


def cost(over: str, size: int) -> tuple[float, float]:
    """Processor time in s, and memory in MB at its peak beyond what was there before, of a call
    that is not the process's first.
    """
    call_of(over, SIZES[over][0])()
    call = call_of(over, size)
    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # the peak is measured from here on
    before, begin = megabytes("VmRSS"), time.process_time()
    call()
    return time.process_time() - begin, megabytes("VmHWM") - before


def megabytes(name: str) -> float:
    """One of this process's sizes in /proc/self/status."""
    return int(re.search(rf"{name}:\s+(\d+) kB", Path("/proc/self/status").read_text())[1]) / 1e3


def slope(sizes: Sequence[float], costs: np.ndarray) -> float:
    """Slope of log cost over log size, by least squares over the larger half of the sizes."""
    half = len(sizes) // 2
    return float(np.polyfit(np.log(sizes[half:]), np.log(costs[half:]), 1)[0])


def main() -> None:
    """Measure and write."""
    rows = []
    for over, sizes in SIZES.items():
        runs = [[in_a_process(cost, over, size) for _ in range(REPEATS)] for size in sizes]
        seconds, memory = np.min(runs, axis=1).T
        grows = np.all(memory[len(sizes) // 2 :] > LEAST_MEMORY)
        row = {"over": over, "from": sizes[0], "to": sizes[-1], "seconds_at_most": seconds[-1]}
        row |= {"time_slope": slope(sizes, seconds), "time_limit": LIMITS.get(over, np.nan)}
        rows.append(row | {"memory_slope": slope(sizes, memory) if grows else np.nan})
    pd.DataFrame(rows).round(4).to_csv(OUT, index=False)


if __name__ == "__main__":
    main()
