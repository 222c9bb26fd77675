"""The exact law of a Wishart step against Algorithm 1, which draws and inverts the matrix."""

from __future__ import annotations

import numpy as np
import pytest
from oracles import algorithm_1, every_reading, sample_inverse_action
from scipy import linalg, stats

from pipeline.core.errors import ModelDomainError
from pipeline.models.draws import draw_steps
from pipeline.models.wishart.decomposition import PIVOTED_LU, Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.randommatrix import wishart

POSE = np.array([0.4, 1.7, -0.3])
DRAWS = 30_000


def least_p_value(first: np.ndarray, second: np.ndarray) -> float:
    """Least p-value of two-sample Kolmogorov–Smirnov tests of every coordinate, product and
    distance from the common mean.
    """
    mean = second.mean(axis=0)
    views = [
        lambda x: x[:, 0],
        lambda x: x[:, 1],
        lambda x: x[:, 2],
        lambda x: np.linalg.norm(x - mean, axis=1),
    ]
    views += [lambda x, i=i: (x - mean)[:, i] * (x - mean)[:, i - 1] for i in range(3)]
    return min(float(stats.ks_2samp(view(first), view(second)).pvalue) for view in views)


@every_reading
@pytest.mark.parametrize("sigma_b", [0.25, 1.2])
def test_the_reduced_law_is_that_of_algorithm_1(chain, step, decomposition, sigma_b):
    rng = np.random.default_rng(8)
    matrices = algorithm_1(chain, POSE, step, sigma_b, decomposition, DRAWS, rng)
    drawn, clipped = draw_steps(
        WishartModel(sigma_b, decomposition), chain, np.tile(POSE, (DRAWS, 1)), step, rng
    )
    assert least_p_value(drawn, matrices) > 0.01 / 7
    assert clipped == 0
    # control: a dispersion 5 % off is rejected
    wrong, _ = draw_steps(
        WishartModel(1.05 * sigma_b, decomposition), chain, np.tile(POSE, (DRAWS, 1)), step, rng
    )
    assert least_p_value(wrong, matrices) < 1e-4


def test_wrong_degrees_of_freedom_of_the_tangent_are_rejected():
    """The tangent's χ² has d − n + 2 degrees of freedom: with d − n + 1, as those of z, the product
    is another law.
    """
    rng = np.random.default_rng(10)
    d, n, size = 5.0, 3, DRAWS
    a = np.array([1.0, 0.0, 0.0])
    exact = np.linalg.inv(wishart.sample(d, np.eye(n) / d, (size,), rng))[:, 1, 0]
    assert (
        stats.ks_2samp(sample_inverse_action(np.tile(a, (size, 1)), d, rng)[:, 1], exact).pvalue
        > 0.01
    )
    z = d / rng.chisquare(d - n + 1, size)
    wrong = z * rng.standard_normal(size) / np.sqrt(rng.chisquare(d - n + 1, size))
    assert stats.ks_2samp(wrong, exact).pvalue < 1e-6


@pytest.mark.parametrize(
    "direction",
    [
        [1.0, 0, 0],
        [-1.0, 0, 0],
        [0, 0, 1.0],
        [-0.6, 0.8, 0],
        [1e-9, -1.0, 1e-12],
        [-1e-160, 1e-160, 0],
    ],
)
def test_the_action_turns_and_scales_with_its_argument(direction):
    """B⁻¹a along a is ‖a‖z and across it isotropic, whatever the direction."""
    rng = np.random.default_rng(11)
    d, size = 12.0, 20_000
    a = np.array(direction)
    r = np.sqrt((a / np.abs(a).max()) @ (a / np.abs(a).max())) * np.abs(a).max()
    drawn = sample_inverse_action(np.tile(a, (size, 1)), d, rng) / r
    e = a / r
    along = drawn @ e
    across = drawn - along[:, None] * e
    assert stats.kstest(d / along, stats.chi2(d - 2).cdf).pvalue > 0.01
    plane = linalg.null_space(e[None])
    covariance = np.cov((across @ plane).T) / np.mean(along**2) * (d - 3)
    np.testing.assert_allclose(covariance, np.eye(2), atol=0.06)


@every_reading
def test_the_exact_moments_are_those_of_algorithm_1(chain, step, decomposition):
    model = WishartModel(0.25, decomposition)
    drawn = algorithm_1(chain, POSE, step, 0.25, decomposition, 200_000, np.random.default_rng(12))
    mean, covariance = model.mean(chain, POSE, step), model.covariance(chain, POSE, step)
    assert np.abs((drawn.mean(axis=0) - mean) / np.sqrt(np.diag(covariance) / len(drawn))).max() < 4
    assert np.linalg.norm(np.cov(drawn.T) - covariance) / np.linalg.norm(covariance) < 0.015
    # control: the nominal step is not the mean, it is 1.067 times as long
    nominal = POSE + chain.inverse_jacobian(POSE) @ step
    assert (
        np.abs((drawn.mean(axis=0) - nominal) / np.sqrt(np.diag(covariance) / len(drawn))).max()
        > 20
    )
    np.testing.assert_allclose((mean - POSE) / (nominal - POSE), 64 / 60, rtol=1e-12)


@every_reading
def test_at_rest_the_step_is_exactly_nothing(chain, poses, decomposition):
    model, rest = WishartModel(0.25, decomposition), np.zeros(3)
    drawn, _ = draw_steps(model, chain, poses, rest, np.random.default_rng(13))
    assert np.array_equal(drawn, poses)
    assert np.array_equal(model.mean(chain, poses, rest), poses)
    assert not np.any(model.covariance(chain, poses, rest))


def test_without_dispersion_the_step_tends_to_the_nominal_one(chain, poses, step):
    nominal = np.matvec(chain.inverse_jacobian(poses), step)
    drawn, _ = draw_steps(WishartModel(1e-7), chain, poses, step, np.random.default_rng(14))
    assert np.abs(drawn - poses - nominal).max() < 1e-5 * np.abs(nominal).max()


def test_moments_end_where_the_theory_says(chain, step):
    assert np.all(np.isfinite(WishartModel(0.81).covariance(chain, POSE, step)))
    with pytest.raises(ModelDomainError, match=r"covariance .* only for sigma_B below 0.8165"):
        WishartModel(0.82).covariance(chain, POSE, step)
    assert np.all(np.isfinite(WishartModel(0.99).mean(chain, POSE, step)))
    with pytest.raises(ModelDomainError, match=r"mean .* only for sigma_B below 1"):
        WishartModel(1.0).mean(chain, POSE, step)


def test_parameters_outside_the_model_are_refused(chain):
    with pytest.raises(ModelDomainError, match="sigma_B"):
        WishartModel(1.5).law(chain)
    with pytest.raises(ModelDomainError, match="sigma_B"):
        WishartModel(-0.1)
    with pytest.raises(ModelDomainError, match="as many rows as the task"):
        WishartModel(0.2, Decomposition("given", left=np.eye(2))).law(chain)


def rotation(seed: int) -> np.ndarray:
    return np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]


def test_a_rotation_as_first_factor_changes_nothing_of_the_law_and_lu_does(chain, poses, step):
    """W_n(d, I/d) is invariant to rotations: moments, densities and draws are those of QR, the same
    as J₁ = I.
    """
    given = Decomposition("given", left=rotation(20))
    turned, plain, lu = (
        WishartModel(0.25, reading) for reading in (given, Decomposition("qr"), PIVOTED_LU)
    )
    measurement = np.diag([1e-6, 2e-6, 3e-6])
    covariances = [model.covariance(chain, poses, step) for model in (turned, plain, lu)]
    np.testing.assert_allclose(covariances[0], covariances[1], rtol=1e-8, atol=1e-12)
    assert np.abs(covariances[2] - covariances[1]).max() > 0.05 * np.abs(covariances[1]).max()
    q_next, _ = draw_steps(plain, chain, poses, step, np.random.default_rng(21))
    for noise, tolerance in ((None, 1e-8), (measurement, 1e-3)):
        densities = [
            model.log_density(chain, poses, step, q_next, noise) for model in (turned, plain, lu)
        ]
        np.testing.assert_allclose(densities[0], densities[1], atol=tolerance)
        assert np.abs(densities[2] - densities[1]).max() > 0.1
    rng = np.random.default_rng(22)
    draws = [
        draw_steps(model, chain, np.tile(POSE, (DRAWS, 1)), step, rng)[0]
        for model in (turned, plain, lu)
    ]
    for j in range(3):
        assert stats.ks_2samp(draws[0][:, j], draws[1][:, j]).pvalue > 0.005
    assert min(stats.ks_2samp(draws[2][:, j], draws[1][:, j]).pvalue for j in range(3)) < 1e-4


@pytest.mark.parametrize("length", [0.15, 0.5])
def test_the_law_of_a_given_first_factor_is_that_of_algorithm_1(chain, step, length):
    rng = np.random.default_rng(23)
    left = np.diag([length, length, 1.0])
    model = WishartModel(0.3, Decomposition("given", left=left))
    b = wishart.sample(
        wishart.degrees_of_freedom(0.3, 3),
        np.eye(3) / wishart.degrees_of_freedom(0.3, 3),
        (DRAWS,),
        rng,
    )
    matrices = POSE + np.linalg.solve(left @ b @ np.linalg.solve(left, chain.jacobian(POSE)), step)
    drawn, _ = draw_steps(model, chain, np.tile(POSE, (DRAWS, 1)), step, rng)
    for j in range(3):
        assert stats.ks_2samp(drawn[:, j], matrices[:, j]).pvalue > 0.005
    # its density integrates to one: |det J₂| is not |det J| here
    inside = stats.multivariate_t(
        model.mean(chain, POSE, step), 4 * model.covariance(chain, POSE, step), df=3, seed=rng
    )
    q_next = inside.rvs(20_000)
    ratio = np.exp(model.log_density(chain, POSE, step, q_next) - inside.logpdf(q_next))
    error = ratio.std() / np.sqrt(len(ratio))
    assert abs(ratio.mean() - 1) < 4 * error
    # control: with |det J| in its place
    assert abs(ratio.mean() * length**2 - 1) > 20 * error
