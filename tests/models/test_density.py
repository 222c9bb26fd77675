"""Log densities of the models with a normal step against scipy's, and where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pipeline.core.errors import ModelDomainError
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.density import normal_log_density
from pipeline.models.gaussian.law import GaussianModel

PROCESS = np.array([[3.3, -4.0, 5.9], [-4.0, 5.5, -8.4], [5.9, -8.4, 24.6]]) * 1e-5
MEASUREMENT = np.array([[0.6, -0.6, 0.0], [-0.6, 1.5, -0.9], [0.0, -0.9, 1.7]]) * 1e-6


@pytest.mark.parametrize("measurement", [None, MEASUREMENT])
@pytest.mark.parametrize("model", [AdditiveModel(PROCESS), GaussianModel(0.1, 40.0)])
def test_the_density_of_a_normal_step_is_scipys(chain, poses, step, model, measurement):
    q_next = poses + 0.02 * np.random.default_rng(0).standard_normal(poses.shape)
    result = model.log_density(chain, poses, step, q_next, measurement)
    mean, covariance = model.mean(chain, poses, step), model.covariance(chain, poses, step)
    total = covariance if measurement is None else covariance + measurement
    expected = [
        stats.multivariate_normal(m, c).logpdf(x)
        for x, m, c in zip(q_next, mean, total, strict=True)
    ]
    np.testing.assert_allclose(result, expected, rtol=1e-9)
    # control: the other noise is another density
    other = covariance + MEASUREMENT if measurement is None else covariance
    wrong = [
        stats.multivariate_normal(m, c).logpdf(x)
        for x, m, c in zip(q_next, mean, other, strict=True)
    ]
    assert np.abs(result - wrong).min() > 1e-6


def test_the_gaussian_model_has_a_density_at_rest_and_beyond_its_bound_with_measurement_noise_alone(
    chain, poses, step
):
    model = GaussianModel(0.1, 14.5)
    beyond = np.array([0.0, np.deg2rad(20.0), 0.0])
    for q, v in ((poses[0], np.zeros(3)), (beyond, step)):
        mean = model.mean(chain, q, v)
        with pytest.raises(ModelDomainError, match="singular at 1 of 1 step"):
            model.log_density(chain, q, v, mean)
        expected = stats.multivariate_normal(mean, MEASUREMENT).logpdf(mean + 1e-3)
        np.testing.assert_allclose(
            model.log_density(chain, q, v, mean + 1e-3, MEASUREMENT), expected, rtol=1e-9
        )


def test_a_singular_covariance_has_no_density(chain, poses, step):
    flat = AdditiveModel(np.outer([1.0, -1.0, 2.0], [1.0, -1.0, 2.0]) * 1e-5)
    with pytest.raises(ModelDomainError, match="give the covariance of the measurement noise"):
        flat.log_density(chain, poses, step, poses)
    assert np.all(np.isfinite(flat.log_density(chain, poses, step, poses, MEASUREMENT)))


@pytest.mark.parametrize(
    "covariance",
    [np.diag([1.0, -1.0, 1.0]), np.triu(np.ones((3, 3))), np.full((3, 3), np.nan), np.ones(3)],
)
def test_what_is_no_covariance_is_refused(covariance):
    with pytest.raises(ModelDomainError, match="a covariance must be"):
        normal_log_density(np.zeros(3), 1.0, covariance)
