"""Noise that grows with the joint speed: its law, its density, and its limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pipeline.core.errors import ModelDomainError
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.draws import draw_steps
from pipeline.models.scaled.law import ScaledModel, scaled_covariance

FLOOR = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
GAIN = np.array([[0.04, -0.02, 0.01], [-0.02, 0.09, 0.0], [0.01, 0.0, 0.05]])
FORMS = {
    "scaled": (np.diag(np.diag(FLOOR)), np.diag(np.diag(GAIN))),
    "scaled_full": (FLOOR, GAIN),
    "timing": (FLOOR, np.full((3, 3), 0.04)),
}


@pytest.fixture(params=FORMS)
def model(request) -> ScaledModel:
    return ScaledModel(*FORMS[request.param])


def test_draws_have_the_models_mean_and_covariance(model, chain, poses, step):
    q = np.tile(poses[0], (100_000, 1))
    drawn, clipped = draw_steps(model, chain, q, step, np.random.default_rng(70))
    expected = model.covariance(chain, poses[0], step)
    error = np.abs(drawn.mean(axis=0) - model.mean(chain, poses[0], step)) / np.sqrt(
        np.diag(expected) / len(q)
    )
    assert error.max() < 4
    # relative to the spread of sqrt(2/N) of a variance
    assert np.linalg.norm(np.cov(drawn.T) - expected) < 0.03 * np.linalg.norm(expected)
    # control: at another speed the covariance is another
    assert np.linalg.norm(
        np.cov(drawn.T) - model.covariance(chain, poses[0], 2 * step)
    ) > 0.3 * np.linalg.norm(expected)
    assert clipped == 0


def test_each_form_is_the_formula_it_stands_for(chain, poses, step):
    dq = chain.nominal_step(poses, step)
    np.testing.assert_allclose(
        np.matvec(chain.jacobian(poses), dq), np.broadcast_to(step, dq.shape), atol=1e-12
    )
    diagonal = ScaledModel(*FORMS["scaled"]).covariance(chain, poses, step)
    np.testing.assert_allclose(
        np.diagonal(diagonal, axis1=1, axis2=2), np.diag(FLOOR) + np.diag(GAIN) * dq**2, rtol=1e-14
    )
    assert not diagonal[:, ~np.eye(3, dtype=bool)].any()
    timing = ScaledModel(*FORMS["timing"]).covariance(chain, poses, step)
    np.testing.assert_allclose(timing, FLOOR + 0.04 * dq[:, :, None] * dq[:, None, :], rtol=1e-12)


def test_without_gain_it_is_the_additive_model(chain, poses, step):
    model, additive = ScaledModel(FLOOR, np.zeros((3, 3))), AdditiveModel(FLOOR)
    q_next = poses + np.random.default_rng(71).normal(0, 0.01, poses.shape)
    assert np.array_equal(
        model.covariance(chain, poses, step), additive.covariance(chain, poses, step)
    )
    np.testing.assert_allclose(
        model.log_density(chain, poses, step, q_next),
        additive.log_density(chain, poses, step, q_next),
        rtol=1e-9,
    )
    # control: with gain it is another
    other = ScaledModel(FLOOR, GAIN).log_density(chain, poses, step, q_next)
    assert np.abs(other - additive.log_density(chain, poses, step, q_next)).max() > 0.1


def test_without_timing_error_and_without_floor_all_noise_lies_along_the_joint_step(
    chain, poses, step
):
    noise = draw_steps(
        ScaledModel(np.zeros((3, 3)), np.full((3, 3), 0.04)),
        chain,
        poses,
        step,
        np.random.default_rng(72),
    )[0]
    noise -= poses + chain.nominal_step(poses, step)
    np.testing.assert_allclose(np.cross(noise, chain.nominal_step(poses, step)), 0, atol=1e-9)
    assert np.linalg.norm(noise, axis=1).min() > 0
    still = ScaledModel(np.zeros((3, 3)), np.zeros((3, 3)))
    np.testing.assert_allclose(
        draw_steps(still, chain, poses, step, np.random.default_rng(72))[0],
        still.mean(chain, poses, step),
        rtol=1e-13,
    )


def test_at_rest_only_the_floor_is_left(model, chain, poses):
    assert np.array_equal(
        model.covariance(chain, poses, np.zeros(3)),
        np.broadcast_to(model.floor, (len(poses), 3, 3)),
    )


@pytest.mark.parametrize(
    "measurement", [None, 1e-5 * np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]])]
)
def test_the_log_density_is_scipys(measurement, model, chain, poses, step):
    q_next = poses + np.random.default_rng(73).normal(0, 0.01, poses.shape)
    result = model.log_density(chain, poses, step, q_next, measurement)
    means, covariances = model.mean(chain, poses, step), model.covariance(chain, poses, step)
    added = 0.0 if measurement is None else measurement
    expected = [
        multivariate_normal(m, c + added).logpdf(q)
        for m, c, q in zip(means, covariances, q_next, strict=True)
    ]
    np.testing.assert_allclose(result, expected, rtol=1e-9)
    # control: without the measurement's noise the density is another
    assert (
        measurement is None
        or np.abs(model.log_density(chain, poses, step, q_next) - expected).max() > 0.1
    )


def test_the_covariance_is_positive_definite_at_every_speed():
    dq = np.random.default_rng(74).normal(size=(1000, 3)) * 10.0 ** np.random.default_rng(
        75
    ).uniform(-6, 2, (1000, 1))
    direction = np.array([1.0, -1.0, 2.0])
    assert np.all(
        np.linalg.eigvalsh(scaled_covariance(1e-5 * np.eye(3), np.outer(direction, direction), dq))[
            :, 0
        ]
        > 0
    )
    # control: a gain with a negative eigenvalue gives what is no covariance, and is refused
    bad = np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.linalg.eigvalsh(scaled_covariance(1e-5 * np.eye(3), bad, dq))[:, 0].min() < 0
    for matrices in ((np.eye(3), bad), (bad, np.eye(3))):
        with pytest.raises(ModelDomainError, match="positive semidefinite"):
            ScaledModel(*matrices)


def test_where_there_is_no_density_it_says_so_unless_measurement_noise_gives_one(
    chain, poses, step
):
    model = ScaledModel(np.zeros((3, 3)), GAIN)
    assert np.isfinite(model.log_density(chain, poses, step, poses)).all()
    with pytest.raises(ModelDomainError, match="no density"):
        model.log_density(chain, poses, np.zeros(3), poses)
    assert np.isfinite(model.log_density(chain, poses, np.zeros(3), poses, 1e-8 * np.eye(3))).all()
    with pytest.raises(ModelDomainError, match="positive semidefinite"):
        model.log_density(chain, poses, step, poses, -1e-12 * np.eye(3))
