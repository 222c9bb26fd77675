"""The commanded motion, out and back or along any joint path: at rest where it rests, within the
limits of the joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.columns import values
from pipeline.core.errors import ConfigError
from pipeline.laboratory.dynamics import Chance, draw, simulate_take, swing
from pipeline.laboratory.session import open_session, perform
from pipeline.laboratory.swing import JointPath, desired_joints, desired_path, desired_trajectory


def test_the_arm_rests_folded_goes_out_rests_and_comes_back_the_same_way(arm, trajectory):
    t = np.arange(round(trajectory.duration * 1000) + 1) / 1000
    q, speed = desired_joints(t, trajectory)
    half, rest = trajectory.duration / 2, trajectory.rest
    ends = (t <= rest) | (t >= trajectory.duration - rest)
    turn = np.abs(t - half) <= rest
    assert np.array_equal(q[ends], np.tile(trajectory.folded, (ends.sum(), 1)))
    np.testing.assert_allclose(q[turn], np.tile(trajectory.extended, (turn.sum(), 1)), atol=1e-12)
    # the instants at which rest and motion meet may round to either side
    assert abs((~speed.any(axis=1)).sum() - (ends.sum() + turn.sum())) <= 4
    way = np.array(trajectory.extended) - trajectory.folded
    assert np.all((speed * way)[(t > rest) & (t < half - rest)] >= 0)
    np.testing.assert_allclose(q, q[::-1], atol=1e-12)
    # the speed is the derivative of the angle, and changes as smoothly as the ramps say
    assert np.abs((q[2:] - q[:-2]) * 500 - speed[1:-1]).max() < 1e-4
    peak = np.abs(speed).max()
    assert np.abs(np.diff(speed, axis=0)).max() < peak * np.pi / 2 / trajectory.ramp / 1000 * 1.01
    assert arm.chain.within_limits(q).all()
    assert np.all(np.abs(speed) <= arm.chain.max_speed)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda arm, way: {"extended": (arm.chain.upper[0] + 0.01, *way.extended[1:])}, "leaves"),
        (lambda arm, way: {"duration": 1.5, "rest": 0.0}, "faster than the joints"),
        (lambda arm, way: {"folded": (0.0,) * 2, "extended": (0.5,) * 2}, "must have 3 angles"),
    ],
)
def test_a_motion_that_the_arm_cannot_do_is_refused(arm, trajectory, change, words):
    with pytest.raises(ConfigError, match=words):
        desired_trajectory(arm.chain, replace(trajectory, **change(arm, trajectory)))


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


OFFSET = np.array([1e-3, -2e-3, 3e-3])


@pytest.fixture
def sampled(arm, trajectory):
    return JointPath(desired_path(arm.chain, trajectory), trajectory.rate)


def test_a_sampled_motion_is_performed_like_the_motion_that_was_sampled(
    arm, trajectory, dynamics, sampled
):
    session = open_session(arm.chain, dynamics, np.random.default_rng(1))
    one, other = (
        perform(session, motion, dynamics, np.random.default_rng(2))
        for motion in (trajectory, sampled)
    )
    # sway and play, up to 0.05 rad of a joint, follow the speed, which the interpolant has to 1 %
    assert 0 < np.abs(one.truth - other.truth).max() < 5e-4
    # the control: a motion that is not the sampled one
    slower = JointPath(0.9 * sampled.joints, sampled.rate)
    turned = perform(session, slower, dynamics, np.random.default_rng(2))
    assert np.abs(one.truth - turned.truth).max() > 1e-2


def test_the_path_goes_through_its_poses_rests_where_it_rests_and_never_overshoots(sampled):
    grid = np.arange(len(sampled.joints)) / sampled.rate
    np.testing.assert_allclose(desired_joints(grid, sampled)[0], sampled.joints, atol=1e-15)
    still = ~np.any(np.diff(sampled.joints, axis=0), axis=1)
    assert still.any() and not still.all()
    between = desired_joints(grid[:-1] + 0.4 / sampled.rate, sampled)
    assert not between[1][still].any()
    low = np.minimum(sampled.joints[:-1], sampled.joints[1:])
    high = np.maximum(sampled.joints[:-1], sampled.joints[1:])
    assert np.all((low - 1e-12 <= between[0]) & (between[0] <= high + 1e-12))
    # the speed is the path's derivative
    t = np.linspace(0.5, 1.5, 41)
    ahead, behind = (desired_joints(t + h, sampled)[0] for h in (1e-5, -1e-5))
    np.testing.assert_allclose((ahead - behind) / 2e-5, desired_joints(t, sampled)[1], atol=1e-3)


def test_takes_made_together_are_those_made_one_by_one(arm, dynamics, sampled):
    single = [
        simulate_take(arm.chain, OFFSET, sampled, dynamics, np.random.default_rng(seed))
        for seed in range(3)
    ]
    drawn = [draw(arm.chain, sampled, dynamics, np.random.default_rng(seed)) for seed in range(3)]
    stacked = Chance(*map(np.stack, zip(*drawn, strict=True)))
    together = swing(arm.chain, OFFSET, sampled, dynamics, stacked)
    for field in ("q", "servo"):
        alone = np.stack([getattr(take, field) for take in single])
        assert np.array_equal(getattr(together, field), alone)
    assert np.abs(together.q[0] - together.q[1]).max() > 1e-4


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda q: q[:, :2], "3 angles a pose"),
        (lambda q: q[:1], "two poses or more"),
        (lambda q: q + np.where(np.arange(len(q)) >= 7, 9.0, 0.0)[:, None], "limits .step 7"),
        (lambda q: q + np.where(np.arange(len(q)) > 7, 0.1, 0.0)[:, None], "faster.*step 7"),
    ],
)
def test_a_path_that_the_arm_cannot_follow_is_refused_with_its_first_step(
    arm, sampled, change, words
):
    sampled.require_followable(arm.chain)
    bad = replace(sampled, joints=change(sampled.joints))
    with pytest.raises(ConfigError, match=words):
        bad.require_followable(arm.chain)
