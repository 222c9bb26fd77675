"""What the law of each decomposition depends on, and where one has none."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from oracles import READINGS

from pipeline.core.errors import ModelDomainError
from pipeline.models.draws import draw_steps
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.factors import split
from pipeline.models.wishart.law import WishartModel

POSE = np.array([0.4, 1.7, -0.3])
ROTATION = np.linalg.qr(np.random.default_rng(24).standard_normal((3, 3)))[0]


def test_every_decomposition_is_a_law_of_its_own(chain, step):
    covariances = {
        name: WishartModel(0.25, reading).covariance(chain, POSE, step)
        for name, reading in READINGS.items()
    }
    for one, other in combinations(covariances, 2):
        difference = np.linalg.norm(covariances[one] - covariances[other])
        assert difference > 0.05 * np.linalg.norm(covariances[other])


def moments(jacobian: np.ndarray, v: np.ndarray, reading: Decomposition) -> np.ndarray:
    """(3, 3) J₂⁺(r²·I + aaᵀ)J₂⁺ᵀ: any two laws of one decomposition differ in it."""
    a, back, _ = split(jacobian, v, reading)
    return back @ (a @ a * np.eye(3) + np.outer(a, a)) @ back.T


@pytest.mark.parametrize(
    ("name", "turned", "scaled", "rows", "joints"),
    [
        ("lu", False, False, False, False),
        ("pivoted_lu", False, False, True, False),
        ("qr", True, False, True, True),
        ("qr_transposed", True, True, True, True),
    ],
)
def test_what_a_decomposition_does_not_depend_on(
    name, turned, scaled, rows, joints, chain, poses, step
):
    """Whether its law is the same after a rotation of the task, in other units of its rows, and
    with its rows or its joints in another order; the readings that change are the controls.
    """
    units, reading = np.diag([1000.0, 1000.0, 1.0]), Decomposition(name)
    cyclic = np.eye(3)[[1, 2, 0]]
    for jacobian in chain.jacobian(poses[:10]):
        law = moments(jacobian, step, reading)

        def same(left: np.ndarray, right: np.ndarray, law=law, jacobian=jacobian) -> bool:
            other = moments(left @ jacobian @ right.T, left @ step, reading)
            return bool(np.allclose(right.T @ other @ right, law, rtol=1e-6, atol=1e-12))

        plain = np.eye(3)
        assert [same(ROTATION, plain), same(units, plain)] == [turned, scaled]
        assert [same(cyclic, plain), same(plain, cyclic)] == [rows, joints]


def test_under_qr_of_the_transpose_the_covariance_knows_the_nominal_step_alone(chain, poses, step):
    """It is that of B⁻¹ acting on J⁻¹v itself: two poses with one nominal step have one law."""
    dq, reading = np.array([0.01, -0.02, 0.03]), READINGS["qr_transposed"]
    v = np.matvec(chain.jacobian(poses), dq)
    covariances = WishartModel(0.25, reading).covariance(chain, poses, v)
    np.testing.assert_allclose(covariances, covariances[:1].repeat(len(poses), 0), rtol=1e-8)
    # control: under the others it depends on the pose
    for name in ("lu", "pivoted_lu", "qr", "given"):
        others = WishartModel(0.25, READINGS[name]).covariance(chain, poses, v)
        assert np.abs(others / others[0] - 1).max() > 0.1


def test_a_draw_where_a_pivot_is_small_is_refused_with_the_pose(chain, poses, step):
    turned = np.tile(poses[0], (10_001, 1))
    turned[:, 0] += np.linspace(-np.pi / 2, np.pi / 2, len(turned))
    level = turned[np.abs(chain.jacobian(turned)[:, 0, 0]).argmin()]
    q = np.stack([poses[1], level])
    with pytest.raises(ModelDomainError, match="no next step at 1 pose") as refused:
        draw_steps(WishartModel(0.25), chain, q, step, np.random.default_rng(25))
    assert refused.value.evidence["index"] == (1,)
    assert refused.value.evidence["q"] == level.round(4).tolist()
    # control: the other readings have a step there
    for name in ("pivoted_lu", "qr", "qr_transposed", "given"):
        model = WishartModel(0.25, READINGS[name])
        drawn, _ = draw_steps(model, chain, q, step, np.random.default_rng(25))
        assert np.isfinite(drawn).all()
