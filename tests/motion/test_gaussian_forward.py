"""The forward form of the Gaussian matrix model against Algorithm 2 as printed, and what it does not have."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pipeline.errors import ModelDomainError
from pipeline.motion.convex import solve_noise_covariance
from pipeline.motion.gaussian import frobenius
from pipeline.motion.gaussian_forward import GaussianForwardModel
from pipeline.randommatrix import normal

POSE = np.array([0.4, 1.7, -0.3])
MEASUREMENT = np.diag([1e-6, 2e-6, 3e-6])
DRAWS = 30_000


@pytest.mark.parametrize("alpha", [0.03, 0.3])
def test_the_reduced_law_is_that_of_algorithm_2(chain, step, alpha):
    rng = np.random.default_rng(1)
    jacobian, model = chain.jacobian(POSE), GaussianForwardModel(alpha, 2.5)
    sigma = solve_noise_covariance(float(np.linalg.norm(jacobian)), alpha, 2.5, 3)
    matrices = POSE + np.linalg.solve(normal.sample(jacobian, np.eye(3), sigma, (DRAWS,), rng), step)
    drawn, clipped = model.sample(chain, np.tile(POSE, (DRAWS, 1)), step, rng)
    wrong, _ = GaussianForwardModel(1.1 * alpha, 2.5).sample(chain, np.tile(POSE, (DRAWS, 1)), step, rng)
    assert clipped == 0
    for direction in (*np.eye(3), [1.0, 1.0, 1.0], [1.0, -1.0, 0.5]):
        assert stats.ks_2samp(drawn @ direction, matrices @ direction).pvalue > 0.005

    def distances(q: np.ndarray) -> np.ndarray:
        return np.linalg.norm(q - POSE - np.linalg.solve(jacobian, step), axis=1)

    assert stats.ks_2samp(distances(drawn), distances(matrices)).pvalue > 0.005
    assert stats.ks_2samp(distances(wrong), distances(matrices)).pvalue < 1e-4


def test_no_moment_exists(chain, poses, step):
    model = GaussianForwardModel(0.1, 2.5)
    for moment in (model.mean, model.covariance):
        with pytest.raises(ModelDomainError, match="does not exist"):
            moment(chain, poses, step)


def test_the_tails_are_those_of_a_law_without_a_mean(chain, step):
    """P(‖x‖ > r) falls like 1/r: ten times as far, a tenth as often; with a mean it would fall faster."""
    drawn, _ = GaussianForwardModel(1.0, 2.5).sample(chain, np.tile(POSE, (400_000, 1)), step, np.random.default_rng(2))
    x = np.linalg.norm(drawn - POSE, axis=1)
    ratio = np.mean(x > 10.0) / np.mean(x > 1.0)
    assert abs(ratio - 0.1) < 0.02


def test_beyond_the_bound_there_is_the_nominal_step_and_it_is_counted(chain, poses, step):
    norms = frobenius(chain.jacobian(poses))
    model = GaussianForwardModel(0.1, float(np.median(norms)))
    drawn, clipped = model.sample(chain, poses, step, np.random.default_rng(3))
    beyond = norms > model.u
    assert clipped == beyond.sum() == 100
    nominal = poses + np.matvec(chain.inverse_jacobian(poses), step)
    assert np.array_equal(drawn[beyond], nominal[beyond]) and not np.any(drawn[~beyond] == nominal[~beyond])
    with pytest.raises(ModelDomainError, match="as at 100 of 200"):
        model.log_density(chain, poses, step, drawn)
    found = model.log_density(chain, poses, step, nominal + 1e-3, MEASUREMENT)
    noise = stats.multivariate_normal(cov=MEASUREMENT).logpdf(np.full(3, 1e-3))
    np.testing.assert_allclose(found[beyond], noise, rtol=1e-10)
    with pytest.raises(ModelDomainError, match="100 of 200 poses"):
        model.require_bound(chain, poses)
    GaussianForwardModel(0.1, float(norms.max())).require_bound(chain, poses)


def test_at_rest_there_is_the_measurement_noise_alone(chain, poses):
    model, rest = GaussianForwardModel(0.1, 2.5), np.zeros(3)
    drawn, clipped = model.sample(chain, poses, rest, np.random.default_rng(4))
    assert np.array_equal(drawn, poses) and clipped == 0
    with pytest.raises(ModelDomainError, match="no density at rest"):
        model.log_density(chain, poses, rest, poses)
    found = model.log_density(chain, poses, rest, poses + 1e-3, MEASUREMENT)
    np.testing.assert_allclose(found, stats.multivariate_normal(cov=MEASUREMENT).logpdf(np.full(3, 1e-3)), rtol=1e-10)


def test_densities_keep_the_shape_of_the_poses(chain, poses, step):
    model = GaussianForwardModel(0.05, 2.5)
    q_next, _ = model.sample(chain, poses, step, np.random.default_rng(5))
    for measurement, gap in ((None, 1e-12), (MEASUREMENT, 1e-9)):
        many = model.log_density(chain, poses, step, q_next, measurement)
        grid = model.log_density(chain, poses.reshape(20, 10, 3), step, q_next.reshape(20, 10, 3), measurement)
        assert many.shape == (200,) and grid.shape == (20, 10)
        np.testing.assert_allclose(grid.ravel(), many, rtol=gap)
    assert model.log_density(chain, poses[0], step, q_next[0]).shape == ()


@pytest.mark.parametrize(("alpha", "u"), [(-0.1, 2.0), (np.inf, 2.0), (np.nan, 2.0), (0.1, 0.0), (0.1, np.inf)])
def test_parameters_outside_the_models_range_are_refused(alpha, u):
    with pytest.raises(ModelDomainError):
        GaussianForwardModel(alpha, u)
