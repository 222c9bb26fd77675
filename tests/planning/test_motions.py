"""A planned motion is the best there is and keeps what it has to, or its first failing step is
named; cost of a step; the grid holds every pose that carries the tip to the path, and no other.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from planning_arms import LAWS, chain, joint_path, law_cost, path_problem

from pipeline.core.errors import ConfigError, ModelDomainError
from pipeline.models.draws import draw_steps
from pipeline.models.kinds import build_model
from pipeline.planning import motions
from pipeline.planning.motions import (
    best_conditioned,
    cheapest_paths,
    least_uncertain,
    minimum_norm,
)
from pipeline.planning.problem import (
    Cost,
    InfeasibleError,
    Problem,
    settle,
    uncertainty,
)
from pipeline.planning.self_motion import curves, grid, spacing_of


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
    way, least = cheapest_paths(problem, cost, every, small)[0]
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
    [
        *(("trace", law) for law in LAWS if law != "additive"),
        ("log_det", "qr_transposed"),
    ],
)
def test_under_every_model_a_motion_is_refined_beyond_its_grid_and_keeps_everything(
    law, objective_, monkeypatch
):
    problem = path_problem("planar", 48, margin=0.05)
    cost = law_cost(law, problem.chain, objective_)
    planned = least_uncertain(problem, cost, 100)
    assert problem.failure(planned.joints) is None
    assert planned.clearance.min() >= 0.05
    assert planned.objective == pytest.approx(value(problem, cost, planned.joints))
    driven = value(problem, cost, joint_path("planar", 48))
    assert planned.objective < driven
    # the motion through the grid's best poses is worse
    monkeypatch.setattr(motions, "refine", lambda problem, cost, joints: joints)
    try:
        gain = least_uncertain(problem, cost, 100).objective - planned.objective
        assert gain > 1e-5 * abs(planned.objective)
    except InfeasibleError:
        pass
    # no motion near by is better: nudged along the self-motion it costs as much or more
    tangent = np.linalg.svd(problem.chain.jacobian(planned.joints))[2][:, -1]
    tangent *= np.sign(tangent @ tangent[0])[:, None]
    bump = np.sin(np.linspace(0, np.pi, 49))[:, None]
    for size in (-0.02, 0.02):
        near, _ = settle(
            problem.chain, planned.joints + size * bump * tangent, problem.path, 20
        )
        change = value(problem, cost, near) - planned.objective
        assert change > -1e-5 * abs(driven - planned.objective) or problem.failure(near)


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
    assert all(
        manipulability(best.joints) > manipulability(other) + 1 for other in others
    )
    assert -best.cost.sum() == pytest.approx(manipulability(best.joints))


def test_the_least_norm_motion_never_moves_in_the_null_space():
    problem = path_problem("planar", 200)
    planned = minimum_norm(problem, joint_path("planar", 1)[0])
    assert problem.failure(planned.joints) is None
    in_null_space = replace(problem, smoothness=1.0).objective(
        np.zeros(200), planned.joints
    )
    # what a step of a straight line leaves to Newton's method
    assert in_null_space < 0.01 * planned.objective
    assert planned.objective == pytest.approx(
        np.sum(np.diff(planned.joints, axis=0) ** 2)
    )


def test_the_least_norm_motion_names_the_step_at_which_it_leaves_the_limits():
    problem = path_problem("planar", 40)
    object.__setattr__(problem.chain, "upper", joint_path("planar", 40)[20] + [9, 9, 0])
    with pytest.raises(InfeasibleError, match=r"leaves the joint limits \[step \d+\]"):
        minimum_norm(problem, joint_path("planar", 1)[0])


@pytest.mark.parametrize(
    ("arm", "changes", "error", "words"),
    [
        (
            "planar",
            {"rate": 2e3},
            InfeasibleError,
            r"speed limits; .* \[step 20, after 0\]",
        ),
        ("two spare", {}, ConfigError, "2 joints more than the task has rows"),
        (
            "planar",
            {"margin": 0.0},
            ConfigError,
            "margin must be finite and positive, not 0.0",
        ),
    ],
)
def test_a_problem_without_a_plan_is_refused(arm, changes, error, words):
    with pytest.raises(error, match=words):
        problem = path_problem(arm, 20, **changes)
        least_uncertain(problem, law_cost("gaussian", problem.chain), 40)


WIDE = {"kind": "wishart", "sigma_b": 0.9, "decomposition": "qr_transposed"}
BEYOND = {"kind": "gaussian", "alpha": 0.1, "u": 1e-3}  # no noise at any pose
STEP = np.array([2e-3, 1e-3])


@pytest.mark.parametrize("law", ["gaussian", "qr_transposed", "pivoted_lu"])
def test_the_cost_of_a_step_is_the_trace_and_the_ln_det_of_drawn_steps(law):
    arm, model = chain("planar"), build_model(LAWS[law])
    q, draws = joint_path("planar", 2)[1], 40_000
    drawn, _ = draw_steps(
        model, arm, np.tile(q, (draws, 1)), STEP, np.random.default_rng(4)
    )
    variances = np.linalg.eigvalsh(np.cov(drawn, rowvar=False))
    trace, log_det = (
        law_cost(law, arm, objective)(q[None], STEP[None])[0]
        for objective in ("trace", "log_det")
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


def test_singular_poses_cost_infinitely_much_and_no_others():
    arm = chain("planar")
    cost = law_cost("pivoted_lu", arm)
    q = np.random.default_rng(5).uniform(arm.lower, arm.upper, (300, 3))
    q[::30] = np.nan  # which is refused as a singular pose is
    v = np.random.default_rng(6).uniform(0, 0.01, (300, 2))
    costs = cost(q, v)
    np.testing.assert_array_equal(np.isfinite(costs), ~arm.singular(q))
    assert np.isinf(costs).sum() >= 10


def test_a_model_without_a_covariance_is_refused_and_a_step_without_a_ln_det_is_not_taken():
    arm, q, v = chain("planar"), joint_path("planar", 1), np.tile(STEP, (2, 1))
    assert uncertainty(build_model(BEYOND), arm, "trace")(q, v).tolist() == [0, 0]
    assert uncertainty(build_model(BEYOND), arm, "log_det")(q, v).tolist() == [
        np.inf,
        np.inf,
    ]
    with pytest.raises(
        ModelDomainError, match="Wishart step exists only for sigma_B below"
    ):
        uncertainty(build_model(WIDE), arm, "trace")(q, v)
    problem = path_problem("planar", 4)
    with pytest.raises(InfeasibleError, match="no covariance or a singular one"):
        least_uncertain(problem, uncertainty(build_model(BEYOND), arm, "log_det"), 7)


SPACING = 0.2


def solutions(task: Problem, step: int, tried: int) -> np.ndarray:
    """Poses at ``step`` that Newton's method finds from random ones, and that are to be kept."""
    chain = task.chain
    begun = np.random.default_rng(3).uniform(
        chain.lower, chain.upper, (tried, len(chain.lower))
    )
    left, reached = settle(chain, begun, np.tile(task.path[step], (tried, 1)), 60)
    left = task.nearest_turns(left[reached])
    left = left[chain.within_limits(left)]
    return left[task.clear(left)]


@pytest.mark.parametrize("arm", ["planar", "seven"])
def test_every_solution_lies_between_two_neighbours_of_the_grid(arm):
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
    if arm == "seven":
        # the control: the curve of one start alone misses branches
        (poses,) = curves(task, np.array([2]), SPACING, 1)
        apart = np.linalg.norm(task.less_turns(held[:, None] - poses), axis=-1).min(
            axis=1
        )
        assert np.mean(apart < SPACING) < 0.7


@pytest.mark.parametrize(
    ("changes", "upper", "words"),
    [
        ({}, 9.0, r"does not reach the pose .*\[step 4\]"),
        ({"margin": 5.0}, 9.0, r"margin of 5 m.*\[step 0"),
        ({}, 1e-3, r"does not reach the pose .*\[step 0"),
    ],
)
def test_where_the_path_cannot_be_followed_its_first_step_is_named(
    changes, upper, words
):
    task = path_problem("planar", 6, **changes)
    chain = replace(
        task.chain, upper=np.minimum(task.chain.upper, task.chain.lower + upper)
    )
    path = task.path.copy()
    path[4:, 0] += 5.0
    with pytest.raises(InfeasibleError, match=words):
        grid(replace(task, chain=chain, path=path), np.array([0, 6]), SPACING)
