"""The arm's motion: its command, each disturbance, and each instrument on its own clock."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_session import ARM, DYNAMICS, QUIET, TRAJECTORY

from pipeline.core.errors import ConfigError
from pipeline.laboratory import dynamics
from pipeline.laboratory.options import ClockOptions, EncoderOptions

OFFSET = np.array([1e-3, -2e-3, 3e-3])
ENCODERS = EncoderOptions(rate=250.0, resolution=1e-3)


def test_the_arm_rests_folded_goes_out_rests_and_comes_back_the_same_way():
    t = np.arange(round(TRAJECTORY.duration * 1000) + 1) / 1000
    q, speed = dynamics.desired_joints(t, TRAJECTORY)
    half, rest = TRAJECTORY.duration / 2, TRAJECTORY.rest
    ends = (t <= rest) | (t >= TRAJECTORY.duration - rest)
    turn = np.abs(t - half) <= rest

    assert np.array_equal(q[ends], np.tile(TRAJECTORY.folded, (ends.sum(), 1)))
    assert_allclose(
        q[turn],
        np.tile(TRAJECTORY.extended, (turn.sum(), 1)),
        atol=1e-12,
    )

    # the instants at which rest and motion meet may round to either side
    assert abs((~speed.any(axis=1)).sum() - (ends.sum() + turn.sum())) <= 4

    way = np.array(TRAJECTORY.extended) - TRAJECTORY.folded
    assert np.all((speed * way)[(t > rest) & (t < half - rest)] >= 0)
    assert_allclose(q, q[::-1], atol=1e-12)

    # the speed is the derivative of the angle, and changes as smoothly as the ramps say
    assert np.abs((q[2:] - q[:-2]) * 500 - speed[1:-1]).max() < 1e-4

    peak = np.abs(speed).max()
    steepest = peak * np.pi / 2 / TRAJECTORY.ramp / 1000
    assert np.abs(np.diff(speed, axis=0)).max() < 1.01 * steepest
    assert ARM.chain.within_limits(q).all()
    assert np.all(np.abs(speed) <= ARM.chain.max_speed)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda way: {"extended": (ARM.chain.upper[0] + 0.01, *way.extended[1:])},
            "leaves",
        ),
        (lambda way: {"duration": 1.5, "rest": 0.0}, "faster than the joints' limits"),
        (
            lambda way: {"folded": (0.0,) * 2, "extended": (0.5,) * 2},
            "must have 3 angles",
        ),
    ],
)
def test_a_motion_that_the_arm_cannot_do_is_refused(change, words):
    with pytest.raises(ConfigError, match=words):
        dynamics.desired_trajectory(
            ARM.chain,
            replace(TRAJECTORY, **change(TRAJECTORY)),
        )


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
    ("change", "words"),
    [
        (
            lambda q: q + np.where(np.arange(len(q)) >= 7, 9.0, 0.0)[:, None],
            "limits .*step 7",
        ),
        (
            lambda q: q + np.where(np.arange(len(q)) > 7, 0.1, 0.0)[:, None],
            "faster.*step 7",
        ),
    ],
)
def test_a_path_that_the_arm_cannot_follow_is_refused_with_its_first_step(
    change,
    words,
):
    SAMPLED.require_followable(ARM.chain)
    bad = replace(SAMPLED, joints=change(SAMPLED.joints))
    with pytest.raises(ConfigError, match=words):
        bad.require_followable(ARM.chain)


@pytest.mark.parametrize(("steps_per_lag", "paths"), [(13.5, 4000), (540.0, 600)])
def test_lagged_noise_has_variance_one_and_the_correlation_of_four_lags(
    steps_per_lag,
    paths,
    rng,
):
    steps = np.round(np.array([0.5, 1.0, 2.0]) * steps_per_lag).astype(int)
    noise = dynamics.lagged_noise((paths, steps[-1] + 1), steps_per_lag, rng)
    band, x = 4.5 * np.sqrt(2 / paths), steps / steps_per_lag
    for end in (0, -1):  # stationary from the first sample on
        assert abs(np.mean(noise[:, end] ** 2) - 1) < band

    # E(x(t + s) − x(t))² = 2(1 − ρ(s)), which tells short times apart; ρ of white noise behind four
    # lags in continuous time
    moved = np.mean((noise[:, steps] - noise[:, :1]) ** 2, axis=0) / 2
    lagged = (1 + x + 2 * x**2 / 5 + x**3 / 15) * np.exp(-x)

    assert np.all(np.abs(moved / (1 - lagged) - 1) < band)

    # controls: one lag fewer, and a single one
    three_lags, one_lag = (1 + x + x**2 / 3) * np.exp(-x), np.exp(-x)
    for correlation in (three_lags, one_lag):
        assert np.all(np.abs(moved[:2] / (1 - correlation[:2]) - 1) > band)


def test_a_session_draws_zeros_and_lengths_of_the_stated_size(rng):
    options, sessions = replace(QUIET, encoder_offset_std=2e-3, length_std=3e-4), 1000
    opened = [dynamics.open_session(ARM.chain, options, rng) for _ in range(sessions)]
    offsets = np.array([session.encoder for session in opened])
    chains = [session.chain for session in opened]
    errors = np.array([chain.lengths for chain in chains]) - ARM.chain.lengths
    for drawn, std in ((offsets, 2e-3), (errors, 3e-4)):
        band = 4 / np.sqrt(2 * sessions)
        assert_allclose(drawn.std(axis=0), std, rtol=band)
        assert np.all(np.abs(drawn.mean(axis=0)) < 4 * std / np.sqrt(sessions))

    # only lengths: the links point as they did
    headings = np.array([np.arctan2(*chain.links.T) for chain in chains])
    turned = headings - np.arctan2(*ARM.chain.links.T)
    assert_allclose(turned, 0, atol=1e-14)


def test_a_frame_shows_the_arm_at_the_instant_that_its_time_on_the_cameras_clock_stands_for(
    rng,
):
    lab = dynamics.open_session(ARM.chain, QUIET, rng)
    motion = dynamics.perform(lab, TRAJECTORY, QUIET, rng)
    clock = ClockOptions(offset=-0.2, offset_std=0.05, drift=1e-3, jitter_std=5e-3)
    nominal, offsets = np.arange(97) / clock.rate, []
    for _ in range(100):
        frames = dynamics.depth_frames(motion.swing, TRAJECTORY.duration, clock, rng)
        instants = (frames.times - frames.clock_offset) / (1 + clock.drift)
        assert_allclose(instants, frames.exposed, atol=1e-12)
        jitter = np.abs(instants - nominal)[1:-1]
        assert jitter.std() == pytest.approx(5e-3 * 0.6, rel=0.4)
        t, joints = motion.swing.t, motion.swing.q.T
        expected = np.stack([np.interp(instants, t, q) for q in joints], axis=-1)
        assert_allclose(frames.joints, expected, atol=1e-12)
        offsets.append(frames.clock_offset)

    assert abs(np.mean(offsets) + 0.2) < 4 * 0.05 / 10
    assert abs(np.std(offsets) / 0.05 - 1) < 4 / np.sqrt(200)


def test_the_truth_is_where_the_arm_was_and_motion_capture_misses_it_by_its_jitter_alone(
    rng,
):
    lab = dynamics.open_session(ARM.chain, QUIET, rng)
    sharp = dynamics.perform(lab, TRAJECTORY, QUIET, rng)
    blurred = dynamics.perform(lab, TRAJECTORY, replace(QUIET, jitter_std=2e-3), rng)
    assert np.array_equal(sharp.motion_capture, sharp.truth)
    assert np.array_equal(blurred.truth, sharp.truth)

    speed = dynamics.desired_joints(np.arange(321) / TRAJECTORY.rate, TRAJECTORY)[1]
    fastest = np.abs(speed).max(axis=0).argmax()
    fast = np.abs(speed[:, fastest]) > 0.9 * np.abs(speed).max()
    error = blurred.motion_capture - blurred.truth
    missed = error[fast, fastest] / speed[fast, fastest]

    assert abs(missed.std() / 2e-3 - 1) < 4 / np.sqrt(2 * fast.sum())

    still = np.abs(speed).max(axis=1) == 0
    assert np.abs(error[still]).mean() < 0.02 * np.abs(error[fast]).mean()


def test_encoders_read_the_servo_to_their_resolution_and_nothing_behind_the_gears(rng):
    options = replace(QUIET, clearance=0.03)
    chance = dynamics.draw(ARM.chain, TRAJECTORY, options, rng)
    take = dynamics.swing(ARM.chain, OFFSET, TRAJECTORY, options, chance)
    assert np.abs(take.q - take.servo - OFFSET).max() > 1e-3

    t, signals = dynamics.log_joints(take, TRAJECTORY, ENCODERS)
    assert_allclose(t, np.arange(801) / 250, atol=1e-12)
    assert np.array_equal(signals["target"], dynamics.desired_joints(t, TRAJECTORY)[0])

    read = signals["actual"] / ENCODERS.resolution
    assert_allclose(read, np.round(read), atol=1e-9)

    servo = np.stack([np.interp(t, take.t, joint) for joint in take.servo.T], axis=1)
    error = signals["actual"] - servo
    assert np.abs(error).max() <= ENCODERS.resolution / 2 * (1 + 1e-9)

    # rounding is uniform where the arm moves
    moving = np.abs(np.gradient(servo, axis=0)).min(axis=1) > 1e-4
    assert error[moving].std() == pytest.approx(1e-3 / np.sqrt(12), rel=0.05)
