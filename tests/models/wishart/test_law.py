"""Law of a Wishart step against Algorithm 1, which draws and inverts the matrix: draws, moments
and the density, in its limits, with measurement noise by two routes, and for arms of any number of
joints and task rows.
"""

from functools import partial

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from printed_algorithms import algorithm_1, every_reading, least_p_value
from random_arm import SIZES, motion, random_arm
from scipy import stats

from pipeline.core.errors import ModelDomainError
from pipeline.models.draws import draw_steps
from pipeline.models.wishart.decomposition import PIVOTED_LU, Decomposition, factors
from pipeline.models.wishart.law import WishartModel, step_variances
from pipeline.models.wishart.quadrature import blurred_log_density
from pipeline.randommatrix import wishart

POSE = np.array([0.4, 1.7, -0.3])
MEASUREMENT = np.array([[0.6, -0.6, 0.0], [-0.6, 1.5, -0.9], [0.0, -0.9, 1.7]]) * 1e-6
DRAWS = 30_000


@every_reading
@pytest.mark.parametrize("sigma_b", [0.25, 1.2])
def test_the_reduced_law_is_that_of_algorithm_1(chain, step, decomposition, sigma_b):
    rng = default_rng(8)
    matrices = algorithm_1(chain, POSE, step, sigma_b, decomposition, DRAWS, rng)
    drawn, clipped = draw_steps(
        WishartModel(sigma_b, decomposition),
        chain,
        np.tile(POSE, (DRAWS, 1)),
        step,
        rng,
    )

    assert least_p_value(drawn, matrices) > 0.01 / 8
    assert clipped == 0

    # control: a dispersion 5 % off is rejected
    wrong, _ = draw_steps(
        WishartModel(1.05 * sigma_b, decomposition),
        chain,
        np.tile(POSE, (DRAWS, 1)),
        step,
        rng,
    )

    assert least_p_value(wrong, matrices) < 1e-4


@every_reading
def test_the_exact_moments_are_those_of_algorithm_1(chain, step, decomposition):
    model = WishartModel(0.25, decomposition)
    drawn = algorithm_1(
        chain,
        POSE,
        step,
        0.25,
        decomposition,
        80_000,
        default_rng(12),
    )
    mean = model.mean(chain, POSE, step)
    covariance = model.covariance(chain, POSE, step)
    error = np.sqrt(np.diag(covariance) / len(drawn))

    assert np.abs((drawn.mean(axis=0) - mean) / error).max() < 4
    assert (
        np.linalg.norm(np.cov(drawn.T) - covariance) / np.linalg.norm(covariance)
        < 0.025
    )

    # control: the nominal step is not the mean, it is 1.067 times as long
    nominal = POSE + chain.inverse_jacobian(POSE) @ step
    assert np.abs((drawn.mean(axis=0) - nominal) / error).max() > 12
    assert_allclose((mean - POSE) / (nominal - POSE), 64 / 60, rtol=1e-12)


@pytest.mark.parametrize("sigma_b", [0.25, 0.5, 0.7])
@pytest.mark.parametrize("m", [1, 2, 3, 6])
def test_the_variances_of_a_step_are_those_of_the_inverse_wishart_law(sigma_b, m):
    d = wishart.degrees_of_freedom(sigma_b, m)
    law = stats.invwishart(d, d * np.eye(m))
    variances = np.ravel(law.var())  # of the entries of B⁻¹, by rows
    along, across = step_variances(d, m)

    assert along == pytest.approx(variances[0], rel=1e-12)

    if m > 1:
        assert across == pytest.approx(variances[1], rel=1e-12)


def test_moments_end_where_the_theory_says(chain, step):
    assert np.all(np.isfinite(WishartModel(0.81).covariance(chain, POSE, step)))
    with pytest.raises(
        ModelDomainError,
        match=r"covariance .* only for sigma_B below 0.8165",
    ):
        WishartModel(0.82).covariance(chain, POSE, step)
    assert np.all(np.isfinite(WishartModel(0.99).mean(chain, POSE, step)))
    with pytest.raises(ModelDomainError, match=r"mean .* only for sigma_B below 1"):
        WishartModel(1.0).mean(chain, POSE, step)


def excess(
    draws: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    log_density,
    rng,
) -> float:
    """Share of ``draws`` in a box minus the integral of the density over it, in standard errors."""
    hits = np.mean(np.all((draws > low) & (draws < high), axis=1))
    inside = np.exp(log_density(rng.uniform(low, high, (20_000, 3)))) * np.prod(
        high - low,
    )
    return (hits - inside.mean()) / np.hypot(
        np.sqrt(hits * (1 - hits) / len(draws)),
        inside.std() / np.sqrt(len(inside)),
    )


@pytest.mark.slow
@every_reading
@pytest.mark.parametrize(
    ("sigma_b", "measurement"),
    [(0.25, None), (0.9, 100 * MEASUREMENT)],
)
def test_the_density_is_that_of_algorithm_1_box_by_box(
    chain,
    step,
    decomposition,
    sigma_b,
    measurement,
):
    rng = default_rng(1)
    draws = algorithm_1(chain, POSE, step, sigma_b, decomposition, 100_000, rng)
    if measurement is not None:
        draws = draws + rng.multivariate_normal(np.zeros(3), measurement, len(draws))
    corners = np.quantile(draws, [0.05, 0.4, 0.6, 0.95], axis=0)

    def excesses(model: WishartModel) -> list[float]:
        density = partial(model.log_density, chain, POSE, step, measurement=measurement)
        return [
            abs(excess(draws, corners[i], corners[j], density, rng))
            for i, j in ((0, 3), (1, 2), (0, 2))
        ]

    assert max(excesses(WishartModel(sigma_b, decomposition))) < 3.5
    # control: a dispersion 30 % off
    assert max(excesses(WishartModel(1.3 * sigma_b, decomposition))) > 5


def test_at_rest_there_is_no_density_without_measurement_noise(chain, poses, step):
    v = np.tile(step, (len(poses), 1))
    v[[3, 7]] = 0.0
    with pytest.raises(ModelDomainError, match=r"at rest, as at 2 of 200 step"):
        WishartModel(0.25).log_density(chain, poses, v, poses)
    with pytest.raises(ModelDomainError, match="singular"):
        WishartModel(0.25).log_density(
            chain,
            poses,
            v,
            poses,
            np.diag([1e-6, 1e-6, 0.0]),
        )


@pytest.mark.parametrize(
    ("sigma_b", "error"),
    [(0.05, 5e-6), (0.25, 1e-4), (0.5, 3e-4), (0.8, 1e-3), (1.2, 5e-3)],
)
def test_the_quadrature_converges(chain, poses, step, sigma_b, error):
    """For draws of the law, with measurement noise far below, near and far above the step's."""
    rng = default_rng(5)
    d = wishart.degrees_of_freedom(sigma_b, 3)
    a, back, _ = factors(chain, poses, step, PIVOTED_LU)
    x = WishartModel(sigma_b).sample(chain, poses, step, rng) - poses
    for scale in (1e-3, 1.0, 1e4):
        noise = scale * MEASUREMENT
        problem = (
            x + rng.standard_normal(x.shape) @ np.linalg.cholesky(noise).T,
            a,
            back,
            noise,
            d,
        )
        fine = blurred_log_density(*problem, nodes=81)
        # above σ_B = 1 single steps are so long that rounding is larger
        assert np.quantile(np.abs(blurred_log_density(*problem) - fine), 0.99) < error
        # control: too few nodes
        assert np.abs(blurred_log_density(*problem, nodes=5) - fine).max() > 10 * error


SIGMA_B = 0.3


def scene(n: int, m: int, name: str = "qr_transposed", share: float = 0.5):
    """Arm, pose, command, model and a measurement covariance, whose standard deviations
    are about ``share`` of the standard deviations of the step.
    """
    arm = random_arm(n, m)
    q, v = motion(arm, 1, 0)
    model = WishartModel(SIGMA_B, Decomposition(name))
    variance = np.trace(model.covariance(arm, q[0], v[0])) / n
    normals = default_rng(n).standard_normal((n, n))
    root = np.eye(n) + 0.4 * normals / np.sqrt(n)
    measurement = share**2 * variance * root @ root.T
    return arm, q[0], v[0], model, measurement


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_it_is_the_mean_of_normals_over_the_law_of_z_and_g(n, m):
    """Mean over the quantiles of z and g, in plain NumPy and SciPy."""
    arm, q, v, model, noise = scene(n, m)
    a, back, _ = factors(arm, q, v, model.decomposition)
    d = wishart.degrees_of_freedom(SIGMA_B, m)
    r = np.linalg.norm(a)
    nodes, weights = np.polynomial.legendre.leggauss(120)
    z = stats.invgamma((d - m + 1) / 2, scale=d / 2).ppf((nodes + 1) / 2)[:, None]
    g = stats.chi2(d - m + 2).ppf((nodes + 1) / 2)
    across = back @ (np.eye(m) - np.outer(a, a) / r**2) @ back.T
    covariance = noise + ((r * z) ** 2 / g)[..., None, None] * across
    precision = np.linalg.inv(covariance)
    determinant = np.linalg.det(2 * np.pi * covariance)
    rng = default_rng(11)
    q_next = model.sample(arm, np.tile(q, (4, 1)), v, rng)
    q_next += rng.multivariate_normal(np.zeros(n), noise, 4)
    exact = []
    for after in q_next:
        residual = after - q - arm.null_step(q, v) - z * (back @ a)
        squared = np.einsum("zi,zgij,zj->zg", residual, precision, residual)
        normal = np.exp(-0.5 * squared) / np.sqrt(determinant)
        exact.append(np.log(weights @ normal @ weights / 4))

    assert_allclose(
        model.log_density(arm, q, v, q_next, noise),
        exact,
        atol=3e-4,
    )

    # control: another dispersion
    wider = WishartModel(1.02 * SIGMA_B, model.decomposition)
    assert np.abs(wider.log_density(arm, q, v, q_next, noise) - exact).max() > 1.5e-3


@pytest.mark.parametrize("n", [n for n, m in SIZES if m == n])
def test_without_measurement_it_integrates_to_one(n):
    """Importance sampling from a wider law."""
    arm, q, v, model, _ = scene(n, n)
    rng = default_rng(13)
    spread = model.covariance(arm, q, v)
    wider = stats.multivariate_t(model.mean(arm, q, v), 1.3 * spread, df=6, seed=rng)
    q_next = wider.rvs(20_000)
    ratio = np.exp(model.log_density(arm, q, v, q_next) - wider.logpdf(q_next))
    error = ratio.std() / np.sqrt(len(ratio))

    assert error < 0.02 and abs(ratio.mean() - 1) < 4 * error
    # control: a share of 10 % less is seen
    assert abs(0.9 * ratio.mean() - 1) > 4 * error


def test_without_measurement_a_step_of_more_joints_than_rows_lies_on_a_plane():
    arm, q, v, model, _ = scene(3, 2)
    with pytest.raises(
        ModelDomainError,
        match=r"on a plane \(3 joints and 2 task rows\)",
    ):
        model.log_density(arm, q, v, q)
