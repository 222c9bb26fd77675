"""What the paper's sketch of motion planning says, and what the models make of it."""

from __future__ import annotations

import numpy as np
import pytest
from planned_arms import LAWS, law_cost, path_problem

from pipeline.models.kinds import build_model
from pipeline.models.model import frobenius
from pipeline.planning.motions import best_conditioned, least_uncertain, on_stages
from pipeline.planning.problem import Problem
from pipeline.planning.self_motion import grid, spacing_of


def summed(problem: Problem, law: str, joints: np.ndarray) -> np.ndarray:
    """(n, n) Σ Cov of the motion ``joints`` (M+1, n)."""
    model = build_model(LAWS[law])
    return model.covariance(problem.chain, joints[:-1], problem.steps).sum(axis=0)


def test_of_two_motions_neither_has_the_lesser_sum_and_trace_and_determinant_disagree():
    problem = path_problem("planar", 40, smoothness=1e-6)
    by_trace, by_det = (
        least_uncertain(problem, law_cost("pivoted_lu", problem.chain, objective), 80).joints
        for objective in ("trace", "log_det")
    )
    one, other = (summed(problem, "pivoted_lu", joints) for joints in (by_trace, by_det))
    difference = np.linalg.eigvalsh(other - one)
    scale = np.abs(difference).max()
    assert difference[0] < -1e-3 * scale < 1e-3 * scale < difference[-1]
    for objective, better, worse in (("trace", by_trace, by_det), ("log_det", by_det, by_trace)):
        cost = law_cost("pivoted_lu", problem.chain, objective)
        here, there = (cost(q[:-1], problem.steps).sum() for q in (better, worse))
        assert here < there - 1e-4 * abs(there)


@pytest.mark.slow
def test_the_least_uncertain_motion_of_the_gaussian_model_goes_where_the_arm_is_worst_conditioned():
    problem = path_problem("planar", 24, smoothness=0.0)

    def worst_conditioned(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -(frobenius(problem.chain.inverse_jacobian(q)) ** 2) * np.vecdot(v, v)

    gaussian = law_cost("gaussian", problem.chain)
    steps = np.arange(0, 25, 3)
    poses = grid(problem, steps, spacing_of(problem, 50))
    ways = [on_stages(problem, cost, steps, poses)[0][0] for cost in (gaussian, worst_conditioned)]
    np.testing.assert_array_equal(*ways)
    uncertain = least_uncertain(problem, gaussian, 50)
    dexterous = best_conditioned(problem, 50)
    assert dexterous.clearance.mean() > 1.2 * uncertain.clearance.mean()
    # the control: under the Wishart model it is another motion, and a better conditioned one
    other = least_uncertain(problem, law_cost("qr_transposed", problem.chain), 50)
    assert other.clearance.mean() > uncertain.clearance.mean()


@pytest.mark.slow
def test_under_the_wishart_model_by_qr_of_the_transpose_it_is_the_motion_of_least_norm():
    problem = path_problem("planar", 24, smoothness=0.0)
    chain = problem.chain

    def square_norm(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.sum(np.matvec(chain.inverse_jacobian(q), v) ** 2, axis=-1)

    q = np.random.default_rng(2).uniform(chain.lower, chain.upper, (100, 3))
    q = q[problem.clear(q)]
    v = np.tile(problem.steps[12], (len(q), 1))

    def ratio(law: str) -> np.ndarray:
        return law_cost(law, chain)(q, v) / square_norm(q, v)

    constant = ratio("qr_transposed")
    np.testing.assert_allclose(constant, constant[0], rtol=1e-9)
    # the control: under another decomposition it is not
    assert np.ptp(ratio("pivoted_lu")) > 0.1 * constant[0]
    planned = least_uncertain(problem, law_cost("qr_transposed", chain), 50)
    least = least_uncertain(problem, square_norm, 50)
    assert planned.cost.sum() == pytest.approx(constant[0] * least.cost.sum(), rel=1e-3)
