"""The MaxEnt problem whose solution the Wishart law is: no other law that meets its constraints has
more entropy.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq
from scipy.special import digamma

from pipeline.randommatrix import wishart

N, DRAWS = 3, 10_000


def inverse_wishart_of_the_same_constraints(d: float):
    """Inverse-Wishart with mean I and the E ln|B| of W(d, I/d): what keeps the moments of B⁻¹
    finite is E ln|B| alone.
    """
    orders = np.arange(N)
    wanted = digamma((d - orders) / 2).sum() + N * np.log(2 / d)

    def excess(nu: float) -> float:
        return N * np.log((nu - N - 1) / 2) - digamma((nu - orders) / 2).sum() - wanted

    nu = brentq(excess, N + 1.01, 1e4)
    return stats.invwishart(nu, (nu - N - 1) * np.eye(N))


@pytest.mark.parametrize("sigma_b", [0.25, 0.7])
def test_of_two_laws_that_meet_the_constraints_the_wishart_law_has_the_greater_entropy(sigma_b):
    d = wishart.degrees_of_freedom(sigma_b, N)
    rng = np.random.default_rng(1)
    other = inverse_wishart_of_the_same_constraints(d)
    drawn, of_other = (
        wishart.sample(d, np.eye(N) / d, (DRAWS,), rng),
        other.rvs(DRAWS, random_state=rng),
    )
    # the log density is a function of the constraints alone, so both laws have one expectation of
    # it: minus the entropy of the first
    own, cross = (
        wishart.log_density(drawn, d, np.eye(N) / d),
        wishart.log_density(of_other, d, np.eye(N) / d),
    )
    error = np.sqrt((own.var() + cross.var()) / DRAWS)
    assert abs(own.mean() - cross.mean()) < 4.5 * error
    # so the entropies differ by the divergence of the other law from this one
    divergence = other.logpdf(np.moveaxis(of_other, 0, -1)) - cross
    assert divergence.mean() > 4.5 * divergence.std() / np.sqrt(DRAWS)
    # control: a law of a wider dispersion, which does not meet the constraints, has more
    wide = wishart.degrees_of_freedom(1.1 * sigma_b, N)
    wider = wishart.sample(wide, np.eye(N) / wide, (DRAWS,), rng)
    assert -wishart.log_density(wider, wide, np.eye(N) / wide).mean() > -own.mean() + 0.1


@pytest.mark.parametrize("sigma_b", [0.25, 0.7])
def test_the_density_integrates_to_one(sigma_b):
    """By importance sampling from a wider law, whose draws and density are SciPy's."""
    d = wishart.degrees_of_freedom(sigma_b, N)
    wider = stats.wishart(0.8 * d, np.eye(N) / (0.8 * d))
    drawn = wider.rvs(DRAWS, random_state=np.random.default_rng(2))
    ratio = np.exp(
        wishart.log_density(drawn, d, np.eye(N) / d) - wider.logpdf(np.moveaxis(drawn, 0, -1))
    )
    error = ratio.std() / np.sqrt(DRAWS)
    assert abs(ratio.mean() - 1) < 4.5 * error
    # control: a factor of 1.1 would show
    assert abs(1.1 * ratio.mean() - 1) > 4.5 * error
