"""Simulated recordings have the laboratory's motions and noise."""

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from pipeline.core import rng
from pipeline.laboratory import dynamics
from pipeline.studies.simulated import disturb, measure_poses, observe, perform

STILL = dict(disturbances=0.0)


def test_a_condition_without_factors_moves_as_the_recorded_takes_of_its_seed(
    laboratory,
):
    own, stream = laboratory.dynamics, rng.stream(5, "record.session")
    recorded_session = dynamics.open_session(laboratory.chain, own, stream)
    poses, seen = perform(laboratory, {}, 5, "test", 2)
    for number in range(2):
        stream = rng.stream(5, "record.test", number)
        motion = dynamics.perform(recorded_session, laboratory.motion, own, stream)
        duration = laboratory.motion.duration
        frames = dynamics.depth_frames(motion.swing, duration, laboratory.clock, stream)
        np.testing.assert_array_equal(poses[number], motion.motion_capture)
        np.testing.assert_array_equal(seen[number].joints, frames.joints)


def test_a_factor_scales_its_disturbances_alone(laboratory):
    own = laboratory.dynamics
    for factor, names in (
        ("clearance", ["clearance"]),
        ("lasting", ["sway_time", "clearance_time"]),
    ):
        changed = replace(own, **{name: 10 * getattr(own, name) for name in names})
        assert disturb(own, {factor: 10.0}) == changed != own


def test_measured_poses_have_the_noise_of_the_motion_capture_times_its_factor(
    laboratory,
):
    (poses, _), factor = perform(laboratory, STILL, 5, "train", 8), 3.0
    stream = np.random.default_rng(3)
    noise = measure_poses(poses, laboratory.pose_noise, factor, stream) - poses
    root = factor * np.linalg.cholesky(laboratory.pose_noise)
    squares = np.sum(np.linalg.solve(root, noise.reshape(-1, 3).T) ** 2, axis=1)
    low, high = chi2.ppf(
        [5e-4, 1 - 5e-4], noise.size // 3
    )  # 1 in 1000 for each of three axes
    assert np.all((low < squares) & (squares < high))
    # the control: another factor would be seen
    assert not np.any((low < squares * 1.2) & (squares * 1.2 < high))


def test_the_depth_cameras_noise_has_the_interpolated_moments_and_is_estimated_so(
    laboratory,
):
    draws = laboratory.depth_noise.sample(
        np.full(20_000, 0.25), np.random.default_rng(4)
    )
    variance = 0.75 * 1e-4 + 0.25 * 4e-4
    error = 4 * np.sqrt(variance / len(draws))
    np.testing.assert_allclose(draws.mean(axis=0), [0.015, 0.01, 0.0], atol=error)
    wide = 4 * variance * np.sqrt(2 / len(draws))
    np.testing.assert_allclose(np.cov(draws.T), variance * np.eye(3), atol=wide)
    _, camera = observe(
        laboratory, dict(disturbances=0.0, motion_capture=0.0), 5, 2, 12
    )
    everywhere = camera.noise[camera.noise["take"] == "none"]
    share = everywhere["t"].to_numpy() / laboratory.motion.duration
    error = 4.5 * np.sqrt((1e-4 + share * 3e-4) / 12)
    assert np.all(np.abs(everywhere["b:a"] - 0.02 * (1 - share)) < error)
    assert np.all(np.abs(everywhere["b:b"] - 0.04 * share) < error)
