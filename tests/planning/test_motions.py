"""A planned motion is the best there is and keeps what it has to, or its first failing step is
named.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from planned_arms import LAWS, joint_path, law_cost, path_problem

from pipeline.core.errors import ConfigError
from pipeline.planning.motions import best_conditioned, least_uncertain, minimum_norm, on_stages
from pipeline.planning.problem import Cost, InfeasibleError, Problem, settle
from pipeline.planning.self_motion import grid, spacing_of


def value(problem: Problem, cost: Cost, joints: np.ndarray) -> float:
    return problem.objective(cost(joints[:-1], problem.steps), joints)


def trying_every_motion(problem: Problem, cost: Cost, poses: list[np.ndarray]) -> float:
    """The least objective of all motions through ``poses``, one at a step."""
    best = np.inf
    for motion in product(*poses):
        joints = np.array(motion)
        if np.all(np.abs(np.diff(joints, axis=0)) <= problem.reach):
            best = min(best, value(problem, cost, joints))
    return best


@pytest.mark.parametrize("law", ["gaussian", "pivoted_lu"])
@pytest.mark.parametrize("smoothness", [0.0, 1e-2])
def test_on_a_small_grid_the_optimum_is_that_of_trying_every_motion(law, smoothness):
    problem = path_problem("planar", 4, smoothness=smoothness)
    cost, every = law_cost(law, problem.chain), np.arange(5)
    small = grid(problem, every, spacing_of(problem, 7))
    assert min(len(poses) for poses in small) > 3
    way, least = on_stages(problem, cost, every, small)[0]
    assert least == pytest.approx(trying_every_motion(problem, cost, small), rel=1e-12)
    assert value(problem, cost, way) == pytest.approx(least, rel=1e-12)
    # the control: the cheapest pose of each step alone is another motion, or too fast a one
    single = [
        q[cost(q, np.tile(v, (len(q), 1))).argmin()]
        for q, v in zip(small, problem.steps, strict=False)
    ]
    assert not np.array_equal(single, way[:-1])


@pytest.mark.parametrize(
    ("objective_", "law"),
    [*(("trace", law) for law in LAWS if law != "additive"), ("log_det", "qr_transposed")],
)
def test_under_every_model_a_motion_is_refined_beyond_its_grid_and_keeps_everything(
    law, objective_
):
    problem = path_problem("planar", 48, margin=0.05)
    cost = law_cost(law, problem.chain, objective_)
    planned = least_uncertain(problem, cost, 100)
    assert problem.failure(planned.joints) is None
    assert planned.clearance.min() >= 0.05
    assert planned.objective == pytest.approx(value(problem, cost, planned.joints))
    driven = value(problem, cost, joint_path("planar", 48))
    assert planned.objective < driven
    # no motion near by is better: nudged along the self-motion it costs as much or more
    tangent = np.linalg.svd(problem.chain.jacobian(planned.joints))[2][:, -1]
    tangent *= np.sign(tangent @ tangent[0])[:, None]
    bump = np.sin(np.linspace(0, np.pi, 49))[:, None]
    for size in (-0.02, 0.02):
        near, _ = settle(problem.chain, planned.joints + size * bump * tangent, problem.path, 20)
        change = value(problem, cost, near) - planned.objective
        assert change > -1e-4 * abs(driven - planned.objective) or problem.failure(near)


def test_the_weight_of_smoothness_makes_the_null_space_still():
    def null_speed(smoothness: float) -> float:
        problem = path_problem("planar", 48, smoothness=smoothness)
        joints = least_uncertain(problem, law_cost("gaussian", problem.chain), 60).joints
        none = np.zeros(len(joints) - 1)
        return replace(problem, smoothness=1.0).objective(none, joints)

    rough, smooth = null_speed(1e-4), null_speed(1e3)
    assert smooth < 0.1 * rough


def test_of_the_branches_of_a_square_arm_the_cheaper_is_taken():
    problem = path_problem("square", 40, smoothness=0.0)
    cost = law_cost("qr_transposed", problem.chain)
    planned = least_uncertain(problem, cost)
    costs = []
    for start in grid(problem, np.array([0, 40]), 0.0)[0]:
        motion = [start]
        for pose in problem.path[1:]:
            motion.append(settle(problem.chain, motion[-1][None], pose[None], 30)[0][0])
        failure = problem.failure(np.array(motion))
        costs.append(np.inf if failure else value(problem, cost, np.array(motion)))
    assert len(costs) == 2
    assert planned.objective == pytest.approx(min(costs), rel=1e-9)


def test_the_best_conditioned_motion_is_better_conditioned_than_the_others():
    problem = path_problem("planar", 40)
    best = best_conditioned(problem, 80)

    def manipulability(joints: np.ndarray) -> float:
        jacobian = problem.chain.jacobian(joints[:-1])
        return np.log(np.linalg.det(jacobian @ np.swapaxes(jacobian, -1, -2))).sum() / 2

    others = (
        joint_path("planar", 40),
        least_uncertain(problem, law_cost("gaussian", problem.chain), 80).joints,
    )
    assert all(manipulability(best.joints) > manipulability(other) + 1 for other in others)
    assert -best.cost.sum() == pytest.approx(manipulability(best.joints))


def test_the_least_norm_motion_never_moves_in_the_null_space():
    problem = path_problem("planar", 200)
    planned = minimum_norm(problem, joint_path("planar", 1)[0])
    assert problem.failure(planned.joints) is None
    in_null_space = replace(problem, smoothness=1.0).objective(np.zeros(200), planned.joints)
    # what a step of a straight line leaves to Newton's method
    assert in_null_space < 0.01 * planned.objective
    assert planned.objective == pytest.approx(np.sum(np.diff(planned.joints, axis=0) ** 2))


@pytest.mark.slow
def test_an_arm_in_space_moves_with_less_uncertainty_than_it_was_driven():
    problem = path_problem("seven", 60, smoothness=1e-4)
    cost = law_cost("qr_transposed", problem.chain)
    planned = least_uncertain(problem, cost, 100)
    assert problem.failure(planned.joints) is None
    assert planned.objective < value(problem, cost, joint_path("seven", 60))


def test_the_least_norm_motion_names_the_step_at_which_it_leaves_the_limits():
    problem = path_problem("planar", 40)
    object.__setattr__(problem.chain, "upper", joint_path("planar", 40)[20] + [9, 9, 0])
    with pytest.raises(InfeasibleError, match=r"leaves the joint limits \[step \d+\]"):
        minimum_norm(problem, joint_path("planar", 1)[0])


@pytest.mark.parametrize(
    ("arm", "changes", "error", "words"),
    [
        ("planar", {"rate": 2e3}, InfeasibleError, r"joints' speeds; .* \[step 20, after 0\]"),
        ("two spare", {}, ConfigError, "2 joints more than the task has rows"),
        ("planar", {"margin": 0.0}, ConfigError, "margin must be finite and positive, not 0.0"),
    ],
)
def test_a_problem_without_a_plan_is_refused(arm, changes, error, words):
    with pytest.raises(error, match=words):
        problem = path_problem(arm, 20, **changes)
        least_uncertain(problem, law_cost("gaussian", problem.chain), 40)
