"""The exact law of a Wishart step against Algorithm 1, which draws and inverts the matrix."""

from __future__ import annotations

import numpy as np
import pytest
from oracles import algorithm_1, every_reading
from scipy import stats

from pipeline.core.errors import ModelDomainError
from pipeline.models.draws import draw_steps
from pipeline.models.wishart.decomposition import Decomposition
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


def test_moments_end_where_the_theory_says(chain, step):
    assert np.all(np.isfinite(WishartModel(0.81).covariance(chain, POSE, step)))
    with pytest.raises(ModelDomainError, match=r"covariance .* only for sigma_B below 0.8165"):
        WishartModel(0.82).covariance(chain, POSE, step)
    assert np.all(np.isfinite(WishartModel(0.99).mean(chain, POSE, step)))
    with pytest.raises(ModelDomainError, match=r"mean .* only for sigma_B below 1"):
        WishartModel(1.0).mean(chain, POSE, step)


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
