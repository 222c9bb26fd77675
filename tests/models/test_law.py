"""The compiled laws of one step: their formulas in NumPy from the same stream, and for the Wishart
model the same law from fewer numbers.
"""

from __future__ import annotations

import numpy as np
import pytest
from oracles import every_reading, inverse_action_steps
from plain_laws import plain_steps
from scipy import stats

from pipeline.arm.chain import PlanarChain
from pipeline.models.draws import draw_steps
from pipeline.models.kinds import build_model
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.wishart.law import WishartModel

COVARIANCE = (1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])).tolist()
# as the stage fit writes them
PARAMETERS = {
    "additive": {"kind": "additive", "noise_covariance": COVARIANCE},
    "wishart_pivoted": {"kind": "wishart", "sigma_b": 0.25, "decomposition": "pivoted_lu"},
    "wishart_qr": {"kind": "wishart", "sigma_b": 0.25, "decomposition": "qr"},
    "wishart_transposed": {"kind": "wishart", "sigma_b": 0.25, "decomposition": "qr_transposed"},
    "wishart_given": {
        "kind": "wishart",
        "sigma_b": 0.6,
        "decomposition": "given",
        "left": [[0.15, 0.02, 0], [0, 0.15, 0], [0, 0.1, 1]],
    },
    "gaussian": {"kind": "gaussian", "alpha": 0.05, "u": 18.0},
    "scaled": {"kind": "scaled", "floor": COVARIANCE, "gain": np.diag([0.04, 0.05, 0.06]).tolist()},
    "timing": {"kind": "scaled", "floor": COVARIANCE, "gain": np.full((3, 3), 0.04).tolist()},
}
# every first pivot of LU occurs, with and without an exchange after it
ARMS = {
    "the arm's": (np.array([[0.0, 0.155], [0.0, 0.135], [0.0, 0.17]]), [1.0, 1.0, -1.0]),
    "askew and long": (np.array([[0.9, 1.5], [-0.7, 1.3], [0.3, -1.7]]), [-1.0, 1.0, -1.0]),
}


@pytest.fixture(params=ARMS)
def arm(request) -> PlanarChain:
    links, signs = ARMS[request.param]
    return PlanarChain(
        np.zeros(2), links, np.array(signs), np.full(3, -9.0), np.full(3, 9.0), np.ones(3)
    )


@pytest.fixture
def anywhere(arm) -> np.ndarray:
    q = np.random.default_rng(1).uniform(-7, 7, (2000, 3))
    return q[np.abs(np.linalg.det(arm.jacobian(q))) > 0.05 * arm.lengths[0] * arm.lengths[1]]


@pytest.mark.parametrize("kind", PARAMETERS)
@pytest.mark.parametrize(
    "v",
    [[0.004, -0.003, 0.03], [-0.004, 0.0, 0.0], [0.0, 0.0, 0.0]],
    ids=["turning", "backwards", "at rest"],
)
def test_every_compiled_law_is_its_formula_in_numpy(kind, v, arm, anywhere):
    model, v = build_model(PARAMETERS[kind]), np.array(v)
    one, other = np.random.default_rng(2), np.random.default_rng(2)
    moved, clipped = draw_steps(model, arm, anywhere, v, one)
    expected, expected_clipped = plain_steps(model, arm, anywhere, v, other)
    # by the size of a step: a few come near a singular draw and lead far
    scale = 1 + np.abs(expected - anywhere)
    assert np.max(np.abs(moved - expected) / scale) < 1e-12
    assert clipped == expected_clipped
    assert one.bit_generator.state == other.bit_generator.state


def least_p_value(one: np.ndarray, other: np.ndarray) -> float:
    """Least p-value of two-sample Kolmogorov–Smirnov tests of every coordinate and of its distance
    from the common middle.
    """
    views = [lambda x, j=j: x[:, j] for j in range(3)] + [
        lambda x: np.linalg.norm(x - np.median(other, axis=0), axis=1)
    ]
    return min(float(stats.ks_2samp(view(one), view(other)).pvalue) for view in views)


@pytest.mark.parametrize("sigma_b", [0.25, 1.2])
@every_reading
def test_the_law_from_one_gamma_is_the_law_from_two(sigma_b, decomposition, chain, step):
    """Band: the least of four p-values above 0.001; the control, of another spread, far below."""
    pose = np.tile([0.4, 1.7, -0.3], (30_000, 1))
    drawn = inverse_action_steps(
        chain, pose, step, sigma_b, decomposition, np.random.default_rng(4)
    )
    moved, _ = draw_steps(
        WishartModel(sigma_b, decomposition), chain, pose, step, np.random.default_rng(5)
    )
    assert least_p_value(moved, drawn) > 1e-3
    other, _ = draw_steps(
        WishartModel(0.93 * sigma_b, decomposition), chain, pose, step, np.random.default_rng(5)
    )
    assert least_p_value(other, drawn) < 1e-6


def test_each_command_moves_its_own_poses_and_all_poses_may_take_one(chain, poses, step):
    model, v = ScaledModel(np.zeros((3, 3))), np.linspace(0.1, 1.0, 4)[:, None] * step
    q = poses[:20].reshape(5, 4, 3)
    drawn, _ = draw_steps(model, chain, q, v, np.random.default_rng(7))
    np.testing.assert_allclose(drawn, model.mean(chain, q, v), atol=1e-14)
    single, _ = draw_steps(model, chain, q, step, np.random.default_rng(7))
    np.testing.assert_allclose(single, model.mean(chain, q, step), atol=1e-14)
    # control: the commands belong to their poses
    assert np.abs(drawn - model.mean(chain, q, v[::-1])).max() > 1e-3
