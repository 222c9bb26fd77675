"""The search finds what trying every way finds, and says where no way leads on."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest

from pipeline.planning.motions import cheapest, way_to

STAGES, POSES, JOINTS = 5, 4, 2


def grids(seed: int, reach: float, weight: float) -> dict:
    rng = np.random.default_rng(seed)
    cost = rng.uniform(size=(STAGES, POSES))
    cost[rng.uniform(size=cost.shape) < 0.1] = np.inf
    return {
        "poses": rng.uniform(-1, 1, (STAGES, POSES, JOINTS)),
        "counts": rng.integers(2, POSES + 1, STAGES),
        "cost": cost,
        "nominal": rng.uniform(-0.2, 0.2, (STAGES - 1, POSES, JOINTS)),
        "reach": np.full((STAGES - 1, JOINTS), reach),
        "weight": np.full(STAGES - 1, weight),
        "turning": np.array([False, True]),
    }


def searched(grid: dict) -> tuple[int, list[int], float]:
    before, total = np.zeros((STAGES, POSES), dtype=np.int64), np.full((STAGES, POSES), np.inf)
    reached = cheapest(*grid.values(), before, total)
    last = int(total[-1].argmin())
    return reached, way_to(last, before).tolist(), total[-1, last]


def every_way(grid: dict, stages: int = STAGES) -> dict[tuple[int, ...], float]:
    """What each way to the last of ``stages`` costs."""
    costs = {}
    for way in product(*(range(count) for count in grid["counts"][:stages])):
        total = sum(grid["cost"][s, i] for s, i in enumerate(way))
        for s, (i, j) in enumerate(pairwise(way)):
            step = grid["poses"][s + 1, j] - grid["poses"][s, i]
            step[1] -= 2 * np.pi * np.round(step[1] / (2 * np.pi))
            if np.any(np.abs(step) > grid["reach"][s]):
                total = np.inf
            total += grid["weight"][s] * np.sum((step - grid["nominal"][s, i]) ** 2)
        costs[way] = total
    return costs


@pytest.mark.parametrize("reach", [0.9, np.inf])
@pytest.mark.parametrize("weight", [0.0, 0.5])
def test_the_optimum_is_that_of_trying_every_way(reach, weight):
    solved = 0
    for seed in range(20):
        grid = grids(seed, reach, weight)
        costs, (reached, chosen, total) = every_way(grid), searched(grid)
        best = min(costs, key=costs.get)
        assert (reached == STAGES) == np.isfinite(costs[best])
        if reached == STAGES:
            assert (tuple(chosen), total) == (best, pytest.approx(costs[best], rel=1e-12))
            solved += 1
        else:  # the stage is the first that no way reaches
            assert not np.isfinite(list(every_way(grid, reached + 1).values())).any()
            assert reached == 0 or np.isfinite(list(every_way(grid, reached).values())).any()
    assert solved > 5


def test_the_cheapest_pose_at_every_stage_is_no_way():
    # the control: without the steps between them the poses would be others
    grid = grids(1, np.inf, 0.5)
    held = np.arange(POSES) < grid["counts"][:, None]
    alone = np.where(held, grid["cost"], np.inf).argmin(axis=1)
    assert searched(grid)[1] != alone.tolist()


def test_a_turn_is_short_for_a_joint_that_comes_round_alone():
    grid = grids(1, 0.9, 0.0)
    grid["poses"][:], grid["cost"][:], grid["counts"][:] = 0.0, 1.0, POSES
    grid["poses"][1::2, :, 1] = 2 * np.pi
    assert searched(grid)[0] == STAGES
    grid["turning"][1] = False
    assert searched(grid)[0] == 1
