"""A session: what stays through it, the clock of each instrument, and what the encoders read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.laboratory.dynamics import simulate_take
from pipeline.laboratory.options import (
    ClockOptions,
    DynamicsOptions,
    EncoderOptions,
    TrajectoryOptions,
)
from pipeline.laboratory.session import Session, depth_frames, log_joints, open_session, perform
from pipeline.laboratory.swing import desired_joints

STEADY = ClockOptions(offset=0.14, offset_std=0.0, drift=0.0, jitter_std=0.0)


def frames_of(lab: Session, trajectory, dynamics, clock: ClockOptions, rng):
    motion = perform(lab, trajectory, dynamics, rng)
    return depth_frames(motion.swing, trajectory.duration, clock, rng)


def servo_error(trajectory: TrajectoryOptions, dynamics: DynamicsOptions) -> float:
    """rad, how far Euler's steps may leave the undisturbed arm off its command."""
    t = np.linspace(0, trajectory.duration, 3201)
    acceleration = np.abs(np.diff(desired_joints(t, trajectory)[1], axis=0)).max() / (t[1] - t[0])
    return acceleration / (2 * dynamics.servo_gain * dynamics.rate)


def test_the_cameras_clock_is_ahead_by_its_offset_and_runs_at_its_own_rate(
    arm, trajectory, quiet, rng
):
    lab = open_session(arm.chain, quiet, rng)
    steady, drifting = (
        frames_of(lab, trajectory, quiet, replace(STEADY, drift=drift), rng)
        for drift in (0.0, 0.01)
    )
    np.testing.assert_allclose(np.diff(steady.times), 1 / STEADY.rate)
    assert steady.joints.shape == (97, 3)
    exposed = steady.times - 0.14
    np.testing.assert_allclose(exposed[[0, -1]], [0, 3.2], atol=1e-12)
    np.testing.assert_allclose(drifting.times, exposed * 1.01 + 0.14, atol=1e-12)
    # a clock that runs wrong sees no other motion
    assert np.array_equal(drifting.joints, steady.joints)
    assert steady.clock_offset == drifting.clock_offset == 0.14


def test_a_frame_shows_the_arm_at_the_instant_that_its_time_stands_for(arm, trajectory, quiet, rng):
    clock = ClockOptions(offset=-0.2, offset_std=0.05, drift=1e-3, jitter_std=5e-3)
    frames = frames_of(open_session(arm.chain, quiet, rng), trajectory, quiet, clock, rng)
    instants = (frames.times - frames.clock_offset) / (1 + clock.drift)
    band = servo_error(trajectory, quiet)
    assert np.abs(frames.joints - desired_joints(instants, trajectory)[0]).max() < band
    # control: without the jitter of the exposures the angles would be off by far more
    nominal = np.arange(97) / clock.rate
    assert np.abs(frames.joints - desired_joints(nominal, trajectory)[0]).max() > 3 * band


def test_the_offset_varies_from_take_to_take_as_stated(arm, trajectory, quiet, rng):
    lab, takes = open_session(arm.chain, quiet, rng), 100
    clock = replace(STEADY, offset_std=0.02)
    offsets = np.array(
        [frames_of(lab, trajectory, quiet, clock, rng).clock_offset for _ in range(takes)]
    )
    assert abs(offsets.mean() - 0.14) < 4 * 0.02 / np.sqrt(takes)
    assert abs(offsets.std() / 0.02 - 1) < 4 / np.sqrt(2 * takes)


def test_the_truth_is_where_the_arm_was_and_motion_capture_misses_it_by_its_jitter_alone(
    arm, trajectory, quiet, rng
):
    lab = open_session(arm.chain, quiet, rng)
    sharp = perform(lab, trajectory, quiet, rng)
    blurred = perform(lab, trajectory, replace(quiet, jitter_std=2e-3), rng)
    assert np.array_equal(sharp.motion_capture, sharp.truth)
    assert np.array_equal(blurred.truth, sharp.truth)
    speed = desired_joints(np.arange(321) / trajectory.rate, trajectory)[1]
    fast = np.abs(speed[:, 0]) > 0.9 * np.abs(speed).max()
    error = blurred.motion_capture - blurred.truth
    missed = error[fast, 0] / speed[fast, 0]
    assert abs(missed.std() / 2e-3 - 1) < 4 / np.sqrt(2 * fast.sum())
    still = np.abs(speed).max(axis=1) == 0
    assert np.abs(error[still]).mean() < 0.02 * np.abs(error[fast]).mean()


def test_a_session_keeps_the_nominal_arm_beside_the_one_that_was_built(arm, dynamics):
    lab, other = (open_session(arm.chain, dynamics, np.random.default_rng(seed)) for seed in (1, 2))
    assert lab.nominal is arm.chain
    for drawn, elsewhere in (
        (lab.chain.lengths, other.chain.lengths),
        (lab.encoder, other.encoder),
    ):
        assert not np.any(drawn == elsewhere)
    np.testing.assert_allclose(lab.chain.lengths, arm.chain.lengths, atol=6 * dynamics.length_std)


def test_takes_of_one_stream_repeat_to_the_last_bit(arm, trajectory, dynamics):
    lab, takes = open_session(arm.chain, dynamics, np.random.default_rng(1)), []
    for seed in (3, 3, 4):
        rng = np.random.default_rng(seed)
        motion = perform(lab, trajectory, dynamics, rng)
        frames = depth_frames(motion.swing, trajectory.duration, ClockOptions(), rng)
        takes.append((motion.motion_capture, motion.truth, frames.times, frames.joints))
    for first, again, other in zip(*takes, strict=True):
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)


OPTIONS = EncoderOptions(rate=250.0, resolution=1e-3)


def test_encoders_read_to_their_resolution_and_know_nothing_of_their_zeros(
    arm, trajectory, quiet, rng
):
    offset = np.array([2e-3, -3e-3, 5e-3])
    swing = simulate_take(arm.chain, offset, trajectory, quiet, rng)
    np.testing.assert_allclose(swing.q - swing.servo, np.tile(offset, (len(swing.t), 1)))
    t, signals = log_joints(swing, trajectory, OPTIONS)
    np.testing.assert_allclose(t, np.arange(801) / 250, atol=1e-12)
    assert np.array_equal(signals["target"], desired_joints(t, trajectory)[0])
    actual = signals["actual"] / OPTIONS.resolution
    np.testing.assert_allclose(actual, np.round(actual), atol=1e-9)
    servo = np.stack([np.interp(t, swing.t, joint) for joint in swing.servo.T], axis=1)
    error = signals["actual"] - servo
    assert np.abs(error).max() <= OPTIONS.resolution / 2 * (1 + 1e-9)
    # rounding is uniform where the arm moves
    moving = np.abs(np.gradient(servo, axis=0)).min(axis=1) > 1e-4
    assert error[moving].std() == pytest.approx(1e-3 / np.sqrt(12), rel=0.05)
    # control: against where the arm is they are off by their zeros
    true = np.stack([np.interp(t, swing.t, joint) for joint in swing.q.T], axis=1)
    np.testing.assert_allclose((true - signals["actual"]).mean(axis=0), offset, atol=3e-4)


def test_what_happens_behind_the_gears_no_encoder_reads(arm, trajectory, quiet):
    logs = []
    for clearance in (0.0, 0.03):
        dynamics = replace(quiet, clearance=clearance)
        rng = np.random.default_rng(3)
        swing = simulate_take(arm.chain, np.zeros(3), trajectory, dynamics, rng)
        logs.append((swing.q, log_joints(swing, trajectory, OPTIONS)[1]["actual"]))
    assert np.array_equal(logs[0][1], logs[1][1])
    assert np.abs(logs[0][0] - logs[1][0]).max() > 1e-3
