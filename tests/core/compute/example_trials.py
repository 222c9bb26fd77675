"""Functions of trials that workers can import: what a stage does with a take, and trials that
pause, tell of themselves or fail.
"""

from __future__ import annotations

import os
import signal
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import ArticulationSection
from pipeline.core.rng import stream
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models.model import open_loop
from pipeline.models.wishart.law import WishartModel
from pipeline.perception.articulation import fit_sequence

LINKS = np.array([[0.0, 0.155], [0.135, 0.0], [0.0, 0.17]])
ARM = PlanarChain(
    np.zeros(2), LINKS, np.ones(3), np.full(3, -3.0), np.full(3, 3.0), max_speed=np.ones(3)
)
START = np.array([0.3, -0.4, 0.5])


def filtered(number: int, steps: np.ndarray) -> bytes:
    """The Wishart model's posterior of a take with a few measurements near where it starts."""
    random, t = stream(7, "filter", number), np.arange(0.0, 0.2, 0.03)
    y = START + 0.02 * random.standard_normal((len(t), 3))
    noise = np.tile(4e-4 * np.eye(3), (len(t), 1, 1))
    measured = Measurements(f"take_{number:03d}", t, y, np.zeros_like(y), noise)
    start, options = Start(START, 1e-4 * np.eye(3)), FilterOptions(200, "systematic", 0.5)
    law, command = WishartModel(0.3), open_loop(steps)
    posterior = particle_filter(law, ARM, command, 0.01, start, measured, options, random)
    return np.column_stack([posterior.ess, posterior.mean]).tobytes()


def articulated(number: int) -> bytes:
    """The joint angles of three frames of a take, out of points of the arm."""
    random, clouds, ends = stream(7, "articulate", number), [], []
    for frame in range(3):
        nodes, along = ARM.points(START + 0.01 * frame), random.random((3, 100, 1))
        points = (nodes[:-1, None] * (1 - along) + nodes[1:, None] * along).reshape(-1, 2)
        clouds.append(points + 0.004 * random.standard_normal(points.shape))
        ends.append(nodes[-1])
    options = ArticulationSection(1.0, 1 / 3, 0.05, 50, 3, "commanded", 2)
    return fit_sequence(clouds, ARM.origin, np.array(ends), ARM, options, START).q.tobytes()


def layout(array: np.ndarray, kept: list[int]) -> tuple[int, str, np.ndarray]:
    return kept.pop(), str(array.flags), array[:, :-1]


def pause(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def late(number: int) -> tuple[int, int]:
    time.sleep(0.05)
    return number, os.getpid()


def give_up(number: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def time_out(number: int) -> None:
    raise TimeoutError("of the trial itself")


def begin(number: int, folder: Path) -> None:
    """Leave a file, and fail at the second trial."""
    (folder / str(number)).touch()
    if number == 1:
        raise ConfigError("refused", key="a")
    time.sleep(0.02)


def peak(results: Iterator) -> int:
    """Bytes that are held at once while results are taken and dropped."""
    tracemalloc.start()
    try:
        for _ in results:
            pass
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
