"""Growth of processor time and memory: ``python tests/benchmarks/growth.py`` writes
reports/benchmarks/growth.csv. ``--scale [PARTICLES TAKES]`` writes scale.json: a filter of a
million particles, and ten thousand takes.
"""

import gc
import hashlib
import re
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path

# before numpy: it fixes the arithmetic
from contests import (
    RESULTS,
    machine,
    write_results,
)

import numpy as np  # isort: skip
import pandas as pd
from scenario import Take, drawn_takes, take

from pipeline.core.compute.trials import run_trials
from pipeline.core.options.analysis import Compute, Wrench
from pipeline.models.steps import Recorded, process_noise
from pipeline.models.wishart.fit import problem_steps, solve_problems
from pipeline.models.wishart.perturbation import objective_weights
from pipeline.wrench.study import run_study

REPEATS = 2  # of which the shortest time and the least memory are kept
LEAST_MEMORY = 1.0  # MB; less depends on the allocator, not on the size
# of the paper's study: κ, σ_T in N, T̲ in N, θ̲ in rad
CABLES = [150.0, 2500.0], [0.5, 2.0], [1.0, 15.0], [0.0, 2 * np.pi]
SIZES = {
    "particles": [1000 * 2**k for k in range(9)],
    "steps": [10 * 2**k for k in range(9)],
    "takes": [2**k for k in range(8)],
    "joints": [2, 3, 4, 5, 6, 7, 8, 10, 12],
    "agents": [2 * 2**k for k in range(6)],
}
LIMITS = {"joints": 3.0}  # greatest slope of the time
# steps of a take; takes in memory at once
STEPS = 40
BLOCK = 100
POSE = 2e-4  # rad, standard deviation of a measured pose


def call_of(over: str, size: int) -> Callable[[], object]:
    """Return a call whose cost grows with ``size``."""
    rng = np.random.default_rng(1)
    match over:
        case "particles":
            return partial(take(STEPS).filtered, size, rng)
        case "steps":
            return partial(take(size).filtered, 1000, rng)
        case "joints":
            return partial(take(STEPS, size).filtered, 10_000, rng)
        case "agents":
            return partial(run_study, Wrench([size], *CABLES, 1000, 1000, 1, 1), rng)
    trial = partial(posterior_hash, motion=take(STEPS), particles=1000)
    alone = {"compute": Compute(1), "label": "takes"}
    return lambda: list(run_trials(trial, range(size), **alone))


def posterior_hash(number: int, motion: Take, particles: int) -> str:
    """Hash of the posterior of a take under its own stream."""
    posterior = motion.filtered(particles, np.random.default_rng(number))
    content = posterior.mean.tobytes() + posterior.covariance.tobytes()
    return hashlib.sha256(content).hexdigest()


def in_a_process(function: Callable, *arguments: object) -> object:
    """Return ``function(*arguments)`` of a process forked from this one."""
    with get_context("fork").Pool(1) as pool:
        return pool.apply(function, arguments)


def cost(over: str, size: int) -> tuple[float, float]:
    """Processor time in s, and peak memory in MB beyond what the process held before, of a call
    that is not the process's first.
    """
    call_of(over, SIZES[over][0])()
    call = call_of(over, size)
    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # the peak is measured from here on
    before = megabytes("VmRSS")
    begin = time.process_time()
    call()
    return time.process_time() - begin, megabytes("VmHWM") - before


def costs(over: str, sizes: Sequence[int]) -> np.ndarray:
    """(2, S) the least times in s and memories in MB of REPEATS processes for each size."""
    runs = [[in_a_process(cost, over, size) for _ in range(REPEATS)] for size in sizes]
    return np.min(runs, axis=1).T


def megabytes(name: str) -> float:
    """One of this process's sizes in /proc/self/status."""
    status = Path("/proc/self/status").read_text()
    return int(re.search(rf"{name}:\s+(\d+) kB", status)[1]) / 1e3


def slope(sizes: Sequence[int], values: np.ndarray) -> float:
    """Slope of log cost over log size, by least squares over the larger half of the sizes."""
    half = len(sizes) // 2
    return float(np.polyfit(np.log(sizes[half:]), np.log(values[half:]), 1)[0])


def measure_growth() -> None:
    """Measure every size, and write."""
    rows = []
    for over, sizes in SIZES.items():
        seconds, memory = costs(over, sizes)
        grows = np.all(memory[len(sizes) // 2 :] > LEAST_MEMORY)
        row = {
            "over": over,
            "from": sizes[0],
            "to": sizes[-1],
            "seconds_at_most": seconds[-1],
            "time_slope": slope(sizes, seconds),
            "time_limit": LIMITS.get(over, np.nan),
            "memory_slope": slope(sizes, memory) if grows else np.nan,
        }
        rows.append(row)
    pd.DataFrame(rows).round(4).to_csv(RESULTS / "growth.csv", index=False)


def many_particles(many: int) -> dict[str, float]:
    """Time in s and memory in bytes of a particle (and step) at ``many`` and at a hundredth."""
    few = many // 100
    seconds, memory = costs("particles", (few, many))
    times = {
        "seconds_few": seconds[0] / (few * STEPS),
        "seconds_many": seconds[1] / (many * STEPS),
    }
    size = 1e6 * (memory[1] - memory[0]) / (many - few)
    return {"few": few, "many": many} | times | {"bytes_of_a_particle": size}


def many_takes(count: int) -> dict[str, float]:
    """Processor time in s and peak memory in bytes of takes drawn, fitted and filtered block by
    block.
    """
    motion = take(STEPS)
    begin = time.process_time()
    chain, model = motion.scene[:2]
    weights = objective_weights(np.sqrt(2) * POSE, 3)
    for first in range(0, count, BLOCK):
        end = min(first + BLOCK, count)
        rng = np.random.default_rng(first)
        q, v = drawn_takes(motion.scene, end - first, STEPS, POSE, rng)
        noise = process_noise(chain, q, v)
        recorded = Recorded(chain, q[:, :-1], v, noise, ())
        steps = problem_steps(recorded, model.decomposition)
        solve_problems(steps, weights, 0.2)
        for number in range(first, end):
            motion.filtered(1000, np.random.default_rng(number))
    seconds = time.process_time() - begin
    return {
        "takes": count,
        "seconds": seconds,
        "peak_bytes": 1e6 * megabytes("VmHWM"),
    }


def measure_scale(particles: int = 1_000_000, takes: int = 10_000) -> None:
    """Measure, and write."""
    many_takes(1)  # loads compiled code, which the processes below inherit
    few, many = (in_a_process(many_takes, count) for count in (takes // 10, takes))
    measured = {"machine": machine(), "particles": many_particles(particles)}
    write_results("scale", measured | {"takes": {"few": few, "many": many}})


if __name__ == "__main__":
    if sys.argv[1:2] == ["--scale"]:
        measure_scale(*map(int, sys.argv[2:]))
    else:
        measure_growth()
