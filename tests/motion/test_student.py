"""Additive noise of heavy tails: its law, its limits, and where it has moments and a density."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest, multivariate_t
from scipy.stats import t as student_t

from pipeline.errors import ModelDomainError
from pipeline.motion.additive import AdditiveModel
from pipeline.motion.student import StudentModel

SCALE = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
MEASUREMENT = 1e-5 * np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 1.0]])


@pytest.fixture
def q_next(poses) -> np.ndarray:
    """Next poses from within the usual spread to a hundred times beyond it."""
    rng = np.random.default_rng(90)
    return poses + rng.normal(0, 0.01, poses.shape) * 10.0 ** rng.uniform(0, 2, (len(poses), 1))


def test_draws_have_the_models_mean_and_covariance(chain, poses, step):
    model = StudentModel(8.0, SCALE)
    drawn, clipped = model.sample(chain, np.tile(poses[0], (200_000, 1)), step, np.random.default_rng(91))
    expected = model.covariance(chain, poses[0], step)
    error = np.abs(drawn.mean(axis=0) - model.mean(chain, poses[0], step)) / np.sqrt(np.diag(expected) / len(drawn))
    assert error.max() < 4
    assert np.linalg.norm(np.cov(drawn.T) - expected) < 0.03 * np.linalg.norm(expected)
    # control: the scale matrix is not the covariance
    assert np.linalg.norm(np.cov(drawn.T) - SCALE) > 0.2 * np.linalg.norm(SCALE)
    assert clipped == 0


@pytest.mark.parametrize("nu", [0.8, 3.0, 30.0])
def test_every_joints_draws_have_the_one_dimensional_law(nu, chain, poses, step):
    model = StudentModel(nu, SCALE)
    nominal = AdditiveModel(SCALE).mean(chain, poses[0], step)
    drawn = model.sample(chain, np.tile(poses[0], (20_000, 1)), step, np.random.default_rng(92))[0] - nominal
    for joint in range(3):
        white = drawn[:, joint] / np.sqrt(SCALE[joint, joint])
        assert kstest(white, student_t(nu).cdf).pvalue > 1e-3
        # control: half the degrees of freedom are told apart while the tails are heavy
        assert nu > 10 or kstest(white, student_t(nu / 2).cdf).pvalue < 1e-6


@pytest.mark.parametrize("nu", [0.8, 3.0, 30.0])
def test_the_log_density_is_scipys(nu, chain, poses, step, q_next):
    model = StudentModel(nu, SCALE)
    nominal = AdditiveModel(SCALE).mean(chain, poses, step)
    expected = multivariate_t(np.zeros(3), SCALE, df=nu).logpdf(q_next - nominal)
    np.testing.assert_allclose(model.log_density(chain, poses, step, q_next), expected, rtol=1e-10)


def test_with_many_degrees_of_freedom_it_is_the_additive_model(chain, poses, step):
    q_next = poses + np.random.default_rng(93).normal(0, 0.01, poses.shape)
    additive = AdditiveModel(SCALE)
    for measurement, nu in ((None, 1e10), (MEASUREMENT, 1e7)):
        expected = additive.log_density(chain, poses, step, q_next, measurement)
        found = StudentModel(nu, SCALE).log_density(chain, poses, step, q_next, measurement)
        np.testing.assert_allclose(found, expected, atol=1e-2 if measurement is not None else 1e-4)
        # control: with few it is not
        assert np.abs(StudentModel(5.0, SCALE).log_density(chain, poses, step, q_next, measurement) - expected).max() > 1
    np.testing.assert_allclose(StudentModel(1e10, SCALE).covariance(chain, poses[0], step), SCALE, rtol=1e-9)


def test_measurement_noise_of_zero_changes_nothing_and_of_a_thousandth_little(chain, poses, step, q_next):
    model = StudentModel(3.0, SCALE)
    exact = model.log_density(chain, poses, step, q_next)
    np.testing.assert_allclose(model.log_density(chain, poses, step, q_next, np.zeros((3, 3))), exact, atol=1e-9)
    np.testing.assert_allclose(model.log_density(chain, poses, step, q_next, 1e-6 * MEASUREMENT), exact, atol=1e-5)
    # control: of its own size it changes much
    assert np.abs(model.log_density(chain, poses, step, q_next, MEASUREMENT) - exact).max() > 0.1


@pytest.mark.parametrize(("nu", "missing"), [(1.0, ("mean", "covariance")), (2.0, ("covariance",)), (2.1, ())])
def test_moments_that_do_not_exist_are_refused(nu, missing, chain, poses, step):
    model = StudentModel(nu, SCALE)
    for name in ("mean", "covariance"):
        if name in missing:
            with pytest.raises(ModelDomainError, match=f"the {name} of a Student step does not exist"):
                getattr(model, name)(chain, poses, step)
        else:
            assert np.isfinite(getattr(model, name)(chain, poses, step)).all()


@pytest.mark.parametrize("nu", [0.0, -1.0, np.inf, np.nan])
def test_degrees_of_freedom_outside_their_range_are_refused(nu):
    with pytest.raises(ModelDomainError, match="degrees of freedom"):
        StudentModel(nu, SCALE)


@pytest.mark.parametrize("scale", [np.diag([1.0, 1.0, -1.0]), np.triu(np.ones((3, 3))), np.full((3, 3), np.nan), np.eye(2)])
def test_a_scale_that_is_no_covariance_is_refused(scale):
    with pytest.raises(ModelDomainError, match="covariance"):
        StudentModel(3.0, scale)


def test_noise_in_a_plane_has_a_density_with_measurement_noise_alone(chain, poses, step, q_next):
    model = StudentModel(3.0, 1e-5 * np.diag([1.0, 0.0, 2.0]))
    noise = model.sample(chain, poses, step, np.random.default_rng(95))[0] - model.mean(chain, poses, step)
    np.testing.assert_allclose(noise[:, 1], 0, atol=1e-12)
    assert np.abs(noise[:, [0, 2]]).min() > 1e-9
    assert np.isfinite(model.log_density(chain, poses, step, q_next, MEASUREMENT)).all()
    for measurement in (None, np.zeros((3, 3))):
        with pytest.raises(ModelDomainError, match="positive definite"):
            model.log_density(chain, poses, step, q_next, measurement)
