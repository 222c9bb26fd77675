"""The MaxEnt law and its limits; the variates of compiled code are NumPy's, bit for bit.

Bands of 4.5 standard errors: a right law leaves them once in 100 000 entries.
"""

import numpy as np
import pytest
from compiled_calls import from_python
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from scipy.optimize import brentq
from scipy.special import digamma
from standard_errors import largest_score, mean_scores

from pipeline.arm.rows import block_rows
from pipeline.core.errors import ModelDomainError
from pipeline.randommatrix import wishart
from pipeline.randommatrix.variates import draw_variates


def maxent(d: float, n: int):
    """The law W_n(d, I/d)."""
    return stats.wishart(d, np.eye(n) / d)


@pytest.mark.parametrize("sigma_b", [0.1, 0.25, 0.7, 1.2])
def test_the_maxent_law_has_the_mean_and_the_dispersion_it_was_asked_for(sigma_b):
    n = 3
    d = wishart.degrees_of_freedom(sigma_b, n)
    draws = maxent(d, n).rvs(40_000, random_state=8)
    squared = ((draws - np.eye(n)) ** 2).sum(axis=(-1, -2)) / n

    assert d == pytest.approx((n + 1) / sigma_b**2, rel=1e-14)
    assert largest_score(draws, np.eye(n)) < 4.5
    assert largest_score(squared, sigma_b**2) < 4.5
    assert largest_score(squared, (1.1 * sigma_b) ** 2) > 4.5
    std = wishart.normalized_std(draws, np.eye(n))
    assert_allclose(std, np.sqrt(squared.mean()), rtol=1e-12)


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
def test_of_two_laws_that_meet_the_constraints_the_wishart_law_has_the_greater_entropy(
    sigma_b,
):
    n = 3
    draws = 4000
    rng = default_rng(1)
    d = wishart.degrees_of_freedom(sigma_b, n)
    law = maxent(d, n)
    rival = inverse_wishart_of_the_same_constraints(d, n)
    of_rival = rival.rvs(draws, random_state=rng)
    of_law = law.rvs(draws, random_state=rng)
    log_density = law.logpdf(np.moveaxis(of_law, 0, -1))
    cross = law.logpdf(np.moveaxis(of_rival, 0, -1))

    # the log density is a function of the constraints alone, so both laws have one expectation of
    # it: minus the entropy of the first
    assert largest_score(log_density - cross) < 4.5
    # so the entropies differ by the divergence of the other law from this one
    divergence = rival.logpdf(np.moveaxis(of_rival, 0, -1)) - cross
    assert mean_scores(divergence) > 4.5
    # control: a law of a wider dispersion, which does not meet the constraints, has more
    wide = wishart.degrees_of_freedom(1.1 * sigma_b, n)
    assert maxent(wide, n).entropy() > -log_density.mean() + 0.1


@pytest.mark.parametrize("n", [2, 3, 6])
def test_theta_follows_the_papers_equation_for_any_size(n):
    mean = np.eye(n)
    sigma_b = 0.3
    ratio = np.trace(mean) ** 2 / np.trace(mean @ mean)
    printed = (1 + ratio) / sigma_b**2 - (n + 1)
    assert wishart.maxent_theta(sigma_b, n) == pytest.approx(printed, rel=1e-14)


def test_the_limits_of_the_dispersion_are_where_density_mean_and_variance_of_the_inverse_end():
    for moments, d in [(0, 2), (1, 4), (2, 6)]:
        largest = wishart.largest_dispersion(3, inverse_moments=moments)
        assert 4 / largest**2 == pytest.approx(d)


POSES = 20_000
BUFFER = block_rows(7, 6)


@pytest.mark.parametrize("sigma_b", [0.0, -0.2, np.sqrt(2), 3.0, np.nan])
def test_a_dispersion_beyond_the_limits_is_refused(sigma_b):
    words = r"sigma_B must lie between 0 and 1\.414"
    with pytest.raises(ModelDomainError, match=words):
        wishart.degrees_of_freedom(sigma_b, 3)


@pytest.mark.parametrize("degrees", [0.02, 1.0, 1.9999, 2.0, 2.0001, 3.7, 1e6])
@pytest.mark.parametrize(("count", "normals"), [(3, 2), (POSES, 7)])
def test_chi_squares_are_numpys_and_so_are_the_normals_behind_them(
    degrees,
    count,
    normals,
):
    freedom = np.array([degrees, 5.0])
    block = np.full((BUFFER.size, POSES), np.nan)
    rng = default_rng(7)
    numpy_rng = default_rng(7)
    first = BUFFER.chi_square
    then = BUFFER.normal

    from_python(draw_variates)(freedom, normals, block, first, then, 0, count, rng)

    for row, d in zip(block[first:], freedom, strict=False):
        assert_array_equal(row[:count], numpy_rng.chisquare(d, count))
    rows = block[then : then + normals, :count]
    assert_array_equal(rows.T, numpy_rng.standard_normal((count, normals)))
    assert rng.random() == numpy_rng.random()
    assert np.isnan(block[:, count:]).all()
