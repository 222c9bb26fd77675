"""The density of a step of the Wishart model for arms of any number of joints and task rows."""

from __future__ import annotations

import numpy as np
import pytest
from oracles import inverse_action_steps
from random_arm import SIZES, motion, random_arm
from scipy import stats

from pipeline.core.errors import ModelDomainError
from pipeline.models.wishart.decomposition import Decomposition, factors
from pipeline.models.wishart.law import WishartModel
from pipeline.randommatrix.wishart import degrees_of_freedom

every_size = pytest.mark.parametrize(("n", "m"), SIZES)
SIGMA_B = 0.3


def scene(n: int, m: int, name: str = "qr_transposed", share: float = 0.5):
    """An arm, a pose, a command, the model and a measurement covariance, whose standard deviations
    are about ``share`` of those of the step.
    """
    arm = random_arm(n, m)
    q, v = motion(arm, 1, 0)
    left = {"left": np.eye(m) + 0.2} if name == "given" else {}
    model = WishartModel(SIGMA_B, Decomposition(name, **left))
    spread = np.trace(model.covariance(arm, q[0], v[0])) / n
    root = np.eye(n) + 0.4 * np.random.default_rng(n).standard_normal((n, n)) / np.sqrt(n)
    return arm, q[0], v[0], model, share**2 * spread * root @ root.T


@every_size
def test_it_is_the_mean_of_normals_over_the_law_of_z_and_g(n, m):
    """By the definition, over the quantiles of both, in plain NumPy and SciPy."""
    arm, q, v, model, noise = scene(n, m)
    a, back, _ = factors(arm, q, v, model.decomposition)
    d, r = degrees_of_freedom(SIGMA_B, m), np.linalg.norm(a)
    nodes, weights = np.polynomial.legendre.leggauss(120)
    z = stats.invgamma((d - m + 1) / 2, scale=d / 2).ppf((nodes + 1) / 2)[:, None]
    g = stats.chi2(d - m + 2).ppf((nodes + 1) / 2)
    across = back @ (np.eye(m) - np.outer(a, a) / r**2) @ back.T
    covariance = noise + ((r * z) ** 2 / g)[..., None, None] * across
    precision, determinant = np.linalg.inv(covariance), np.linalg.det(2 * np.pi * covariance)
    rng = np.random.default_rng(11)
    q_next = inverse_action_steps(arm, np.tile(q, (4, 1)), v, SIGMA_B, model.decomposition, rng)
    q_next += rng.multivariate_normal(np.zeros(n), noise, 4)
    exact = []
    for after in q_next:
        residual = after - q - arm.null_step(q, v) - z * (back @ a)
        squared = np.einsum("zi,zgij,zj->zg", residual, precision, residual)
        normal = np.exp(-0.5 * squared) / np.sqrt(determinant)
        exact.append(np.log(weights @ normal @ weights / 4))
    np.testing.assert_allclose(model.log_density(arm, q, v, q_next, noise), exact, atol=3e-4)
    # control: another dispersion
    other = WishartModel(1.02 * SIGMA_B, model.decomposition)
    assert np.abs(other.log_density(arm, q, v, q_next, noise) - exact).max() > 1.5e-3


@pytest.mark.parametrize(
    ("n", "m", "measured"),
    [(n, m, True) for n, m in SIZES] + [(n, m, False) for n, m in SIZES if m == n],
)
def test_it_integrates_to_one(n, m, measured):
    """By importance sampling from a wider law, whose draws leave no part of this one out."""
    arm, q, v, model, noise = scene(n, m)
    noise = noise if measured else None
    spread = model.covariance(arm, q, v) + (0 if noise is None else noise)
    rng = np.random.default_rng(13)
    wider = stats.multivariate_t(model.mean(arm, q, v), 1.3 * spread, df=6, seed=rng)
    q_next = wider.rvs(20_000).reshape(-1, n)
    ratio = np.exp(model.log_density(arm, q, v, q_next, noise) - wider.logpdf(q_next))
    error = ratio.std() / np.sqrt(len(ratio))
    assert error < 0.02
    assert abs(ratio.mean() - 1) < 4 * error
    # control: a share of 10 % less is seen
    assert abs(0.9 * ratio.mean() - 1) > 4 * error


def test_without_measurement_a_step_of_more_joints_than_rows_lies_on_a_plane():
    arm, q, v, model, _ = scene(3, 2)
    with pytest.raises(ModelDomainError, match="3 joints and 2 task rows lies on a plane"):
        model.log_density(arm, q, v, q)
