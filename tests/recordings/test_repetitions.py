"""Repetitions in a log are found by their commands."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from pipeline.recordings import repetitions
from pipeline.recordings.lags import in_phase, lag, stretch

RATE = 125.0
HOME = np.array([0.3, -2.0, -1.9, -0.4])
AWAY = np.array([-0.2, -3.0, -0.2, -1.5])
STEPS = 100


def way(
    start: np.ndarray,
    end: np.ndarray,
    steps: int = STEPS,
) -> tuple[np.ndarray, np.ndarray]:
    """Angles and speeds on the rows of a motion from rest to rest: the speed is not zero on the
    ``steps`` rows after the first.
    """
    share = np.arange(1, steps + 1)[:, None] / (steps + 1)
    progress = (1 - np.cos(np.pi * share)) / 2
    progress_speed = np.pi / 2 * np.sin(np.pi * share) / (steps + 1) * RATE
    stroke = end - start
    return start + progress * stroke, progress_speed * stroke


def rest(rows: int, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles and speeds on the rows of a pause."""
    return np.tile(pose, (rows, 1)), np.zeros((rows, len(pose)))


def log(*parts: tuple, creep: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Commanded angles and speeds of parts :func:`rest` and :func:`way`; at rest the angles creep
    by a standard deviation in rad.
    """
    angles, speeds = map(np.vstack, zip(*parts, strict=True))
    resting = ~speeds.any(axis=1)
    noise = default_rng(0).normal(0, creep, angles.shape)
    return angles + resting[:, None] * noise, speeds


OUT = way(HOME, AWAY)
BACK = way(AWAY, HOME)
AT_HOME = rest(50, HOME)
AT_AWAY = rest(50, AWAY)
OUT_AND_BACK = (AT_HOME, OUT, AT_AWAY, BACK)
WHOLE = (*OUT_AND_BACK, *OUT_AND_BACK, AT_HOME, OUT, AT_AWAY)


def find(angles, speeds, *, steps=STEPS, start=HOME, end=AWAY):
    """Repetitions of a motion with rests of at least 20 rows, by the last three joints."""
    motions = repetitions.excursions(angles, speeds)
    ends = start[1:], end[1:]
    return repetitions.find_repetitions(angles[:, 1:], motions, ends, steps, 20)


def first_rows(motions) -> list[int]:
    return [motion.first for motion in motions]


@pytest.mark.parametrize("noise", [0.0, 5e-5])
def test_ways_out_and_back_are_told_apart_by_their_commands_in_spite_of_noise(noise):
    angles, speeds = log(*WHOLE, creep=noise)
    speeds += default_rng(1).uniform(-noise, noise, speeds.shape)

    out = find(angles, speeds)
    back = find(angles, speeds, start=AWAY, end=HOME)

    assert first_rows(out.runs) == [50, 350, 650]
    assert first_rows(back.runs) == [200, 500]
    assert out.left_out["other_motion"] == [200, 500]
    assert {run.steps for run in out.runs + back.runs} == {STEPS}
    # the control: a speed that encoders would see is motion
    assert find(angles, speeds + 1e-3).runs == []


def test_a_way_without_enough_rest_beside_it_is_left_out():
    short = rest(10, AWAY)
    result = find(*log(AT_HOME, OUT, short, BACK, AT_HOME, OUT, AT_AWAY))

    assert first_rows(result.runs) == [310]
    assert result.left_out["too_little_rest"] == [50]


def test_a_way_at_another_speed_is_another_motion():
    slower = way(HOME, AWAY, 130)
    angles, speeds = log(*OUT_AND_BACK, AT_HOME, slower, AT_AWAY)

    assert first_rows(find(angles, speeds).runs) == [50]
    assert first_rows(find(angles, speeds, steps=130).runs) == [350]


def test_the_jerk_of_a_controller_taking_over_and_a_rest_are_no_excursions():
    jerk = rest(3, HOME), way(HOME, HOME + 5e-4, 3)
    motions = repetitions.excursions(*log(*jerk, AT_HOME, OUT, AT_AWAY))

    assert first_rows(motions) == [56]
    assert repetitions.excursions(*log(rest(300, HOME))) == []


@pytest.mark.parametrize("shift", [-2, -1, 0, 1, 2])
def test_takes_are_aligned_on_their_commands_to_the_row(shift):
    angles, _ = log(*WHOLE, creep=5e-5)
    reference = log(*WHOLE)[0][50 : 50 + STEPS + 1]
    assert in_phase(angles, 350 + shift, reference, 2, whole=True) == 350


@pytest.mark.parametrize("delay", [0.0, 0.6e-3, -0.4e-3, 0.3, -0.2])
def test_the_lag_of_the_measured_angles_is_recovered_and_none_at_rest(delay):
    def curve(t: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(2 * t), np.cos(3 * t)], axis=1)

    time = np.arange(300) / RATE
    rng = default_rng(2)
    noise = rng.normal(0, 1e-4, (300, 2))
    measured = curve(time - delay) + noise
    # standard error 1e-4 / sqrt(Σ q̇²) = 3 µs
    assert lag(curve(time), measured, RATE) == pytest.approx(delay, abs=12e-6)
    command, at_rest = rng.normal(-0.3, 1e-5, (2, 300, 3))
    assert np.isnan(lag(command, at_rest, RATE))


def periodic(rows: int, period: float) -> np.ndarray:
    """A command (rows, 2) in rad without rest that repeats after ``period`` rows."""
    phase = 2 * np.pi * np.arange(rows) / period
    first = np.sin(phase)
    second = 0.5 * np.cos(2 * phase) + 0.2 * np.sin(phase)
    return np.stack([first, second], axis=1)


def test_a_motion_in_passing_is_found_in_each_period_and_brought_in_phase():
    period = 251.3274
    steps = 180
    command = periodic(800, period)
    reference = command[20:201]
    ends = reference[0], reference[-1]

    outcome = repetitions.find_repetitions(command, [], ends, steps, rest=0)

    assert first_rows(outcome.runs) == [20, 271, 523]
    assert outcome.left_out == {"overlapping": []}
    assert {run.steps for run in outcome.runs} == {steps}
    for number, run in enumerate(outcome.runs):
        place = in_phase(command, run.first, reference, 2)
        assert place == pytest.approx(20 + number * period, abs=1e-4)
        moved = stretch(command, place, steps + 1)
        assert_allclose(moved, reference, atol=1e-6)
    # the control: by whole rows the last one is off by a third of a row
    assert np.abs(command[523:704] - reference).max() > 5e-3


def test_motions_that_would_overlap_are_left_out():
    command = periodic(800, 200.0)
    ends = command[10], command[260]

    outcome = repetitions.find_repetitions(command, [], ends, 250, rest=0)

    assert first_rows(outcome.runs) == [10, 410]
    assert outcome.left_out == {"overlapping": [210]}
