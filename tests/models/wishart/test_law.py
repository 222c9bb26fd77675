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
from standard_errors import largest_score

from pipeline.core.errors import ModelDomainError
from pipeline.models.draws import draw_steps
from pipeline.models.wishart.decomposition import PIVOTED_LU, Decomposition, factors
from pipeline.models.wishart.law import WishartModel, step_variances
from pipeline.models.wishart.quadrature import blurred_log_density
from pipeline.randommatrix import wishart

POSE = np.array([0.4, 1.7, -0.3])
MEASUREMENT = np.array([[0.6, -0.6, 0.0], [-0.6, 1.5, -0.9], [0.0, -0.9, 1.7]]) * 1e-6
DRAWS = 30_000


def steps_of(model: WishartModel, chain, step, rng) -> tuple[np.ndarray, int]:
    """DRAWS compiled steps from POSE, and the count of clipped ones."""
    return draw_steps(model, chain, np.tile(POSE, (DRAWS, 1)), step, rng)


@every_reading
@pytest.mark.parametrize("sigma_b", [0.25, 1.2])
def test_the_reduced_law_is_that_of_algorithm_1(chain, step, decomposition, sigma_b):
    rng = default_rng(8)
    matrices = algorithm_1(chain, POSE, step, sigma_b, decomposition, DRAWS, rng)
    drawn, clipped = steps_of(WishartModel(sigma_b, decomposition), chain, step, rng)

    assert least_p_value(drawn, matrices) > 0.01 / 8
    assert clipped == 0
    # control: a dispersion 5 % off is rejected
    wider = WishartModel(1.05 * sigma_b, decomposition)
    wrong, _ = steps_of(wider, chain, step, rng)
    assert least_p_value(wrong, matrices) < 1e-4


@every_reading
def test_the_exact_moments_are_those_of_algorithm_1(chain, step, decomposition):
    rng = default_rng(12)
    drawn = algorithm_1(chain, POSE, step, 0.25, decomposition, 80_000, rng)
    model = WishartModel(0.25, decomposition)
    mean = model.mean(chain, POSE, step)
    covariance = model.covariance(chain, POSE, step)
    nominal = POSE + chain.inverse_jacobian(POSE) @ step

    assert largest_score(drawn, mean) < 4
    error = np.linalg.norm(np.cov(drawn.T) - covariance)
    assert error < 0.025 * np.linalg.norm(covariance)
    # control: the nominal step is not the mean, it is 1.067 times as long
    assert largest_score(drawn, nominal) > 12
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


END_OF_MOMENTS = [  # method, σ_B below and beyond its limit, and the refusal
    ("covariance", 0.81, 0.82, r"covariance .* only for sigma_B below 0.8165"),
    ("mean", 0.99, 1.0, r"mean .* only for sigma_B below 1"),
]


@pytest.mark.parametrize(("moment", "below", "beyond", "words"), END_OF_MOMENTS)
def test_moments_end_where_the_theory_says(chain, step, moment, below, beyond, words):
    finite = getattr(WishartModel(below), moment)(chain, POSE, step)
    assert np.all(np.isfinite(finite))
    with pytest.raises(ModelDomainError, match=words):
        getattr(WishartModel(beyond), moment)(chain, POSE, step)


def excess(
    draws: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    log_density,
    rng,
) -> float:
    """Share of ``draws`` in a box minus the integral of the density over it, in standard errors."""
    hits = np.all((draws > low) & (draws < high), axis=1)
    volume = np.prod(high - low)
    inside = volume * np.exp(log_density(rng.uniform(low, high, (20_000, 3))))
    errors = [values.std() / np.sqrt(len(values)) for values in (hits, inside)]
    return (hits.mean() - inside.mean()) / np.hypot(*errors)


BOXES = [(0, 3), (1, 2), (0, 2)]  # quantiles at two corners of a box


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

    def greatest_excess(sigma_b: float) -> float:
        model = WishartModel(sigma_b, decomposition)
        density = partial(model.log_density, chain, POSE, step, measurement=measurement)
        excesses = []
        for low, high in BOXES:
            excesses.append(excess(draws, corners[low], corners[high], density, rng))
        return np.abs(excesses).max()

    assert greatest_excess(sigma_b) < 3.5
    # control: a dispersion 30 % off
    assert greatest_excess(1.3 * sigma_b) > 5


def test_at_rest_there_is_no_density_without_measurement_noise(chain, poses, step):
    v = np.tile(step, (len(poses), 1))
    v[[3, 7]] = 0.0
    case = chain, poses, v, poses
    with pytest.raises(ModelDomainError, match=r"at rest, as at 2 of 200 step"):
        WishartModel(0.25).log_density(*case)
    with pytest.raises(ModelDomainError, match="singular"):
        WishartModel(0.25).log_density(*case, np.diag([1e-6, 1e-6, 0.0]))


QUADRATURE = [(0.05, 5e-6), (0.25, 1e-4), (0.5, 3e-4), (0.8, 1e-3), (1.2, 5e-3)]


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize(("sigma_b", "error"), QUADRATURE)
def test_the_quadrature_converges(chain, poses, step, sigma_b, error, scale):
    """For draws of the law, with measurement noise far below, near and far above the step's."""
    rng = default_rng(5)
    a, back, _ = factors(chain, poses, step, PIVOTED_LU)
    x = WishartModel(sigma_b).sample(chain, poses, step, rng) - poses
    noise = scale * MEASUREMENT
    x += rng.multivariate_normal(np.zeros(3), noise, len(x))
    problem = x, a, back, noise, wishart.degrees_of_freedom(sigma_b, 3)

    fine = blurred_log_density(*problem, nodes=81)

    # above σ_B = 1 single steps are so long that rounding is larger
    usual = np.abs(blurred_log_density(*problem) - fine)
    assert np.quantile(usual, 0.99) < error
    # control: too few nodes
    coarse = np.abs(blurred_log_density(*problem, nodes=5) - fine)
    assert coarse.max() > 10 * error


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


def log_mean_of_normals(residuals, a, back, d, noise) -> np.ndarray:
    """Log density of ``residuals`` (N, n) as the mean of normal densities over the quantiles of z
    and g, in plain NumPy and SciPy.
    """
    m = len(a)
    r = np.linalg.norm(a)
    nodes, weights = np.polynomial.legendre.leggauss(120)
    probabilities = (nodes + 1) / 2
    z = stats.invgamma((d - m + 1) / 2, scale=d / 2).ppf(probabilities)[:, None]
    g = stats.chi2(d - m + 2).ppf(probabilities)
    across = back @ (np.eye(m) - np.outer(a, a) / r**2) @ back.T
    covariance = noise + ((r * z) ** 2 / g)[..., None, None] * across
    precision = np.linalg.inv(covariance)
    determinant = np.linalg.det(2 * np.pi * covariance)

    densities = []
    for residual in residuals:
        from_mean = residual - z * (back @ a)
        squared = np.einsum("zi,zgij,zj->zg", from_mean, precision, from_mean)
        normal = np.exp(-0.5 * squared) / np.sqrt(determinant)
        densities.append(weights @ normal @ weights / 4)
    return np.log(densities)


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_it_is_the_mean_of_normals_over_the_law_of_z_and_g(n, m):
    arm, q, v, model, noise = scene(n, m)
    rng = default_rng(11)
    q_next = model.sample(arm, np.tile(q, (4, 1)), v, rng)
    q_next += rng.multivariate_normal(np.zeros(n), noise, 4)
    a, back, _ = factors(arm, q, v, model.decomposition)
    residuals = q_next - q - arm.null_step(q, v)
    d = wishart.degrees_of_freedom(SIGMA_B, m)
    exact = log_mean_of_normals(residuals, a, back, d, noise)

    density = model.log_density(arm, q, v, q_next, noise)

    assert_allclose(density, exact, atol=3e-4)
    # control: another dispersion
    wider = WishartModel(1.02 * SIGMA_B, model.decomposition)
    of_wider = wider.log_density(arm, q, v, q_next, noise)
    assert np.abs(of_wider - exact).max() > 1.5e-3


@pytest.mark.parametrize("n", [n for n, m in SIZES if m == n])
def test_without_measurement_it_integrates_to_one(n):
    """Importance sampling from a wider law."""
    arm, q, v, model, _ = scene(n, n)
    shape = 1.3 * model.covariance(arm, q, v)
    wider = stats.multivariate_t(model.mean(arm, q, v), shape, df=6)
    q_next = wider.rvs(20_000, random_state=default_rng(13))
    ratio = np.exp(model.log_density(arm, q, v, q_next) - wider.logpdf(q_next))

    assert ratio.std() / np.sqrt(len(ratio)) < 0.02
    assert largest_score(ratio, 1.0) < 4
    # control: a share of 10 % less is seen
    assert largest_score(0.9 * ratio, 1.0) > 4


def test_without_measurement_a_step_of_more_joints_than_rows_lies_on_a_plane():
    arm, q, v, model, _ = scene(3, 2)
    with pytest.raises(
        ModelDomainError,
        match=r"on a plane \(3 joints and 2 task rows\)",
    ):
        model.log_density(arm, q, v, q)
