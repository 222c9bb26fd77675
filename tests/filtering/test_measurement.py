"""Measurements: the step at which each enters, and their noise from each instrument's tables."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from sequences import correlated
from space_arms import LWR4

from pipeline.core import contracts
from pipeline.core.columns import pairs, spread
from pipeline.core.errors import ConfigError, ModelDomainError
from pipeline.core.options.dataset import Dataset, Encoders, Motion
from pipeline.filtering.measurement import (
    MOTION,
    TRACK,
    Measurements,
    encoder_noise,
    measured_takes,
    measurements,
)


def measurements_at(t, **changed) -> Measurements:
    """Measurements of three joints at the times ``t`` in s, with some arrays ``changed``."""
    rng = default_rng(3)
    root = 0.05 * rng.standard_normal((len(t), 3, 3))
    arrays = {
        "y": rng.standard_normal((len(t), 3)),
        "bias": 0.1 * rng.standard_normal((len(t), 3)),
        "covariance": root @ np.swapaxes(root, 1, 2) + 1e-4 * np.eye(3),
    }
    times = np.array(t, dtype=float)
    return Measurements("test07", times, **(arrays | changed))


@pytest.mark.parametrize(
    ("times", "frames", "steps", "shares"),
    [
        (
            [0.004, 0.0151, 0.019, 0.0],
            [3, 0, 1, 2],
            [0, 1, 2, 2],
            [1.0, 0.4, 0.51, 0.9],
        ),
        # those before the start and after the end of the motion do not enter
        ([-0.02, -1e-4, 0.0, 0.05, 0.0501], [2, 3], [0, 5], [1.0, 1.0]),
    ],
)
def test_a_frame_enters_at_the_step_during_which_it_was_taken(
    times,
    frames,
    steps,
    shares,
):
    frame, step, share = measurements_at(times).schedule(5, 0.01)

    assert frame.tolist() == frames
    assert step.tolist() == steps
    assert_allclose(share, shares)


def test_without_frames_none_enters_a_step():
    assert measurements_at([]).frames(5, 0.01).first.tolist() == [0] * 7


def test_a_frame_on_the_grid_enters_at_that_very_step_whatever_the_rounding_of_its_time():
    t = np.arange(321) / 100
    steps = np.arange(321)
    for times in (t, steps * 0.01, np.nextafter(t, 9.0), np.nextafter(t, -9.0)):
        frame, step, share = measurements_at(times).schedule(320, 0.01)
        assert_array_equal(frame, steps)
        assert_array_equal(step, steps)
        assert np.all(share == 1)


@pytest.mark.parametrize(
    "covariance",
    [np.diag([1.0, 1.0, 0.0]), np.diag([1.0, -1.0, 1.0]), np.ones((3, 3))],
)
def test_a_covariance_that_is_not_positive_definite_is_refused_with_its_frame(
    covariance,
):
    covariances = np.stack([np.eye(3), covariance])
    with pytest.raises(ModelDomainError, match="frame 1") as caught:
        _ = measurements_at([0.0, 0.1], covariance=covariances).whitening
    assert caught.value.evidence == {"take": "test07", "frame": 1}


def camera_rows(takes: list[str], frames: list[int], **columns) -> pd.DataFrame:
    """Rows of a table of the depth camera."""
    return pd.DataFrame({"take": takes, "frame": frames} | columns)


def test_every_take_of_the_camera_goes_with_the_noise_that_was_estimated_without_it():
    q = {"q:a": 1.0, "q:b": 2.0, "q:c": 3.0}
    frames = [1, 2, 1, 2]
    angles = camera_rows(["b", "b", "a", "a"], frames, t=frames, **q)
    entries = [[1.0, 2.0, 3.0, 4.0], 0.1, 0.2, 5.0, 0.3, 6.0]
    covariances = dict(zip(pairs("r", ("a", "b", "c")), entries, strict=True))
    biases = {"b:a": [0.1, 0.2, 0.3, 0.4], "b:b": 0.0, "b:c": 0.0}
    takes = ["a", "a", "b", "none"]
    noise = camera_rows(takes, [1, 2, 1, 1], t=0.1, **biases, **covariances)

    first, second = measurements(angles, noise)

    assert (first.take, second.take) == ("a", "b")
    assert_array_equal(first.bias[:, 0], [0.1, 0.2])
    expected = [[2.0, 0.1, 0.2], [0.1, 5.0, 0.3], [0.2, 0.3, 6.0]]
    assert_array_equal(first.covariance[1], expected)
    # the frame of b that no other take has is left out
    assert second.t.tolist() == [1] and second.bias[0, 0] == 0.3


TAKES = 400
STEPS = 300
DT = 0.01
SPREAD = np.array([[4.0, 1.0], [1.0, 3.0]]) * 1e-6
BIAS = 1e-2 * np.linspace(-1, 1, STEPS)


def encoder_errors(keep: float) -> np.ndarray:
    """(TAKES, STEPS, 2) rad errors of which a share ``keep`` is left after a step, about a bias."""
    draws = default_rng(1).standard_normal((TAKES, STEPS, 2))
    errors = correlated(draws @ np.linalg.cholesky(SPREAD).T, keep, axis=1)
    return errors + BIAS[:, None]


@pytest.mark.parametrize("keep", [0.0, 0.8])
def test_bias_covariance_and_duration_of_encoder_errors_are_those_drawn(keep):
    errors = encoder_errors(keep)
    noise = encoder_noise(errors, DT)

    assert_allclose(noise.bias[:, 0], BIAS, atol=5e-4)
    for covariance in noise.covariance:
        assert_allclose(covariance, SPREAD, atol=6e-7)
    # the correlations of both signs of lag; a sum over 800 sequences has a standard error of 5 %
    assert noise.lasts / DT == pytest.approx((1 + keep) / (1 - keep), rel=0.15)

    _, apart = noise.of_readings(np.array([0.0, 1.0, 2.0]))
    assert_array_equal(apart, noise.covariance[[0, 100, 200]])


def test_the_covariance_of_few_takes_is_not_biased_by_their_mean():
    """Four takes: divided by their number, it would be a quarter too small."""
    rng = default_rng(3)
    zero = np.zeros(len(SPREAD))
    covariances = []
    for _ in range(400):
        errors = rng.multivariate_normal(zero, SPREAD, (4, 40))
        covariances.append(encoder_noise(errors, DT).covariance)
    mean = np.mean(covariances, axis=(0, 1))

    assert_allclose(mean, SPREAD, atol=0.05 * SPREAD.max())


DATASET = Dataset(
    name="t",
    recordings=".",
    robot=LWR4,
    encoders=Encoders(training="*", test="*", actual=[]),
    motion=Motion(rate=100.0, steps=4),
    measurement="encoders",
)


@pytest.mark.parametrize("keep", [0.0, 0.8])
@pytest.mark.parametrize("every", [1, 4])
def test_readings_taken_for_independent_tell_as_much_of_a_constant_as_they_know(
    keep,
    every,
):
    """However dense the readings are."""
    errors = encoder_errors(keep)
    places = np.arange(0, STEPS, every)
    bias, covariance = encoder_noise(errors, DT).of_readings(DT * places)

    information = np.linalg.inv(covariance)
    told = np.linalg.inv(information.sum(axis=0))
    means = np.einsum("kij,tkj->ti", told @ information, errors[:, places] - bias)

    assert_allclose(np.cov(means.T), told, atol=0.25 * told.max())


def test_errors_of_a_shorter_stretch_are_of_their_own_size():
    errors = encoder_errors(0.0)
    errors[:, 200:] *= 5
    noise = encoder_noise(errors - errors.mean(axis=0), DT)

    for step, size in ((100, 1), (260, 25)):
        assert_allclose(noise.covariance[step], size * SPREAD, atol=size * 8e-7)


@pytest.fixture
def tables(tmp_path, monkeypatch):
    """Two test takes, a third that track left out, and thirty training ones."""
    monkeypatch.chdir(tmp_path)
    k = np.arange(5)
    t = np.arange(9) / 200
    pose = spread("q", LWR4.joints, np.full((5, 7), 0.3))
    uses = {f"train_{number}": "training" for number in range(1, 31)}
    uses |= dict.fromkeys(("test_1", "test_2", "test_3"), "test")
    rng = default_rng(1)
    joints = []
    read = []
    for take, use in uses.items():
        named = {"take": take, "part": use}
        if take != "test_3":
            joints.append(pd.DataFrame(named | {"k": k, "t": k / 100} | pose))
        # the first joint's errors are off by 0.02 rad all the same
        y = 0.3 + 2e-3 * rng.standard_normal((9, 7)) + 0.02 * np.eye(7)[0]
        if use == "test":
            y = np.full((9, 7), float(take[-1]))
        read.append(pd.DataFrame(named | {"t": t} | spread("q", LWR4.joints, y)))

    MOTION.mkdir(parents=True)
    TRACK.mkdir(parents=True)
    contracts.write(pd.concat(joints).assign(residual=0.0), "joints", TRACK)
    contracts.write(pd.concat(read), "encoders", MOTION)


def test_the_takes_that_stay_are_measured_by_the_chosen_instrument(tables):
    by_encoders = measured_takes(DATASET)
    assert [take.take for take in by_encoders] == ["test_1", "test_2"]

    second = by_encoders[1]
    # every second reading: one a step of the motion
    assert (second.y == 2.0).all() and second.y.shape == (5, 7)
    assert_allclose(second.t, np.arange(5) / 100)
    assert_allclose(second.bias.mean(axis=0), [0.02] + [0.0] * 6, atol=8e-4)
    assert_allclose(second.covariance[2], 4e-6 * np.eye(7), atol=2e-6)
    assert measured_takes(replace(DATASET, measurement="depth")) == []


def test_an_instrument_that_the_dataset_does_not_have_is_refused(tables):
    with pytest.raises(ConfigError, match="the dataset does not have"):
        measured_takes(replace(DATASET, encoders=None))
    table = contracts.read("encoders", MOTION)
    contracts.write(table[table["take"] != "test_2"], "encoders", MOTION)
    with pytest.raises(ConfigError, match="no measurements of the takes test_2"):
        measured_takes(DATASET)
