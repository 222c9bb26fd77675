"""The articulation of depth frames, against SciPy's Nelder–Mead on the objective written with
NumPy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from articulation_in_numpy import plain_rank
from depth_scenario import TAKE, record
from scenario import arm, youbot
from scipy.optimize import minimize

from pipeline.perception.articulation import ArticulationOptions, fit_sequence
from pipeline.perception.articulation_end import ENDS, STEP
from pipeline.recordings.depth_sequence import DepthSequence

CONTEST = "Articulation of depth frames, 1500 points each"
pytestmark = pytest.mark.benchmark(group=CONTEST)
LIMIT = 2e-3  # s a frame


@dataclass(frozen=True)
class Frames:
    """The arm's points, frame by frame, and where its end-effector should be."""

    clouds: list[np.ndarray]
    poses: np.ndarray
    options: ArticulationOptions

    @property
    def ee(self) -> np.ndarray:
        return youbot().points(self.poses)[:, 3]


@pytest.fixture
def problem(size, tmp_path) -> Frames:
    """Frames of the synthetic camera."""
    # the objectives of single frames differ either way, by more than their means do
    recording = record(tmp_path, size(120, 3))
    sequence = DepthSequence(
        recording.folder / "kinect" / TAKE, recording.depth, arm(), recording.folder
    )
    clouds = [points for points, _ in sequence.points(range(len(recording.poses)))]
    return Frames(clouds, recording.poses, recording.options)


def by_scipy(problem: Frames) -> list[float]:
    """Least values of the objective: each frame from the fit before, and once more with the simplex
    turned, as ours.
    """
    chain, options = youbot(), problem.options
    bounds = chain.lengths[:, None] * np.array([1 - options.length_range, 1 + options.length_range])
    v, least = chain.points(problem.poses[0])[1:3].ravel(), []
    for cloud, ee in zip(problem.clouds, problem.ee, strict=True):
        for step in (STEP, -STEP):
            corners = v + step * np.vstack([np.zeros(4), np.eye(4)])
            result = minimize(
                plain_rank,
                v,
                (cloud, chain.origin, ee, bounds, options.gamma1, options.gamma2),
                method="Nelder-Mead",
                options={
                    "initial_simplex": corners,
                    "xatol": ENDS["commanded"].runs[-1][-1],
                    "fatol": np.inf,
                },
            )
            v = result.x
        least.append(result.fun)
    return least


# the first frame is left out of the objectives: ours has several starts there
def test_ours(benchmark, problem):
    benchmark.extra_info |= {"role": "ours", "items": len(problem.clouds), "limit": LIMIT}
    stated = (
        problem.clouds,
        youbot().origin,
        problem.ee,
        youbot(),
        problem.options,
        problem.poses[0],
    )
    result = benchmark(fit_sequence, *stated)
    benchmark.extra_info |= {
        "points": float(result.points.mean()),
        "objective": float(result.objective[1:].mean()),
    }
    assert result.points.min() > 1000


# a call takes seconds
@pytest.mark.benchmark(group=CONTEST, min_rounds=2)
def test_scipy(benchmark, problem):
    benchmark.extra_info |= {
        "role": "peer",
        "against": "SciPy",
        "items": len(problem.clouds),
        "target": 20,
    }
    benchmark.extra_info["configuration"] = (
        "Nelder–Mead of `scipy.optimize.minimize`, started from the fit of the frame before with "
        "the same simplex and tolerance as ours; the objective by NumPy, all points at once"
    )
    least = benchmark(by_scipy, problem)
    benchmark.extra_info["objective"] = float(np.mean(least[1:]))
