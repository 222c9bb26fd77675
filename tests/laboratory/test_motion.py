"""The arm's motion: its command, each disturbance, and each instrument on its own clock."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from standard_errors import largest_score
from synthetic_session import ARM, DYNAMICS, QUIET, TRAJECTORY

from pipeline.core.errors import ConfigError
from pipeline.laboratory import dynamics
from pipeline.laboratory.options import ClockOptions, EncoderOptions

OFFSET = np.array([1e-3, -2e-3, 3e-3])
ENCODERS = EncoderOptions(rate=250.0, resolution=1e-3)


T = np.arange(round(TRAJECTORY.duration * 1000) + 1) / 1000
COMMAND, SPEED = dynamics.desired_joints(T, TRAJECTORY)  # at 1 kHz


def test_the_arm_rests_folded_goes_out_rests_and_comes_back_the_same_way():
    half = TRAJECTORY.duration / 2
    rest = TRAJECTORY.rest
    folded = np.array(TRAJECTORY.folded)
    extended = np.array(TRAJECTORY.extended)
    ends = (T <= rest) | (T >= TRAJECTORY.duration - rest)
    turn = np.abs(T - half) <= rest
    outwards = (T > rest) & (T < half - rest)

    assert np.all(COMMAND[ends] == folded)
    assert np.abs(COMMAND[turn] - extended).max() < 1e-12
    # the instants at which rest and motion meet may round to either side
    still = ~SPEED.any(axis=1)
    assert abs(still.sum() - (ends.sum() + turn.sum())) <= 4
    assert np.all((SPEED * (extended - folded))[outwards] >= 0)
    assert_allclose(COMMAND, COMMAND[::-1], atol=1e-12)
    assert ARM.chain.within_limits(COMMAND).all()
    assert np.all(np.abs(SPEED) <= ARM.chain.max_speed)


def test_the_speed_is_the_derivative_of_the_angle_and_as_smooth_as_the_ramps_say():
    differences = (COMMAND[2:] - COMMAND[:-2]) * 500
    steepest = np.abs(SPEED).max() * np.pi / 2 / TRAJECTORY.ramp / 1000

    assert np.abs(differences - SPEED[1:-1]).max() < 1e-4
    assert np.abs(np.diff(SPEED, axis=0)).max() < 1.01 * steepest


BEYOND = (ARM.chain.upper[0] + 0.01, *TRAJECTORY.extended[1:])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"extended": BEYOND}, "leaves"),
        ({"duration": 1.5, "rest": 0.0}, "faster than the joints' limits"),
        ({"folded": (0.0,) * 2, "extended": (0.5,) * 2}, "must have 3 angles"),
    ],
)
def test_a_motion_that_the_arm_cannot_do_is_refused(change, words):
    with pytest.raises(ConfigError, match=words):
        dynamics.desired_trajectory(ARM.chain, replace(TRAJECTORY, **change))


SAMPLED = dynamics.JointPath(
    dynamics.desired_path(ARM.chain, TRAJECTORY),
    TRAJECTORY.rate,
)


def test_takes_made_together_are_those_made_one_by_one():
    rngs = [np.random.default_rng(seed) for seed in range(3)]
    drawn = [dynamics.draw(ARM.chain, SAMPLED, DYNAMICS, rng) for rng in rngs]
    arm = ARM.chain, OFFSET, SAMPLED, DYNAMICS
    single = [dynamics.swing(*arm, chance) for chance in drawn]
    stacked = dynamics.Chance(*map(np.stack, zip(*drawn, strict=True)))
    together = dynamics.swing(*arm, stacked)
    for field in ("q", "servo"):
        alone = np.stack([getattr(take, field) for take in single])
        assert np.array_equal(getattr(together, field), alone)

    assert np.abs(together.q[0] - together.q[1]).max() > 1e-4


@pytest.mark.parametrize(
    ("first", "offset", "words"),
    [(7, 9.0, "limits .*step 7"), (8, 0.1, "faster.*step 7")],
)
def test_a_path_that_the_arm_cannot_follow_is_refused_with_its_first_step(
    first,
    offset,
    words,
):
    SAMPLED.require_followable(ARM.chain)
    joints = SAMPLED.joints.copy()
    joints[first:] += offset
    with pytest.raises(ConfigError, match=words):
        replace(SAMPLED, joints=joints).require_followable(ARM.chain)


@pytest.mark.parametrize(("steps_per_lag", "paths"), [(13.5, 4000), (540.0, 600)])
def test_lagged_noise_has_variance_one_and_the_correlation_of_four_lags(
    steps_per_lag,
    paths,
    rng,
):
    steps = np.round(np.array([0.5, 1.0, 2.0]) * steps_per_lag).astype(int)
    noise = dynamics.lagged_noise((paths, steps[-1] + 1), steps_per_lag, rng)
    band = 4.5 * np.sqrt(2 / paths)
    # E(x(t + s) − x(t))² = 2(1 − ρ(s)), which tells short times apart
    moved = np.mean((noise[:, steps] - noise[:, :1]) ** 2, axis=0) / 2
    # ρ of white noise behind as many lags in continuous time
    x = steps / steps_per_lag
    one_lag = np.exp(-x)
    three_lags = (1 + x + x**2 / 3) * np.exp(-x)
    four_lags = (1 + x + 2 * x**2 / 5 + x**3 / 15) * np.exp(-x)

    for end in (0, -1):  # stationary from the first sample on
        assert abs(np.mean(noise[:, end] ** 2) - 1) < band
    assert np.all(np.abs(moved / (1 - four_lags) - 1) < band)
    # controls: one lag fewer, and a single one
    for correlation in (three_lags, one_lag):
        ratio = moved / (1 - correlation)
        assert np.all(np.abs(ratio[:2] - 1) > band)


def test_a_session_draws_zeros_and_lengths_of_the_stated_size(rng):
    options = replace(QUIET, encoder_offset_std=2e-3, length_std=3e-4)
    sessions = 1000
    opened = [dynamics.open_session(ARM.chain, options, rng) for _ in range(sessions)]
    offsets = np.array([session.encoder for session in opened])
    links = np.array([session.chain.links for session in opened])
    lengths = np.linalg.norm(links, axis=-1) - ARM.chain.lengths

    for drawn, std in ((offsets, 2e-3), (lengths, 3e-4)):
        assert_allclose(drawn.std(axis=0), std, rtol=4 / np.sqrt(2 * sessions))
        assert largest_score(drawn) < 4
    # only lengths: the links point as they did
    x, z = np.moveaxis(links, -1, 0)
    headings = np.broadcast_to(np.arctan2(*ARM.chain.links.T), x.shape)
    assert_allclose(np.arctan2(x, z), headings, atol=1e-14)


def between_samples(t: np.ndarray, sampled: np.ndarray, joints: np.ndarray):
    """(T, n) ``joints`` (S, n) at the times ``t``, by lines between the times ``sampled``."""
    return np.stack([np.interp(t, sampled, joint) for joint in joints.T], axis=-1)


def test_a_frame_shows_the_arm_at_the_instant_that_its_time_on_the_cameras_clock_stands_for(
    rng,
):
    lab = dynamics.open_session(ARM.chain, QUIET, rng)
    motion = dynamics.perform(lab, TRAJECTORY, QUIET, rng)
    clock = ClockOptions(offset=-0.2, offset_std=0.05, drift=1e-3, jitter_std=5e-3)
    nominal = np.arange(97) / clock.rate

    offsets = []
    for _ in range(100):
        frames = dynamics.depth_frames(motion.swing, TRAJECTORY.duration, clock, rng)
        instants = (frames.times - frames.clock_offset) / (1 + clock.drift)
        jitter = np.abs(instants - nominal)[1:-1]
        expected = between_samples(instants, motion.swing.t, motion.swing.q)
        offsets.append(frames.clock_offset)

        assert_allclose(instants, frames.exposed, atol=1e-12)
        assert jitter.std() == pytest.approx(5e-3 * 0.6, rel=0.4)
        assert_allclose(frames.joints, expected, atol=1e-12)

    assert largest_score(np.array(offsets), -0.2) < 4
    assert abs(np.std(offsets) / 0.05 - 1) < 4 / np.sqrt(200)


def test_the_truth_is_where_the_arm_was_and_motion_capture_misses_it_by_its_jitter_alone(
    rng,
):
    lab = dynamics.open_session(ARM.chain, QUIET, rng)
    sharp = dynamics.perform(lab, TRAJECTORY, QUIET, rng)
    blurred = dynamics.perform(lab, TRAJECTORY, replace(QUIET, jitter_std=2e-3), rng)
    grid = np.arange(321) / TRAJECTORY.rate
    _, speed = dynamics.desired_joints(grid, TRAJECTORY)
    fastest = np.abs(speed).max(axis=0).argmax()
    fast = np.abs(speed[:, fastest]) > 0.9 * np.abs(speed).max()
    still = ~speed.any(axis=1)

    error = blurred.motion_capture - blurred.truth
    late = error[fast, fastest] / speed[fast, fastest]

    assert_array_equal(sharp.motion_capture, sharp.truth)
    assert_array_equal(blurred.truth, sharp.truth)
    assert late.std() == pytest.approx(2e-3, rel=4 / np.sqrt(2 * fast.sum()))
    assert np.abs(error[still]).mean() < 0.02 * np.abs(error[fast]).mean()


def test_encoders_read_the_servo_to_their_resolution_and_nothing_behind_the_gears(rng):
    options = replace(QUIET, clearance=0.03)
    chance = dynamics.draw(ARM.chain, TRAJECTORY, options, rng)
    take = dynamics.swing(ARM.chain, OFFSET, TRAJECTORY, options, chance)
    assert np.abs(take.q - take.servo - OFFSET).max() > 1e-3

    t, signals = dynamics.log_joints(take, TRAJECTORY, ENCODERS)

    target, _ = dynamics.desired_joints(t, TRAJECTORY)
    servo = between_samples(t, take.t, take.servo)
    counts = signals["actual"] / ENCODERS.resolution
    error = signals["actual"] - servo
    assert_allclose(t, np.arange(801) / 250, atol=1e-12)
    assert_array_equal(signals["target"], target)
    assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(error).max() <= ENCODERS.resolution / 2 * (1 + 1e-9)
    # rounding is uniform where the arm moves
    moving = np.abs(np.gradient(servo, axis=0)).min(axis=1) > 1e-4
    assert error[moving].std() == pytest.approx(1e-3 / np.sqrt(12), rel=0.05)
