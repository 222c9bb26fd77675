"""The additive model: its law, its fit, and its limit without noise."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import ModelDomainError
from pipeline.models.additive.fit import shrunk_covariance
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.covariance import without_measurement
from pipeline.models.draws import draw_steps
from pipeline.models.noise import mean_covariance

SIGMA = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])


def relative_error(covariance: np.ndarray) -> float:
    return float(np.linalg.norm(covariance - SIGMA) / np.linalg.norm(SIGMA))


def test_draws_have_the_models_mean_and_covariance(chain, poses, step):
    model = AdditiveModel(SIGMA)
    q = np.tile(poses[0], (50_000, 1))
    drawn, clipped = draw_steps(model, chain, q, step, np.random.default_rng(4))
    error = np.abs(drawn.mean(axis=0) - model.mean(chain, poses[0], step)) / np.sqrt(
        np.diag(SIGMA) / len(q)
    )
    assert error.max() < 4
    assert relative_error(np.cov(drawn.T)) < 0.02
    assert np.array_equal(model.covariance(chain, q, step)[7], SIGMA)
    assert clipped == 0


def test_the_fit_recovers_the_covariance_although_every_step_has_another_mean():
    rng = np.random.default_rng(5)
    noise = rng.multivariate_normal(np.zeros(3), SIGMA, (100, 320)) + 0.01 * rng.standard_normal(
        (320, 3)
    )
    assert relative_error(mean_covariance(noise)) < 0.02
    # control: pooled over the steps, the spread of the means would enter
    assert relative_error(np.cov(noise.reshape(-1, 3).T)) > 0.5


def test_without_noise_the_step_is_the_nominal_one(chain, poses, step):
    model = AdditiveModel(np.zeros((3, 3)))
    np.testing.assert_allclose(
        draw_steps(model, chain, poses, step, np.random.default_rng(6))[0],
        model.mean(chain, poses, step),
        atol=1e-14,
    )


def test_a_singular_covariance_is_a_covariance(chain, poses, step):
    direction = np.array([1.0, -2.0, 1.0])
    model = AdditiveModel(1e-5 * np.outer(direction, direction))
    noise = draw_steps(model, chain, poses, step, np.random.default_rng(7))[0] - model.mean(
        chain, poses, step
    )
    np.testing.assert_allclose(np.cross(noise, direction), 0, atol=1e-8)
    assert np.linalg.norm(noise, axis=1).min() > 0


@pytest.mark.parametrize(
    "bad",
    [np.diag([1.0, 1.0, -0.1]), np.triu(np.ones((3, 3))), np.ones((2, 3)), np.full((3, 3), np.nan)],
)
def test_what_is_not_a_covariance_is_refused(bad):
    with pytest.raises(ModelDomainError, match="covariance must be"):
        AdditiveModel(bad)


def test_shrinkage_is_nearer_to_the_truth_where_takes_are_few_and_vanishes_where_they_are_many():
    rng = np.random.default_rng(5)
    true = np.diag([1.0, 1.5, 2.0])
    errors = np.zeros(2)
    for _ in range(200):
        noise = rng.multivariate_normal(np.zeros(3), true, (3, 4))
        shrunk, intensity = shrunk_covariance(noise)
        assert 0 < intensity <= 1
        errors += [np.sum((shrunk - true) ** 2), np.sum((mean_covariance(noise) - true) ** 2)]
    assert errors[0] < 0.6 * errors[1]
    many = rng.multivariate_normal(np.zeros(3), true, (400, 10))
    shrunk, intensity = shrunk_covariance(many)
    assert intensity < 0.02
    np.testing.assert_allclose(
        shrunk,
        (1 - intensity) * mean_covariance(many)
        + intensity * np.trace(mean_covariance(many)) / 3 * np.eye(3),
    )


def test_the_measurement_noise_is_taken_off_and_never_more_than_there_is():
    covariance, quiet = without_measurement(np.diag([3.0, 2.0, 1.0]), np.diag([1.0, 1.0, 1.5]))
    np.testing.assert_allclose(covariance, np.diag([2.0, 1.0, 0.0]), atol=1e-15)
    assert quiet == 1


def test_a_covariance_of_fewer_joints_has_no_compiled_step(chain):
    with pytest.raises(ModelDomainError, match="3 joints"):
        AdditiveModel(np.eye(2)).law(chain)
