"""Functions of trials that workers can import: what a stage does with a take, and trials that
pause, tell of themselves or fail.
"""

from __future__ import annotations

import os
import signal
import time
import tracemalloc
from collections.abc import Iterator

import numpy as np
import pandas as pd

from pipeline.arm.chain import PlanarChain
from pipeline.core.rng import stream
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models.model import open_loop
from pipeline.models.wishart.law import WishartModel
from pipeline.perception.articulation import ArticulationOptions, fit_sequence

ARM = PlanarChain(
    origin=np.zeros(2),
    links=np.array([[0.0, 0.155], [0.135, 0.0], [0.0, 0.17]]),
    signs=np.ones(3),
    lower=np.full(3, -3.0),
    upper=np.full(3, 3.0),
    max_speed=np.ones(3),
)
START = np.array([0.3, -0.4, 0.5])


def filtered(number: int, steps: np.ndarray) -> pd.DataFrame:
    """The Wishart model's posterior of a take with a few measurements near where it starts."""
    random, t = stream(7, "filter", number), np.arange(0.0, 0.2, 0.03)
    y = START + 0.02 * random.standard_normal((len(t), 3))
    measured = Measurements(
        f"take_{number:03d}", t, y, np.zeros_like(y), np.tile(4e-4 * np.eye(3), (len(t), 1, 1))
    )
    start = Start(START, 1e-4 * np.eye(3))
    posterior = particle_filter(
        WishartModel(0.3),
        ARM,
        open_loop(steps),
        0.01,
        start,
        measured,
        FilterOptions(200, "systematic", 0.5),
        random,
    )
    columns = {"ess": posterior.ess} | {f"m{j + 1}": posterior.mean[:, j] for j in range(3)}
    return pd.DataFrame(columns).assign(take=number, evidence=posterior.log_evidence)


def articulated(number: int, width: float) -> pd.DataFrame:
    """The joint angles of three frames of a take, out of points of the arm."""
    random = stream(7, "articulate", number)
    clouds, ends = [], []
    for frame in range(3):
        nodes = ARM.points(START + 0.01 * frame)
        along = random.random((3, 100, 1))
        points = (nodes[:-1, None] * (1 - along) + nodes[1:, None] * along).reshape(-1, 2)
        clouds.append(points + width * random.standard_normal(points.shape))
        ends.append(nodes[-1])
    fitted = fit_sequence(
        clouds, ARM.origin, np.array(ends), ARM, ArticulationOptions(min_points=50), START
    )
    return pd.DataFrame(fitted.q).assign(take=number)


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
    raise TimeoutError(f"of trial {number}")


def peak(results: Iterator) -> int:
    """Bytes that are held at once while results are taken and dropped."""
    tracemalloc.start()
    try:
        for _ in results:
            pass
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
