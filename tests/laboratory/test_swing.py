"""The commanded motion: out and back, at rest in between, within the limits of the joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.columns import values
from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import TrajectoryOptions
from pipeline.laboratory.swing import desired_joints, desired_trajectory


def grid(options: TrajectoryOptions, rate: float = 1000.0) -> np.ndarray:
    return np.arange(round(options.duration * rate) + 1) / rate


def test_the_arm_rests_folded_goes_out_rests_comes_back_and_rests(trajectory):
    t = grid(trajectory)
    q, speed = desired_joints(t, trajectory)
    half, rest = trajectory.duration / 2, trajectory.rest
    ends = (t <= rest) | (t >= trajectory.duration - rest)
    turn = np.abs(t - half) <= rest
    assert np.array_equal(q[ends], np.tile(trajectory.folded, (ends.sum(), 1)))
    np.testing.assert_allclose(q[turn], np.tile(trajectory.extended, (turn.sum(), 1)), atol=1e-12)
    still = ~speed.any(axis=1)
    # the instants at which rest and motion meet may round to either side
    assert abs(still.sum() - (ends.sum() + turn.sum())) <= 4
    way = np.array(trajectory.extended) - trajectory.folded
    out, back = (t > rest) & (t < half - rest), (t > half + rest) & (t < trajectory.duration - rest)
    assert np.all((speed * way)[out].min(axis=1) >= 0)
    assert np.all((speed * way)[back].max(axis=1) <= 0)


def test_the_way_back_is_the_way_out_in_reverse(trajectory):
    t = grid(trajectory)
    q, speed = desired_joints(t, trajectory)
    np.testing.assert_allclose(q, q[::-1], atol=1e-12)
    away = np.abs(t - trajectory.duration / 2) > 1e-9
    np.testing.assert_allclose(speed[away], -speed[::-1][away], atol=1e-11)


def test_the_speed_is_the_derivative_of_the_angle_and_changes_smoothly(trajectory):
    t = grid(trajectory)
    q, speed = desired_joints(t, trajectory)
    difference = (q[2:] - q[:-2]) / (t[2:] - t[:-2])[:, None]
    assert np.abs(difference - speed[1:-1]).max() < 1e-4
    peak = np.abs(speed).max()
    assert np.abs(np.diff(speed, axis=0)).max() < peak * np.pi / 2 / trajectory.ramp / 1000 * 1.01
    # control: halfway the speed is far from what a motion without ramps would have
    assert peak > 1.2 * np.abs(np.array(trajectory.extended) - trajectory.folded).max() / (
        trajectory.duration / 2 - 2 * trajectory.rest
    )


def test_joints_stay_within_their_limits_of_angle_and_speed(arm, trajectory):
    q, speed = desired_joints(grid(trajectory), trajectory)
    assert arm.chain.within_limits(q).all()
    assert np.all(np.abs(speed) <= arm.chain.max_speed)


def test_the_table_steps_from_pose_to_pose_exactly(arm, trajectory):
    table = desired_trajectory(arm.chain, trajectory)
    pose, velocity = values(table, "x"), values(table, "v")
    assert len(table) == round(trajectory.duration * trajectory.rate) + 1
    np.testing.assert_allclose(pose[:-1] + velocity[:-1] / trajectory.rate, pose[1:], atol=1e-15)
    np.testing.assert_allclose(
        pose, arm.chain.pose(desired_joints(table["t"].to_numpy(), trajectory)[0]), atol=1e-15
    )
    # at rest the command is exactly zero: there the weights of the fits are taken
    still = table["t"] < trajectory.rest - 1 / trajectory.rate
    assert not velocity[still].any()
    assert still.sum() > 5


def test_a_motion_beyond_the_joint_limits_is_refused(arm, trajectory):
    beyond = replace(trajectory, extended=(arm.chain.upper[0] + 0.01, *trajectory.extended[1:]))
    with pytest.raises(ConfigError, match="leaves the joint limits"):
        desired_trajectory(arm.chain, beyond)


def test_a_motion_faster_than_the_joints_is_refused(arm, trajectory):
    peak = np.abs(desired_joints(grid(trajectory), trajectory)[1]).max()
    # at the joints' speed limit, were the rests to shrink as well
    hurry = trajectory.duration * peak / np.pi * 2
    with pytest.raises(ConfigError, match="faster than the joints"):
        desired_trajectory(arm.chain, replace(trajectory, duration=0.9 * hurry))


@pytest.mark.parametrize(
    "bad",
    [{"rest": 0.6}, {"rest": -0.1}, {"ramp": 0.0}, {"ramp": 0.6}, {"rate": 0.0}, {"duration": 1.0}],
)
def test_times_that_do_not_fit_together_are_refused(trajectory, bad):
    with pytest.raises(ConfigError, match=r"laboratory\.trajectory"):
        replace(trajectory, **bad)
