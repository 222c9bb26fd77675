"""The least uncertain motion of an arm of seven joints: the search, and the grid with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from planned_arms import chain, joint_path, law_cost

from pipeline.planning.motions import on_stages
from pipeline.planning.problem import Problem
from pipeline.planning.search import cheapest, way_to
from pipeline.planning.self_motion import grid, spacing_of

STEPS, POINTS = 320, 200
LIMIT = 2.0  # s, grid, costs and search
TARGET = 20  # times as fast as the search in plain NumPy
WEIGHT = 1e-2  # of smoothness


@dataclass(frozen=True)
class Searched:
    """What the search is handed: poses (S, G, n), their counts and costs, nominal steps."""

    poses: np.ndarray
    counts: np.ndarray
    cost: np.ndarray
    nominal: np.ndarray
    reach: np.ndarray


def task(steps: int) -> Problem:
    """A path so slow that each of its steps is a stage of the search."""
    arm = chain("seven")
    return Problem(arm, arm.pose(joint_path("seven", steps)), 2.0, 0.02, WEIGHT)


def ready(problem: Problem, points: int) -> Searched:
    every = np.arange(len(problem.path))
    solutions = grid(problem, every, spacing_of(problem, points)).poses
    counts, cost = np.array([len(q) for q in solutions]), law_cost("qr_transposed", problem.chain)
    size, joints = counts.max(), len(problem.chain.lower)
    poses, own = np.zeros((len(solutions), size, joints)), np.full((len(solutions), size), np.inf)
    nominal = np.zeros((len(solutions) - 1, size, joints))
    for s, q in enumerate(solutions):
        poses[s, : len(q)], own[s, : len(q)] = q, 0.0
        if s < len(nominal):
            own[s, : len(q)] = cost(q, np.tile(problem.steps[s], (len(q), 1)))
            nominal[s, : len(q)] = np.matvec(problem.chain.inverse_jacobian(q), problem.steps[s])
    return Searched(poses, counts, own, nominal, np.tile(problem.reach, (len(nominal), 1)))


def compiled(given: Searched) -> float:
    before = np.zeros(given.cost.shape, dtype=np.int64)
    total, weight = np.full(given.cost.shape, np.inf), np.full(len(given.nominal), WEIGHT)
    turning = np.zeros(given.poses.shape[-1], dtype=bool)
    parts = (given.poses, given.counts, given.cost, given.nominal, given.reach, weight, turning)
    assert cheapest(*parts, before, total) == len(given.counts)
    way_to(int(total[-1].argmin()), before)
    return float(total[-1].min())


def plain(given: Searched) -> float:
    """The same by whole arrays: every pose of a stage against every one of the next."""
    total, before = given.cost[0], []
    for s in range(len(given.nominal)):
        step = given.poses[s + 1][None] - given.poses[s][:, None]
        allowed = np.all(np.abs(step) <= given.reach[s], axis=-1)
        step -= given.nominal[s][:, None]
        change = np.where(allowed, WEIGHT * np.einsum("ijk,ijk->ij", step, step), np.inf)
        change += total[:, None]
        before.append(change.argmin(axis=0))
        total = change[before[-1], np.arange(len(total))] + given.cost[s + 1]
    way = [int(total.argmin())]
    for row in reversed(before):
        way.append(int(row[way[-1]]))
    return float(total.min())


@pytest.fixture
def given(size) -> Searched:
    return ready(task(size(STEPS, 6)), size(POINTS, 60))


@pytest.mark.benchmark(group="Planning, the search over 320 steps of 200 points, seven joints")
def test_ours(benchmark, given):
    benchmark.extra_info |= {"role": "ours", "items": 1}
    benchmark.extra_info["objective"] = benchmark(compiled, given)


@pytest.mark.benchmark(group="Planning, the search over 320 steps of 200 points, seven joints")
def test_numpy(benchmark, given):
    benchmark.extra_info |= {"role": "peer", "items": 1, "target": TARGET, "against": "plain NumPy"}
    benchmark.extra_info["configuration"] = "the same search, each stage's moves by NumPy at once"
    benchmark.extra_info["objective"] = benchmark(plain, given)
    assert benchmark.extra_info["objective"] == pytest.approx(compiled(given), rel=1e-12)


@pytest.mark.benchmark(group="Planning, grid, costs and search over 320 steps of 200 points")
def test_ours_as_a_whole(benchmark, size):
    problem, points = task(size(STEPS, 6)), size(POINTS, 60)
    benchmark.extra_info |= {"role": "ours", "items": 1, "limit": LIMIT}

    def whole() -> float:
        every, spacing = np.arange(len(problem.path)), spacing_of(problem, points)
        chosen = grid(problem, every, spacing)
        return on_stages(problem, law_cost("qr_transposed", problem.chain), chosen)[0][1]

    assert np.isfinite(benchmark(whole))
