"""Processor time and memory over particles, takes, steps, joints, frames and agents: ``python
tests/benchmarks/cost_growth.py`` writes reports/benchmarks/cost_growth.csv and the figure of it
beside it.
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
from tempfile import TemporaryDirectory

sys.path.append(str(Path(__file__).parents[1]))
sys.path.append(str(Path(__file__).parents[2]))
import pipeline.core.environment  # noqa: F401 - before numpy: it fixes the arithmetic

import numpy as np  # isort: skip
import pandas as pd
from depth_scenario import Recording, record
from growth_figure import draw
from scenario import ROOT, Take, many_joints, take

from pipeline.core.compute.trials import run_trials
from pipeline.core.options.analysis import Compute
from pipeline.figures.style import save
from pipeline.wrench.bounds import Bounds
from pipeline.wrench.study import run_study

OUT = ROOT / "reports/benchmarks"
REPEATS = 2  # of which the shortest time and the least memory are kept
LEAST_MEMORY = 1.0  # MB, below which the allocator decides and not the size
# of the paper's study: T̲ in N, θ̲ in rad, σ_T in N, κ
CABLES = Bounds((1.0, 15.0), (0.0, 2 * np.pi), (0.5, 2.0), (150.0, 2500.0))


def doublings(first: int, count: int) -> tuple[int, ...]:
    """``count`` sizes from ``first`` on, each twice the one before."""
    return tuple(first * 2**k for k in range(count))


SIZES = {
    "particles": doublings(1000, 9),
    "steps": doublings(10, 9),
    "takes": doublings(1, 8),
    "joints": (2, 3, 4, 5, 6, 7, 8, 10, 12),
    "frames": doublings(1, 7),
    "agents": doublings(2, 6),
}
# slope of the time that is not to be passed
LIMITS = {"joints": 3.0}


def call_of(over: str, size: int, recording: Recording) -> Callable[[], object]:
    """What is done with ``size`` of what grows, all that it needs being there."""
    rng = np.random.default_rng(1)
    match over:
        case "particles":
            return partial(take(40).filtered, size, rng)
        case "steps":
            return partial(take(size).filtered, 1000, rng)
        case "joints":
            return partial(take(40, many_joints(size)).filtered, 10_000, rng)
        case "takes":
            trial = partial(_filtered, motion=take(40))
            return partial(
                list, run_trials(trial, range(size), compute=Compute(1), label=f"takes: {size}")
            )
        case "frames":
            return partial(recording.angles, size)
        case "agents":
            return partial(run_study, CABLES, [size], 1000, 1000, 1, rng)


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


def cost(over: str, size: int, recording: Recording) -> tuple[float, float]:
    """Processor time in s, and memory in MB at its peak beyond what was there before, of a call
    that is not the process's first.
    """
    call_of(over, SIZES[over][0], recording)()
    call = call_of(over, size, recording)
    gc.collect()
    # from here on the peak is kept anew
    Path("/proc/self/clear_refs").write_text("5")
    before, begin = megabytes("VmRSS"), time.process_time()
    call()
    return time.process_time() - begin, megabytes("VmHWM") - before


def megabytes(name: str) -> float:
    """One of this process's sizes in /proc/self/status."""
    return int(re.search(rf"{name}:\s+(\d+) kB", Path("/proc/self/status").read_text())[1]) / 1e3


def slope(sizes: Sequence[float], costs: np.ndarray) -> float:
    """Of log cost over log size, by least squares over the larger half of the sizes."""
    half = len(sizes) // 2
    return float(np.polyfit(np.log(sizes[half:]), np.log(costs[half:]), 1)[0])


def main() -> None:
    """Measure, write the table and draw it."""
    rows = []
    with TemporaryDirectory() as folder:
        recording = in_a_process(record, Path(folder), SIZES["frames"][-1])
        for over, sizes in SIZES.items():
            costs = np.array(
                [
                    [in_a_process(cost, over, size, recording) for _ in range(REPEATS)]
                    for size in sizes
                ]
            ).min(axis=1)
            seconds, memory = costs.T
            grows = np.all(memory[len(sizes) // 2 :] > LEAST_MEMORY)
            slopes = {
                "time_slope": slope(sizes, seconds),
                "memory_slope": slope(sizes, memory) if grows else np.nan,
                "time_limit": LIMITS.get(over, np.nan),
            }
            rows += [
                {"over": over, "size": size, "seconds": s, "megabytes": m} | slopes
                for size, s, m in zip(sizes, seconds, memory, strict=True)
            ]
    table = pd.DataFrame(rows)
    OUT.mkdir(exist_ok=True)
    table.round(4).to_csv(OUT / "cost_growth.csv", index=False)
    save(draw(table), OUT, "cost_growth")


if __name__ == "__main__":
    main()
