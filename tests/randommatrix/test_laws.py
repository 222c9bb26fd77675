"""Matrix-normal and Wishart laws (Definitions 1 and 2, Theorems 1 to 5) of every size against
simulation and SciPy; the MaxEnt law and its limits; the variates of compiled code, NumPy's own bit
for bit.

Bands of 4.5 and 5 standard errors: a right law leaves them once in 100 000 entries.
"""

import numpy as np
import pytest
from compiled_calls import from_python
from scipy import stats
from scipy.optimize import brentq
from scipy.special import digamma

from pipeline.arm.rows import block_rows
from pipeline.core.errors import ModelDomainError
from pipeline.randommatrix import wishart
from pipeline.randommatrix.variates import draw_variates

MEAN = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 1.0]])
ROWS = np.array([[1.0, 0.6], [0.6, 2.0]])
COLUMNS = np.array([[0.5, 0.2, 0.0], [0.2, 1.0, -0.3], [0.0, -0.3, 2.0]])
SIGMA = np.array([[1.0, 0.3, 0.0], [0.3, 0.8, -0.2], [0.0, -0.2, 0.5]])
DRAWS = 20_000
every_size = pytest.mark.parametrize("n", range(2, 9))


def largest_score(samples: np.ndarray, expected: np.ndarray) -> float:
    """Largest |sample mean − expected| over the entries, in standard errors."""
    error = samples.std(axis=0, ddof=1) / np.sqrt(len(samples))
    return float(np.abs((samples.mean(axis=0) - expected) / error).max())


def products(vectors: np.ndarray) -> np.ndarray:
    return vectors[:, :, None] * vectors[:, None, :]


def of_size(n: int):
    """Generator, M (n, n + 2), Σ (n, n) and Ψ (n + 2, n + 2)."""
    rng = np.random.default_rng(n)
    factors = rng.standard_normal((2, n + 2, n + 2)) / np.sqrt(n + 2)
    sigma, columns = factors @ factors.swapaxes(1, 2) + 0.2 * np.eye(n + 2)
    return rng, 0.3 * rng.standard_normal((n, n + 2)), sigma[:n, :n], columns


def test_definition_1_the_transpose_stacked_by_columns_has_covariance_sigma_kron_psi():
    draws = wishart.sample_matrix_normal(MEAN, ROWS, COLUMNS, (60_000,), np.random.default_rng(1))
    stacked = (draws - MEAN).reshape(len(draws), -1)  # row-major order of X is vec(Xᵀ)
    assert largest_score(stacked, np.zeros(6)) < 4.5
    assert largest_score(products(stacked), np.kron(ROWS, COLUMNS)) < 4.5
    # control: the other order of the Kronecker product is told apart
    assert largest_score(products(stacked), np.kron(COLUMNS, ROWS)) > 20


@every_size
def test_theorem_1_the_density_is_scipys_and_that_of_the_transpose_with_exchanged_covariances(n):
    rng, mean, sigma, columns = of_size(n)
    x = wishart.sample_matrix_normal(mean, sigma, columns, (50,), rng)
    densities = wishart.matrix_normal_log_density(x, mean, sigma, columns)
    expected = stats.matrix_normal(mean, sigma, columns).logpdf(x)
    np.testing.assert_allclose(densities, expected, rtol=1e-9)
    turned = wishart.matrix_normal_log_density(np.swapaxes(x, 1, 2), mean.T, columns, sigma)
    np.testing.assert_allclose(densities, turned, rtol=1e-9)


def test_theorem_2_a_gram_matrix_of_at_least_as_many_columns_is_positive_definite():
    rng = np.random.default_rng(3)
    # control: with fewer columns than rows the theorem does not hold
    for q, definite in [(3, True), (2, False)]:
        x = wishart.sample_matrix_normal(np.zeros((3, q)), SIGMA, np.eye(q), (2000,), rng)
        least = np.linalg.eigvalsh(x @ np.swapaxes(x, -1, -2))[:, 0]
        assert np.all(least > 1e-10) == definite


@every_size
def test_theorem_3_bartlett_draws_have_the_law_of_the_gram_matrix(n):
    """By determinant, trace and an entry off the diagonal; control: half a degree of freedom."""
    rng, mean, sigma, _ = of_size(n)
    x = wishart.sample_matrix_normal(0 * mean, sigma, np.eye(n + 2), (DRAWS,), rng)

    def levels(d: float) -> list[float]:
        pair = x @ np.swapaxes(x, 1, 2), wishart.sample(d, sigma, (DRAWS,), rng)
        logarithms, traces = (
            [view(each) for each in pair]
            for view in (lambda s: np.linalg.slogdet(s)[1], lambda s: np.trace(s, axis1=1, axis2=2))
        )
        entries = [each[:, 1, 0] for each in pair]
        return [stats.ks_2samp(*both).pvalue for both in (logarithms, traces, entries)]

    assert min(levels(n + 2.0)) > 1e-4
    assert levels(n + 2.5)[0] < 1e-6


@every_size
@pytest.mark.parametrize("beyond", [-0.6, 1.6, 60.0])
def test_theorem_4_the_mean_is_d_sigma_and_the_density_scipys_for_real_degrees_too(n, beyond):
    (rng, _, sigma, _), d = of_size(n), n + beyond
    draws = wishart.sample(d, sigma, (DRAWS,), rng)
    assert largest_score(draws, wishart.mean(d, sigma)) < 5
    assert largest_score(draws, wishart.mean(1.1 * d, sigma)) > 5
    reference = stats.wishart(d, sigma).logpdf(np.moveaxis(draws[:50], 0, -1))
    np.testing.assert_allclose(wishart.log_density(draws[:50], d, sigma), reference, rtol=1e-8)
    assert wishart.sample(d, sigma, (), rng).shape == (n, n)


@every_size
def test_theorem_5_gives_the_mean_of_quadratic_forms_that_are_not_symmetric(n):
    rng, mean, sigma, columns = of_size(n)
    x = wishart.sample_matrix_normal(mean, sigma, columns, (DRAWS,), rng)
    forms = np.eye(n + 2) + 0.3 * rng.standard_normal((2, n + 2, n + 2))
    expected, wrong = (
        wishart.expected_quadratic(mean, sigma, each, forms) for each in (columns, 1.2 * columns)
    )
    for k, a in enumerate(forms):
        drawn = x @ a @ np.swapaxes(x, 1, 2)
        assert largest_score(drawn, expected[k]) < 5 < largest_score(drawn, wrong[k])


@pytest.mark.parametrize("sigma_b", [0.1, 0.25, 0.7, 1.2])
def test_the_maxent_law_has_the_mean_and_the_dispersion_it_was_asked_for(sigma_b):
    n = 3
    d = wishart.degrees_of_freedom(sigma_b, n)
    assert d == pytest.approx((n + 1) / sigma_b**2, rel=1e-14)
    draws = wishart.sample(d, np.eye(n) / d, (40_000,), np.random.default_rng(8))
    assert largest_score(draws, np.eye(n)) < 4.5
    squared = ((draws - np.eye(n)) ** 2).sum(axis=(-1, -2)) / n
    assert largest_score(squared, np.array(sigma_b**2)) < 4.5
    assert largest_score(squared, np.array((1.1 * sigma_b) ** 2)) > 4.5
    np.testing.assert_allclose(
        wishart.normalized_std(draws, np.eye(n)), np.sqrt(squared.mean()), rtol=1e-12
    )
    # SciPy's density, which integrates to one
    expected = stats.wishart(d, np.eye(n) / d).logpdf(np.moveaxis(draws[:50], 0, -1))
    np.testing.assert_allclose(wishart.log_density(draws[:50], d, np.eye(n) / d), expected, 1e-8)


def inverse_wishart_of_the_same_constraints(d: float, n: int):
    """Inverse-Wishart with mean I and the E ln|B| of W(d, I/d): what keeps the moments of B⁻¹
    finite is E ln|B| alone.
    """
    orders = np.arange(n)
    wanted = digamma((d - orders) / 2).sum() + n * np.log(2 / d)

    def excess(nu: float) -> float:
        return n * np.log((nu - n - 1) / 2) - digamma((nu - orders) / 2).sum() - wanted

    nu = brentq(excess, n + 1.01, 1e4)
    return stats.invwishart(nu, (nu - n - 1) * np.eye(n))


@pytest.mark.parametrize("sigma_b", [0.25, 0.7])
def test_of_two_laws_that_meet_the_constraints_the_wishart_law_has_the_greater_entropy(sigma_b):
    n, draws, rng = 3, 4000, np.random.default_rng(1)
    d, wide = (wishart.degrees_of_freedom(factor * sigma_b, n) for factor in (1.0, 1.1))
    other = inverse_wishart_of_the_same_constraints(d, n)
    of_other = other.rvs(draws, random_state=rng)
    # the log density is a function of the constraints alone, so both laws have one expectation of
    # it: minus the entropy of the first
    own, cross = (
        wishart.log_density(drawn, d, np.eye(n) / d)
        for drawn in (wishart.sample(d, np.eye(n) / d, (draws,), rng), of_other)
    )
    assert abs(own.mean() - cross.mean()) < 4.5 * np.sqrt((own.var() + cross.var()) / draws)
    # so the entropies differ by the divergence of the other law from this one
    divergence = other.logpdf(np.moveaxis(of_other, 0, -1)) - cross
    assert divergence.mean() > 4.5 * divergence.std() / np.sqrt(draws)
    # control: a law of a wider dispersion, which does not meet the constraints, has more
    wider = wishart.sample(wide, np.eye(n) / wide, (draws,), rng)
    assert -wishart.log_density(wider, wide, np.eye(n) / wide).mean() > -own.mean() + 0.1


def test_theta_follows_the_papers_equation_for_any_size():
    for n in (2, 3, 6):
        mean, sigma_b = np.eye(n), 0.3
        printed = (1 + np.trace(mean) ** 2 / np.trace(mean @ mean)) / sigma_b**2 - (n + 1)
        assert wishart.maxent_theta(sigma_b, n) == pytest.approx(printed, rel=1e-14)


def test_the_limits_of_the_dispersion_are_where_density_mean_and_variance_of_the_inverse_end():
    for moments, d in [(0, 2), (1, 4), (2, 6)]:
        assert 4 / wishart.largest_dispersion(3, inverse_moments=moments) ** 2 == pytest.approx(d)
    for sigma_b in (0.0, -0.2, np.sqrt(2), 3.0, np.nan):
        with pytest.raises(ModelDomainError, match=r"sigma_B must lie between 0 and 1\.414"):
            wishart.degrees_of_freedom(sigma_b, 3)
    for call in (
        lambda: wishart.sample(2.0, SIGMA, (1,), np.random.default_rng(0)),
        lambda: wishart.log_density(SIGMA, 1.5, SIGMA),
    ):
        with pytest.raises(ValueError):
            call()


POSES, BUFFER = 20_000, block_rows(7, 6)


@pytest.mark.parametrize("degrees", [0.02, 1.0, 1.9999, 2.0, 2.0001, 3.7, 1e6])
@pytest.mark.parametrize(("count", "sets", "each"), [(3, 1, 2), (POSES, 2, 7)])
def test_chi_squares_are_numpys_and_so_are_the_normals_behind_them_set_by_set(
    degrees, count, sets, each
):
    one, other = np.random.default_rng(7), np.random.default_rng(7)
    block, freedom = np.full((BUFFER.size, POSES), np.nan), np.array([degrees, 5.0])
    first, then = BUFFER.chi_square, BUFFER.normal
    from_python(draw_variates)(freedom, sets, each, block, first, then, 0, count, one)
    assert np.isnan(block[:, count:]).all()
    for k, d in enumerate(freedom):
        np.testing.assert_array_equal(block[first + k, :count], other.chisquare(d, count))
    for k in range(sets):
        rows = block[then + k * each : then + (k + 1) * each, :count]
        np.testing.assert_array_equal(rows, other.standard_normal((count, each)).T)
    assert one.random() == other.random()
