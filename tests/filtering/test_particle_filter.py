"""The particle filter's limits, invariances and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from pipeline.core.errors import ConfigError, DegenerateFilterError, ModelDomainError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Posterior, Start, particle_filter
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.model import open_loop
from pipeline.models.scaled.law import ScaledModel

DT = 0.01
STILL = Start(np.array([0.3, -0.2, 0.5]), np.zeros((3, 3)))
START = replace(
    STILL, covariance=1e-4 * np.array([[4.0, 1.0, 0.0], [1.0, 3.0, -1.0], [0.0, -1.0, 2.0]])
)


DIFFUSING = ScaledModel(0.005**2 * np.eye(3))
EXACT = ScaledModel(np.zeros((3, 3)))


def measurements_near(start: Start, steps: np.ndarray, rate: float = 30.0) -> Measurements:
    """Measurements of the commanded path at ``rate`` frames a second, off by about their standard
    deviation of 0.02 rad.
    """
    t = np.arange(0.0, DT * len(steps), 1 / rate)
    path = start.mean + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    y = np.stack([np.interp(t, DT * np.arange(len(path)), path[:, j]) for j in range(3)], axis=1)
    y += 0.02 * np.random.default_rng(11).standard_normal(y.shape)
    return Measurements(
        "test01", t, y, np.zeros_like(y), np.tile(0.02**2 * np.eye(3), (len(t), 1, 1))
    )


STEPS = 0.01 * np.stack(
    [np.sin(0.1 * np.arange(60)), np.cos(0.07 * np.arange(60)), np.ones(60)], axis=1
)
FRAMES = measurements_near(START, STEPS)
UNSEEN = Measurements(
    "test01", np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3, 3))
)


def filtered(model, chain, steps, start, measurements=UNSEEN, *, rng=0, **options) -> Posterior:
    return particle_filter(
        model,
        chain,
        open_loop(steps),
        DT,
        start,
        measurements,
        FilterOptions(**options),
        np.random.default_rng(rng),
    )


def test_without_any_noise_the_filter_follows_the_commanded_polygon(free):
    t = np.array([0.0, 0.0175, 0.03, 0.0312, 0.0388])
    steps = 0.1 * np.random.default_rng(2).standard_normal((5, 3))
    path = STILL.mean + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    on_path = np.stack([np.interp(t, DT * np.arange(6), path[:, j]) for j in range(3)], axis=1)
    y = on_path + 0.01
    measurements = Measurements(
        "test01", t, y, np.full((5, 3), 0.003), np.tile(1e-4 * np.eye(3), (5, 1, 1))
    )
    posterior = filtered(EXACT, free, steps, STILL, measurements, particles=50)
    np.testing.assert_allclose(posterior.mean, path, atol=1e-14)
    assert np.all(np.abs(posterior.covariance) < 1e-28)
    assert posterior.measured.tolist() == [True, False, True, True, True, False]
    assert posterior.log_evidence == pytest.approx(
        norm.logpdf(y, on_path + 0.003, 0.01).sum(), rel=1e-12
    )


def test_without_resampling_the_weights_degenerate_and_with_it_they_do_not(free):
    steps = np.tile([0.01, -0.005, 0.0], (320, 1))
    measurements = measurements_near(START, steps)
    ess = {}
    for scheme in ("none", "systematic"):
        posterior = filtered(
            DIFFUSING, free, steps, START, measurements, rng=1, particles=1000, resampling=scheme
        )
        assert posterior.resampled.any() == (scheme == "systematic")
        ess[scheme] = posterior.ess[160:][posterior.measured[160:]]
    assert np.max(ess["none"]) < 10
    assert np.median(ess["systematic"]) > 200


def test_resampling_happens_exactly_where_the_effective_sample_size_is_below_the_threshold(free):
    for threshold in (0.0, 0.3, 1.0):
        posterior = filtered(
            DIFFUSING, free, STEPS, START, FRAMES, rng=3, particles=500, threshold=threshold
        )
        assert np.array_equal(posterior.resampled, posterior.ess < threshold * 500)
        assert posterior.resampled.any() == (threshold > 0)


def test_estimates_are_formed_before_resampling(free):
    kept, resampled = (
        filtered(DIFFUSING, free, STEPS, START, FRAMES, rng=3, particles=500, resampling=scheme)
        for scheme in ("none", "systematic")
    )
    first = int(np.argmax(resampled.resampled))
    assert np.array_equal(kept.mean[: first + 1], resampled.mean[: first + 1])
    assert np.array_equal(kept.covariance[: first + 1], resampled.covariance[: first + 1])
    assert not np.array_equal(kept.mean[first + 1], resampled.mean[first + 1])


def test_equal_streams_give_equal_bytes_and_others_do_not(free):
    one, same, other = (
        filtered(DIFFUSING, free, STEPS, START, FRAMES, rng=seed, particles=200)
        for seed in (1, 1, 2)
    )
    assert (
        one.mean.tobytes() == same.mean.tobytes()
        and one.covariance.tobytes() == same.covariance.tobytes()
    )
    assert one.log_evidence == same.log_evidence
    assert one.mean.tobytes() != other.mean.tobytes()


def test_particles_beyond_the_joint_limits_are_counted_once_and_lose_their_weight(free):
    drift = np.tile([0.01, 0.0, 0.0], (3, 1))
    spread = Start(np.zeros(3), np.diag([0.02**2, 0.0, 0.0]))
    walled = replace(free, upper=np.array([0.03, 1.0, 1.0]))
    posterior = filtered(EXACT, walled, drift, spread, rng=8, particles=1000, resampling="none")
    # all that remain share the weight, so the effective sample size is their number and the
    # evidence their share
    assert np.all(posterior.outside[1:] > 0)
    np.testing.assert_allclose(posterior.ess, 1000 - np.cumsum(np.append(0, posterior.outside[1:])))
    assert posterior.log_evidence == pytest.approx(np.log(posterior.ess[-1] / 1000))
    assert np.all(posterior.mean[:, 0] < 0.03)


def test_the_models_clipped_noises_are_recorded_with_their_step(elbow):
    path = np.array([[0.3, x, 0.5] for x in (-0.2, -0.5, -0.8, -0.5, -0.2)])
    steps = np.matvec(elbow.jacobian(path[:-1]), np.diff(path, axis=0))
    norm = np.linalg.norm(elbow.inverse_jacobian(path[:-1]), axis=(1, 2))
    model = GaussianModel(0.0, float(np.median(norm)) * 1.001)
    start = replace(STILL, mean=path[0])
    posterior = filtered(model, elbow, 0.1 * steps, start, particles=10)
    assert posterior.clipped.tolist() == [0, 0, 0, 0, 0]
    model = GaussianModel(0.0, 0.99 * float(norm[0]))
    posterior = filtered(model, elbow, np.zeros((2, 3)), start, particles=10)
    assert posterior.clipped.tolist() == [0, 10, 10]


def test_when_every_particle_leaves_the_joint_limits_the_take_the_step_and_the_time_are_named(free):
    narrow = replace(free, upper=np.array([0.335, 50.0, 50.0]))
    steps = np.tile([0.01, 0.0, 0.0], (9, 1))
    with pytest.raises(DegenerateFilterError, match="every particle has left") as caught:
        filtered(EXACT, narrow, steps, STILL, particles=20)
    assert caught.value.evidence == {"take": "test01", "step": 4, "time": 0.04}


def test_a_step_that_is_no_number_is_refused(free):
    with pytest.raises(DegenerateFilterError, match="step 1"):
        filtered(DIFFUSING, free, np.full((3, 3), np.nan), START, FRAMES, particles=20)


def test_a_far_outlier_is_weighed_without_underflow(free):
    far = Measurements(
        "test01", np.array([0.02]), np.full((1, 3), 40.0), np.zeros((1, 3)), 1e-6 * np.eye(3)[None]
    )
    posterior = filtered(DIFFUSING, free, STEPS, START, far, particles=100)
    assert posterior.ess[2] == pytest.approx(1.0)
    assert -np.inf < posterior.log_evidence < -1e8


def test_particles_at_a_singular_pose_have_left_the_domain(elbow):
    # the elbow stretches at q2 = −π/2, which the third of these steps reaches
    def commands(share: float) -> np.ndarray:
        move = share * (-np.pi / 2 - STILL.mean[1]) / 3
        path = STILL.mean + np.outer(np.arange(5), [0.0, move, 0.0])
        return np.matvec(elbow.jacobian(path[:-1]), np.diff(path, axis=0))

    with pytest.raises(DegenerateFilterError) as caught:
        filtered(EXACT, elbow, commands(1.0)[:3], STILL, particles=5)
    assert caught.value.evidence["take"] == "test01" and caught.value.evidence["step"] == 3
    # control: a shorter step does not get there
    assert filtered(EXACT, elbow, commands(0.9)[:3], STILL, particles=5).outside.sum() == 0


@pytest.mark.parametrize("covariance", [np.diag([1.0, 1.0, -0.1]), np.full((3, 3), np.nan)])
def test_a_start_that_no_normal_law_has_is_refused(covariance, free):
    with pytest.raises(ModelDomainError, match="start poses"):
        filtered(EXACT, free, STEPS, Start(np.zeros(3), covariance), particles=5)


def test_a_start_beyond_the_joint_limits_is_refused(free):
    with pytest.raises(DegenerateFilterError, match="start poses lies within"):
        filtered(EXACT, free, STEPS, replace(STILL, mean=np.full(3, 60.0)), particles=5)


@pytest.mark.parametrize(
    "options", [{"particles": 0}, {"resampling": "branching"}, {"threshold": 1.5}]
)
def test_an_option_that_does_not_exist_is_refused_with_what_there_is(options):
    with pytest.raises(ConfigError, match=f"filter.{next(iter(options))}"):
        FilterOptions(**options)
