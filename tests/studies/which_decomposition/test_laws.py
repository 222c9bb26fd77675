"""The closed forms are the laws of Algorithm 1, with the invariances of each reading."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import lu

from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.randommatrix.wishart import degrees_of_freedom, sample
from pipeline.studies.which_decomposition.laws import (
    PIVOTED,
    PLAIN,
    QR,
    QR_TRANSPOSED,
    READINGS,
    gaussian_variance,
    wishart_parts,
    wishart_variance,
)

SIGMA_B, DRAWS = 0.25, 40_000


def variance(reading, jacobian, v, sigma_b=SIGMA_B):
    """(n,) of one pose."""
    inverse = np.linalg.pinv(jacobian)
    parts = wishart_parts(*(reading, jacobian[..., None], inverse[..., None], v[:, None]))
    return wishart_variance(parts, len(v), sigma_b)[:, 0]


def first_factor(reading, jacobian):
    """J₁ by SciPy and NumPy; LU without pivoting by the quotients of minors."""
    m = len(jacobian)
    if reading == PIVOTED:
        permutation, lower, _ = lu(jacobian[:, :m])
        return permutation @ lower
    if reading == QR:
        return np.linalg.qr(jacobian[:, :m])[0]
    if reading == QR_TRANSPOSED:
        return np.linalg.qr(jacobian.T)[1].T
    rows, first = list(PLAIN[reading]), np.eye(3)
    for k in range(2):
        for i in range(k + 1, 3):
            minors = [np.linalg.det(jacobian[[*rows[:k], r], : k + 1]) for r in (rows[i], rows[k])]
            first[i, k] = minors[0] / minors[1]
    result = np.empty((3, 3))
    result[rows] = first
    return result


@pytest.fixture(scope="module")
def poses(arm, paths):
    """(J, v) at three moving steps."""
    chosen = [(kind, 160 - 50 * i) for i, kind in enumerate(paths)]
    jacobians = [arm.jacobian(paths[kind].q[i, k]) for i, (kind, k) in enumerate(chosen)]
    steps = [paths[kind].step[i, k] for i, (kind, k) in enumerate(chosen)]
    return [(jacobian, jacobian @ step) for jacobian, step in zip(jacobians, steps, strict=True)]


@pytest.mark.parametrize("reading", READINGS)
def test_the_variances_are_those_of_algorithm_1(poses, reading):
    """40 000 draws of B put the root of a variance within 2.5 %: 4.5 standard errors at a kurtosis
    below 6.
    """
    rng = np.random.default_rng(5)
    d = degrees_of_freedom(SIGMA_B, 3)
    for jacobian, v in poses:
        first = first_factor(reading, jacobian)
        second = np.linalg.solve(first, jacobian)
        draws = first @ sample(d, np.eye(3) / d, (DRAWS,), rng) @ second
        drawn = np.linalg.solve(draws, v[:, None])[..., 0].std(axis=0)
        np.testing.assert_allclose(np.sqrt(variance(reading, jacobian, v)), drawn, rtol=0.025)


@pytest.mark.parametrize("reading", [PIVOTED, QR, QR_TRANSPOSED])
def test_the_models_of_the_project_have_the_same_law(arm, paths, reading):
    q, step = (getattr(paths["loop"], part)[:, 100] for part in ("q", "step"))
    v = np.matvec(arm.jacobian(q), step)
    model = WishartModel(SIGMA_B, Decomposition(reading)).covariance(arm, q, v)
    own = [variance(reading, *pose) for pose in zip(arm.jacobian(q), v, strict=True)]
    np.testing.assert_allclose(own, np.diagonal(model, axis1=1, axis2=2), rtol=1e-8)


def test_the_gaussian_model_has_the_same_variance(arm, paths, stated):
    part = paths["task line"]
    q, step, norm = part.q[:, 100], part.step[:, 100], np.linalg.norm(part.inverse, axis=(2, 3))
    v = np.matvec(arm.jacobian(q), step)
    own = gaussian_variance(norm[:, 100], v.T, stated.alpha, stated.u, 3)
    model = GaussianModel(stated.alpha, stated.u).covariance(arm, q, v)
    np.testing.assert_allclose(own, model[:, 2, 2], rtol=1e-9)


INVARIANT = {
    "order of rows": (np.eye(3)[[2, 0, 1]], {PIVOTED, QR, QR_TRANSPOSED}),
    "unit of length": (np.diag([1000.0, 1000.0, 1.0]), {QR_TRANSPOSED}),
    "axes of the plane": (
        np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]),
        {QR, QR_TRANSPOSED},
    ),
}


@pytest.mark.parametrize("change", INVARIANT)
@pytest.mark.parametrize("reading", [PIVOTED, "lu_xzp", QR, QR_TRANSPOSED])
def test_a_reading_depends_on_units_rows_and_axes_or_does_not(poses, reading, change):
    matrix, invariant = INVARIANT[change]
    before = np.array([variance(reading, *pose) for pose in poses])
    after = np.array([variance(reading, matrix @ jacobian, matrix @ v) for jacobian, v in poses])
    assert np.allclose(before, after, rtol=1e-8) == (reading in invariant)


def test_pivoted_lu_is_at_every_pose_one_of_the_orders_with_phi_first(poses):
    for pose in poses:
        plain = [variance(reading, *pose) for reading in ("lu_pxz", "lu_pzx")]
        assert any(np.allclose(variance(PIVOTED, *pose), other, rtol=1e-9) for other in plain)


@pytest.mark.parametrize("reading", [PIVOTED, QR, QR_TRANSPOSED])
def test_a_redundant_arm_has_the_variances_of_algorithm_1(reading):
    rng = np.random.default_rng(11)
    jacobian, v = rng.normal(size=(3, 5)), rng.normal(size=3)
    first = first_factor(reading, jacobian)
    second = np.linalg.solve(first, jacobian)
    draws = sample(degrees_of_freedom(SIGMA_B, 3), np.eye(3) / 64, (DRAWS,), rng)
    back = np.linalg.pinv(second) @ np.linalg.solve(draws, np.linalg.solve(first, v)[:, None])
    np.testing.assert_allclose(
        np.sqrt(variance(reading, jacobian, v)), back[..., 0].std(axis=0), rtol=0.025
    )
