"""Simulated recordings have the laboratory's motions and noise."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import chi2
from standard_errors import largest_score

from pipeline.core import rng
from pipeline.laboratory import dynamics
from pipeline.laboratory.causes import cause_names, dynamics_type
from pipeline.laboratory.options import DynamicsOptions
from pipeline.studies.simulated import (
    SIZES,
    disturb,
    dynamics_of_cause,
    measure_poses,
    observe,
    perform,
)

STILL = dict.fromkeys(SIZES, 0.0)


def test_a_condition_without_factors_moves_as_the_recorded_takes_of_its_seed(
    laboratory,
):
    options = laboratory.dynamics
    stream = rng.stream(5, "record.session")
    session = dynamics.open_session(laboratory.chain, options, stream)
    poses, seen = perform(laboratory, {}, 5, "test", 2)
    for number in range(2):
        stream = rng.stream(5, "record.test", number)
        motion = dynamics.perform(session, laboratory.motion, options, stream)
        duration = laboratory.motion.duration
        frames = dynamics.depth_frames(motion.swing, duration, laboratory.clock, stream)
        assert_array_equal(poses[number], motion.motion_capture)
        assert_array_equal(seen[number].joints, frames.joints)


def test_a_factor_scales_its_disturbances_alone(laboratory):
    options = laboratory.dynamics
    changed = replace(options, clearance=10 * options.clearance)
    assert disturb(options, {"clearance": 10.0}) == changed != options


@pytest.mark.parametrize("cause", cause_names())
def test_the_size_of_a_cause_scales_what_the_cause_sets(cause):
    options = dynamics_type(cause)()
    shared = DynamicsOptions()
    twice = dynamics_of_cause(cause, 2.0)
    assert dynamics_of_cause(cause, 1.0) == options != twice

    for name in SIZES:
        size = getattr(options, name)
        factor = 1.0 if size == getattr(shared, name) else 2.0
        assert_allclose(getattr(twice, name), factor * np.array(size))


def test_measured_poses_have_the_noise_of_the_motion_capture_times_its_factor(
    laboratory,
):
    poses, _ = perform(laboratory, STILL, 5, "train", 8)
    factor = 3.0
    stream = default_rng(3)
    noise = measure_poses(poses, laboratory.pose_noise, factor, stream) - poses
    root = factor * np.linalg.cholesky(laboratory.pose_noise)
    squares = np.sum(np.linalg.solve(root, noise.reshape(-1, 3).T) ** 2, axis=1)

    # 1 in 1000 for each of three axes
    low, high = chi2.ppf([5e-4, 1 - 5e-4], noise.size // 3)
    assert np.all((low < squares) & (squares < high))
    # the control: another factor would be seen
    assert not np.any((low < squares * 1.2) & (squares * 1.2 < high))


def test_the_depth_cameras_noise_has_the_interpolated_moments(laboratory):
    shares = np.full(20_000, 0.25)
    draws = laboratory.depth_noise.sample(shares, default_rng(4))
    variance = 0.75 * 1e-4 + 0.25 * 4e-4

    assert largest_score(draws, [0.015, 0.01, 0.0]) < 4
    band = 4 * variance * np.sqrt(2 / len(draws))
    assert_allclose(np.cov(draws.T), variance * np.eye(3), atol=band)


def test_the_depth_cameras_bias_is_estimated_over_the_motion(laboratory):
    _, camera = observe(laboratory, STILL | {"motion_capture": 0.0}, 5, 2, 12)
    rows = camera.noise[camera.noise["take"] == "none"]
    share = rows["t"].to_numpy() / laboratory.motion.duration
    band = 4.5 * np.sqrt((1e-4 + share * 3e-4) / 12)

    assert np.all(np.abs(rows["b:a"] - 0.02 * (1 - share)) < band)
    assert np.all(np.abs(rows["b:b"] - 0.04 * share) < band)
