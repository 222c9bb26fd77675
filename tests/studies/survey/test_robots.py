"""The recordings of a condition: the laboratory's own motions, and noise of the size that
instruments were seen to have.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from pipeline.core import rng
from pipeline.core.errors import ConfigError
from pipeline.laboratory import session
from pipeline.laboratory.swing import desired_joints
from pipeline.studies.survey.conditions import Factors, disturbed
from pipeline.studies.survey.options import Way
from pipeline.studies.survey.robots import (
    measured,
    observe,
    perform,
    pose_noise,
    recorded,
    trajectories,
)

STILL = Factors(disturbances=0.0)


def test_a_condition_without_factors_moves_as_the_recorded_takes_of_its_seed(laboratory):
    recorded_session = session.open_session(
        laboratory.chain, laboratory.dynamics, rng.stream(5, "record.session")
    )
    way = laboratory.trajectories["own"]
    for number, take in enumerate(perform(laboratory, "own", Factors(), 5, "test", 2)):
        stream = rng.stream(5, "record.test", number)
        motion = session.perform(recorded_session, way, laboratory.dynamics, stream)
        frames = session.depth_frames(motion.swing, way.duration, laboratory.clock, stream)
        np.testing.assert_array_equal(take.poses, motion.motion_capture)
        np.testing.assert_array_equal(take.seen, frames.joints)
        clock = laboratory.clock.drift
        np.testing.assert_allclose(
            take.frames * (1 + clock) + frames.clock_offset, frames.times, rtol=1e-12
        )


def test_without_disturbances_the_robot_does_what_it_is_told(laboratory):
    (take,) = perform(laboratory, "own", STILL, 5, "train", 1)
    way = laboratory.trajectories["own"]
    goal, _ = desired_joints(np.arange(len(take.poses)) / way.rate, way)
    np.testing.assert_allclose(take.poses, goal, atol=1e-3)
    (otherwise,) = perform(laboratory, "own", Factors(), 5, "train", 1)
    assert np.abs(otherwise.poses - goal).max() > 5e-3


def test_a_factor_scales_its_disturbance_alone_and_the_common_one_all_of_them(laboratory):
    own = laboratory.dynamics
    assert disturbed(own, Factors(clearance=2.0)) == replace(own, clearance=2 * own.clearance)
    assert disturbed(own, Factors(speed_exponent=0.5)) == replace(
        own, speed_exponent=own.speed_exponent / 2
    )
    half = disturbed(own, Factors(disturbances=0.5))
    assert half.sway_std == [std / 2 for std in own.sway_std]
    assert half.jitter_std == own.jitter_std / 2
    for name in ("speed_exponent", "servo_gain", "sway_rest", "sway_time", "clearance_time"):
        assert getattr(half, name) == getattr(own, name)


def test_deviations_that_last_longer_are_of_the_same_size(laboratory):
    own = laboratory.dynamics
    assert disturbed(own, Factors(lasting=10.0)) == replace(
        own, sway_time=10 * own.sway_time, clearance_time=10 * own.clearance_time
    )
    takes = {
        lasting: np.stack(
            [
                take.poses
                for take in perform(
                    laboratory, "own", Factors(lasting=lasting, start_std=0.0), 5, "train", 40
                )
            ]
        )
        for lasting in (0.15, 1.0, 10.0)
    }
    deviations = {lasting: poses - poses.mean(axis=0) for lasting, poses in takes.items()}
    sizes = {lasting: each[:, 40:70].std() for lasting, each in deviations.items()}
    # 40 takes of 0.3 s, in which the longest deviations hardly change: three joints count
    assert all(abs(np.log(sizes[lasting] / sizes[1.0])) < 4 / np.sqrt(2 * 40) for lasting in sizes)
    # half a frame of a depth camera later: all is forgotten, some, or nothing
    later = [
        np.mean(each[:, 42:70] * each[:, 40:68]) / np.mean(each[:, 40:70] ** 2)
        for each in deviations.values()
    ]
    assert later[0] < 0.2 < later[1] < 0.9 < later[2]


@pytest.mark.parametrize("factor", [0.0, 1.0, 3.0])
def test_measured_poses_have_the_noise_of_the_motion_capture_times_its_factor(laboratory, factor):
    takes = perform(laboratory, "own", STILL, 5, "train", 8)
    noise = measured(takes, laboratory.pose_noise, factor, np.random.default_rng(3)) - np.stack(
        [take.poses for take in takes]
    )
    if factor == 0:
        np.testing.assert_array_equal(noise, 0.0)
        return
    whitened = np.linalg.solve(
        factor * np.linalg.cholesky(laboratory.pose_noise), noise.reshape(-1, 3).T
    )
    low, high = chi2.ppf([5e-4, 1 - 5e-4], whitened[0].size)  # 1 in 1000 for each of three axes
    squares = np.sum(whitened**2, axis=1)
    assert np.all((low < squares) & (squares < high))
    # the control: another factor would be seen
    assert not np.any((low < squares * 1.2) & (squares * 1.2 < high))


def test_a_camera_that_is_exact_in_a_direction_adds_nothing_there(laboratory):
    takes = perform(laboratory, "own", STILL, 5, "train", 1)
    axis = np.array([0.3, -0.5, 0.7]) * 1e-4
    # of rank one: the other two variances may round to below zero
    noise = measured(takes, np.outer(axis, axis), 1.0, np.random.default_rng(3)) - takes[0].poses
    along = noise @ axis / (axis @ axis)
    np.testing.assert_allclose(noise, along[..., None] * axis, atol=1e-10)
    assert 0.8 < along.std() < 1.2


def test_the_depth_cameras_noise_has_the_interpolated_mean_and_covariance(laboratory):
    draws = laboratory.depth_noise.sample(np.full(20_000, 0.25), np.random.default_rng(4))
    variance = 0.75 * 1e-4 + 0.25 * 4e-4
    error = 4 * np.sqrt(variance / len(draws))
    np.testing.assert_allclose(draws.mean(axis=0), [0.015, 0.01, 0.0], atol=error)
    np.testing.assert_allclose(
        np.cov(draws.T), variance * np.eye(3), atol=4 * variance * np.sqrt(2 / len(draws))
    )


def test_what_the_camera_is_found_to_do_is_what_it_was_made_to_do(laboratory):
    _, camera = observe(laboratory, "own", Factors(disturbances=0.0, motion_capture=0.0), 5, 2, 12)
    everywhere = camera.noise[camera.noise["take"] == "none"]
    share = everywhere["t"].to_numpy() / laboratory.trajectories["own"].duration
    error = 4.5 * np.sqrt((1e-4 + share * 3e-4) / 12)
    assert np.all(np.abs(everywhere["b:a"] - 0.02 * (1 - share)) < error) and np.all(
        np.abs(everywhere["b:b"] - 0.04 * share) < error
    )
    assert len(camera.takes) == 12


def test_the_noise_of_a_pose_is_what_the_recorded_rest_has_beyond_the_robots(laboratory):
    takes = perform(laboratory, "own", Factors(), 5, "train", 20)
    robot = recorded(laboratory, "own", np.stack([take.poses for take in takes])).measurement
    poses = measured(takes, laboratory.pose_noise, 1.0, np.random.default_rng(6))
    result = pose_noise(recorded(laboratory, "own", poses).measurement, robot)
    # 20 takes of some 40 steps at rest: 800 samples, each covariance within 4 √(2/800) of the
    # greatest variance
    np.testing.assert_allclose(
        result, laboratory.pose_noise, atol=4 * np.sqrt(2 / 800) * laboratory.pose_noise.max()
    )
    assert np.linalg.eigvalsh(pose_noise(np.zeros((3, 3)), np.eye(3))).min() >= 0


def test_a_trajectory_beyond_the_joints_is_refused_by_its_name(laboratory):
    own = laboratory.trajectories["own"]
    result = trajectories(laboratory.chain, own, {"own": Way(), "slow": Way(pace=0.5)})
    assert result["own"] == own and (result["slow"].duration, result["slow"].rest) == (3.2, 0.2)
    for name, way in {"far": Way(extended=[9.0, -4.0, 2.0]), "fast": Way(pace=3.0)}.items():
        with pytest.raises(ConfigError, match=f"key trajectories.{name}"):
            trajectories(laboratory.chain, own, {"own": Way(), name: way})


@pytest.mark.parametrize("pace", [1.0, 0.5])
def test_another_rest_leaves_the_motion_in_between_as_it_is(laboratory, pace):
    own = laboratory.trajectories["own"]
    ways = {"own": Way(pace=pace), "longer": Way(rest=0.4, pace=pace)}
    stays, longer = trajectories(laboratory.chain, own, ways).values()
    assert longer.rest == 0.4 / pace
    assert longer.duration == pytest.approx(stays.duration + 4 * 0.3 / pace)
    # the way back begins three rests later, the way out one
    begins = stays.duration / 2
    for t, rests in ((np.linspace(0, begins, 50), 1), (np.linspace(begins, 2 * begins, 50), 3)):
        delayed = t + rests * (longer.rest - stays.rest)
        for one, other in zip(
            desired_joints(t, stays), desired_joints(delayed, longer), strict=True
        ):
            np.testing.assert_allclose(other, one, atol=1e-9)
