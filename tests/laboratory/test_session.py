"""A session: what stays through it, and whose clock each instrument looks at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import ClockOptions, DynamicsOptions, TrajectoryOptions
from pipeline.laboratory.session import Session, depth_frames, open_session, perform
from pipeline.laboratory.swing import desired_joints

STEADY = ClockOptions(offset=0.14, offset_std=0.0, drift=0.0, jitter_std=0.0)


def session(arm, dynamics: DynamicsOptions, rng: np.random.Generator) -> Session:
    return open_session(arm.chain, dynamics, rng)


def frames_of(lab: Session, trajectory, dynamics, clock: ClockOptions, rng):
    motion = perform(lab, trajectory, dynamics, rng)
    return depth_frames(motion.swing, trajectory.duration, clock, rng)


def servo_error(trajectory: TrajectoryOptions, dynamics: DynamicsOptions) -> float:
    """rad, how far Euler's steps may leave the undisturbed arm off its command."""
    t = np.linspace(0, trajectory.duration, 3201)
    acceleration = np.abs(np.diff(desired_joints(t, trajectory)[1], axis=0)).max() / (t[1] - t[0])
    return acceleration / (2 * dynamics.servo_gain * dynamics.rate)


def test_frames_come_at_the_cameras_rate_for_the_whole_motion(arm, trajectory, quiet, rng):
    motion = perform(session(arm, quiet, rng), trajectory, quiet, rng)
    frames = depth_frames(motion.swing, trajectory.duration, STEADY, rng)
    np.testing.assert_allclose(np.diff(frames.times), 1 / STEADY.rate)
    assert len(frames.times) == 97
    assert frames.joints.shape == (97, 3)
    assert motion.truth.shape == motion.motion_capture.shape == (321, 3)


def test_the_cameras_clock_is_ahead_by_its_offset_and_runs_at_its_own_rate(
    arm, trajectory, quiet, rng
):
    lab = session(arm, quiet, rng)
    steady, drifting = (
        frames_of(lab, trajectory, quiet, replace(STEADY, drift=drift), rng)
        for drift in (0.0, 0.01)
    )
    exposed = steady.times - 0.14
    np.testing.assert_allclose(exposed[[0, -1]], [0, 3.2], atol=1e-12)
    np.testing.assert_allclose(drifting.times, exposed * 1.01 + 0.14, atol=1e-12)
    # a clock that runs wrong sees no other motion
    assert np.array_equal(drifting.joints, steady.joints)
    assert steady.clock_offset == drifting.clock_offset == 0.14


def test_a_frame_shows_the_arm_at_the_instant_that_its_time_stands_for(arm, trajectory, quiet, rng):
    clock = ClockOptions(offset=-0.2, offset_std=0.05, drift=1e-3, jitter_std=5e-3)
    frames = frames_of(session(arm, quiet, rng), trajectory, quiet, clock, rng)
    instants = (frames.times - frames.clock_offset) / (1 + clock.drift)
    band = servo_error(trajectory, quiet)
    assert np.abs(frames.joints - desired_joints(instants, trajectory)[0]).max() < band
    # control: without the jitter of the exposures the angles would be off by far more
    nominal = np.arange(97) / clock.rate
    assert np.abs(frames.joints - desired_joints(nominal, trajectory)[0]).max() > 3 * band


def test_the_offset_varies_from_take_to_take_as_stated(arm, trajectory, quiet, rng):
    lab, takes = session(arm, quiet, rng), 100
    clock = replace(STEADY, offset_std=0.02)
    offsets = np.array(
        [frames_of(lab, trajectory, quiet, clock, rng).clock_offset for _ in range(takes)]
    )
    assert abs(offsets.mean() - 0.14) < 4 * 0.02 / np.sqrt(takes)
    assert abs(offsets.std() / 0.02 - 1) < 4 / np.sqrt(2 * takes)


def test_the_truth_is_where_the_arm_was_and_motion_capture_misses_it_by_its_jitter_alone(
    arm, trajectory, quiet, rng
):
    lab = session(arm, quiet, rng)
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
    lab, other = (session(arm, dynamics, np.random.default_rng(seed)) for seed in (1, 2))
    assert lab.nominal is arm.chain
    for drawn, elsewhere in (
        (lab.chain.lengths, other.chain.lengths),
        (lab.encoder, other.encoder),
    ):
        assert not np.any(drawn == elsewhere)
    np.testing.assert_allclose(lab.chain.lengths, arm.chain.lengths, atol=6 * dynamics.length_std)


def test_takes_of_one_stream_repeat_to_the_last_bit(arm, trajectory, dynamics):
    lab, takes = session(arm, dynamics, np.random.default_rng(1)), []
    for seed in (3, 3, 4):
        rng = np.random.default_rng(seed)
        motion = perform(lab, trajectory, dynamics, rng)
        frames = depth_frames(motion.swing, trajectory.duration, ClockOptions(), rng)
        takes.append((motion.motion_capture, motion.truth, frames.times, frames.joints))
    for first, again, other in zip(*takes, strict=True):
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)


@pytest.mark.parametrize(
    ("options", "key"),
    [({"sway_std": (1e-3, 1e-3)}, "sway_std"), ({"play_joint": 4}, "play_joint")],
)
def test_the_disturbances_of_another_arm_are_refused(arm, dynamics, rng, options, key):
    with pytest.raises(ConfigError, match=rf"laboratory\.dynamics\.{key}"):
        session(arm, replace(dynamics, **options), rng)


@pytest.mark.parametrize(
    "bad", [{"rate": 0.0}, {"offset_std": -1.0}, {"jitter_std": -1.0}, {"drift": -1.0}]
)
def test_clocks_without_a_meaning_are_refused(bad):
    with pytest.raises(ConfigError, match=r"laboratory\.clock"):
        replace(STEADY, **bad)
