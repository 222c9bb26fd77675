"""Cost of a step: trace or ln det of its covariance, where there is one. The grid holds every pose
of the joints that carries the tip to the path, and no other; the search finds the cheapest way
through a grid of costs.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from planned_arms import LAWS, chain, joint_path, law_cost, path_problem

from pipeline.core.errors import ModelDomainError
from pipeline.models.draws import draw_steps
from pipeline.models.kinds import build_model
from pipeline.planning.motions import cheapest, least_uncertain, way_to
from pipeline.planning.problem import CLOSE, InfeasibleError, Problem, settle, uncertainty
from pipeline.planning.self_motion import curves, grid, spacing_of, stages

WIDE = {"kind": "wishart", "sigma_b": 0.9, "decomposition": "qr_transposed"}
BEYOND = {"kind": "gaussian", "alpha": 0.1, "u": 1e-3}  # no noise at any pose
STEP = np.array([2e-3, 1e-3])


@pytest.mark.parametrize("law", ["gaussian", "qr_transposed", "pivoted_lu"])
def test_it_is_the_trace_and_the_ln_det_of_drawn_steps(law):
    arm, model = chain("planar"), build_model(LAWS[law])
    q, draws = joint_path("planar", 2)[1], 40_000
    drawn, _ = draw_steps(model, arm, np.tile(q, (draws, 1)), STEP, np.random.default_rng(4))
    variances = np.linalg.eigvalsh(np.cov(drawn, rowvar=False))
    trace, log_det = (
        law_cost(law, arm, objective)(q[None], STEP[None])[0] for objective in ("trace", "log_det")
    )
    # of heavy tails, so that a sample's variance is off by some percent
    assert trace == pytest.approx(variances.sum(), rel=0.1)
    rank = 3 if law == "gaussian" else 2
    assert log_det == pytest.approx(np.log(variances[-rank:]).sum(), abs=0.2)
    # the control: by the other rank it would be far from that
    assert abs(log_det - np.log(np.maximum(variances[-(5 - rank) :], 1e-30)).sum()) > 1


def test_a_step_at_rest_costs_the_matrix_models_nothing_and_the_additive_one_its_noise():
    arm, q = chain("planar"), joint_path("planar", 2)
    still = np.zeros((3, 2))
    for objective in ("trace", "log_det"):
        assert law_cost("qr_transposed", arm, objective)(q, still).tolist() == [0, 0, 0]
        assert law_cost("additive", arm, objective)(q, still) == pytest.approx(
            3e-6 if objective == "trace" else 3 * np.log(1e-6)
        )


def test_singular_poses_cost_infinitely_much_and_no_others_whatever_the_blocks(monkeypatch):
    arm = chain("planar")
    cost = law_cost("pivoted_lu", arm)
    q = np.random.default_rng(5).uniform(arm.lower, arm.upper, (300, 3))
    q[::30] = np.nan  # which is refused as a singular pose is
    v = np.random.default_rng(6).uniform(0, 0.01, (300, 2))
    costs = cost(q, v)
    np.testing.assert_array_equal(np.isfinite(costs), ~arm.singular(q))
    assert np.isinf(costs).sum() >= 10
    monkeypatch.setattr("pipeline.planning.problem.BLOCK", 7)
    np.testing.assert_array_equal(cost(q, v), costs)
    assert cost(q[:0], v[:0]).shape == (0,)


def test_a_model_without_a_covariance_is_refused_and_a_step_without_a_ln_det_is_not_taken():
    arm, q, v = chain("planar"), joint_path("planar", 1), np.tile(STEP, (2, 1))
    assert uncertainty(build_model(BEYOND), arm, "trace")(q, v).tolist() == [0, 0]
    assert uncertainty(build_model(BEYOND), arm, "log_det")(q, v).tolist() == [np.inf, np.inf]
    with pytest.raises(ModelDomainError, match="Wishart step exists only for sigma_B below"):
        uncertainty(build_model(WIDE), arm, "trace")(q, v)
    problem = path_problem("planar", 4)
    with pytest.raises(InfeasibleError, match="or none with a ln det"):
        least_uncertain(problem, uncertainty(build_model(BEYOND), arm, "log_det"), 7)


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
    """Stages that a way reaches, the cheapest way, and what it costs."""
    before, total = cheapest(*grid.values())
    last = int(total[-1].argmin())
    return int(np.isfinite(total).any(axis=1).sum()), way_to(last, before).tolist(), total[-1, last]


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


def test_a_turn_is_short_for_a_joint_that_comes_round_alone():
    grid = grids(1, 0.9, 0.0)
    grid["poses"][:], grid["cost"][:], grid["counts"][:] = 0.0, 1.0, POSES
    grid["poses"][1::2, :, 1] = 2 * np.pi
    assert searched(grid)[0] == STAGES
    grid["turning"][1] = False
    assert searched(grid)[0] == 1


SPACING = 0.2


def solutions(task: Problem, step: int, tried: int) -> np.ndarray:
    """Poses at ``step`` that Newton's method finds from random ones, and that are to be kept."""
    chain = task.chain
    begun = np.random.default_rng(3).uniform(chain.lower, chain.upper, (tried, len(chain.lower)))
    left, reached = settle(chain, begun, np.tile(task.path[step], (tried, 1)), 60)
    left = task.nearest_turns(left[reached])
    left = left[chain.within_limits(left)]
    return left[task.clear(left)]


@pytest.mark.parametrize("arm", ["planar", "seven"])
def test_every_solution_lies_between_two_neighbours_of_the_grid(arm, monkeypatch):
    task = path_problem(arm, 4)
    (poses,) = curves(task, np.array([2]), SPACING)
    held = solutions(task, 2, 400)
    assert len(held) > 50
    apart = np.linalg.norm(task.less_turns(held[:, None] - poses), axis=-1).min(axis=1)
    # half a spacing along the curve; where a curve is cut, up to a whole one
    assert np.mean(apart < 0.55 * SPACING) > 0.9
    assert apart.max() < 1.05 * SPACING
    off = task.chain.displacement(task.chain.pose(poses), task.path[2])
    assert np.abs(off).max() < 1e-10
    assert task.chain.within_limits(poses).all()
    assert (task.chain.least_singular_value(poses) >= task.margin).all()
    monkeypatch.setattr("pipeline.planning.self_motion.TOGETHER", 1)
    np.testing.assert_array_equal(curves(task, np.array([2]), SPACING)[0], poses)
    if arm == "seven":
        # the control: the curve of one start alone misses branches
        (poses,) = curves(task, np.array([2]), SPACING, 1)
        apart = np.linalg.norm(task.less_turns(held[:, None] - poses), axis=-1).min(axis=1)
        assert np.mean(apart < SPACING) < 0.7


def test_a_grid_has_about_as_many_points_as_it_is_given():
    task = path_problem("seven", 4)
    poses = grid(task, np.array([0, 2, 4]), spacing_of(task, 300))
    assert 240 < max(len(each) for each in poses) < 360


def test_an_arm_without_joints_to_spare_has_its_branches():
    task = path_problem("square", 4)
    (poses,) = curves(task, np.array([2]), 0.0)
    held = solutions(task, 2, 200)
    apart = np.linalg.norm(held[:, None] - poses, axis=-1)
    assert apart.min(axis=1).max() < 1e-6
    # the elbow up and down, each once
    assert len(poses) == 2
    assert {*apart.argmin(axis=1)} == {0, 1}


def test_stages_lie_as_far_apart_as_a_wide_grid_needs():
    task = path_problem("seven", 100)
    slowest = task.reach.min()
    for spacing, apart in ((0.0, 1), (slowest / 1.6, 1), (10 * slowest / 1.51, 10), (1e9, 100)):
        assert stages(task, spacing).tolist() == list(range(0, 101, apart))


@pytest.mark.parametrize(
    ("changes", "upper", "words"),
    [
        ({}, 9.0, r"does not reach the pose .*\[step 4\]"),
        ({"margin": 5.0}, 9.0, r"least singular value of .* margin of 5 m \[step 0"),
        ({}, 1e-3, r"beyond its joint limits alone \[step 0"),
    ],
)
def test_where_the_path_cannot_be_followed_its_first_step_is_named_and_why(changes, upper, words):
    task = path_problem("planar", 6, **changes)
    chain = replace(task.chain, upper=np.minimum(task.chain.upper, task.chain.lower + upper))
    path = task.path.copy()
    path[4:, 0] += 5.0
    with pytest.raises(InfeasibleError, match=words):
        grid(replace(task, chain=chain, path=path), np.array([0, 6]), SPACING)


def test_the_poses_are_reached_and_a_lane_without_an_inverse_stays_where_it_is():
    arm, q = chain("planar"), joint_path("planar", 20)
    begun, target = q + 0.05, arm.pose(q)
    begun[7] = np.nan  # where no Jacobian has an inverse
    assert arm.singular(begun).tolist() == [lane == 7 for lane in range(21)]
    settled, reached = settle(arm, begun, target, 20)
    assert reached.tolist() == [lane != 7 for lane in range(21)]
    off = np.linalg.norm(arm.displacement(arm.pose(settled), target), axis=-1)
    assert off[reached].max() <= CLOSE
    np.testing.assert_array_equal(settled[7], begun[7])
    # a lane is settled as it would be alone
    alone, _ = settle(arm, begun[3:4], target[3:4], 20)
    np.testing.assert_array_equal(settled[3:4], alone)
    # control: without a round nothing is reached
    assert not settle(arm, begun, target, 0)[1].any()
