"""The motions of a log are found with their ends, steps, pauses and repetitions; a disturbed one of
these is named; a command that never rests is cut where the arm is nearly singular.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline import arm
from pipeline.core.options.dataset import Robot
from pipeline.recordings.logged_movement import LoggedMovement
from pipeline.recordings.motions import motions
from pipeline.recordings.repetitions import commanded_speeds

JOINTS = tuple(f"joint_{j}" for j in range(1, 7))
ROBOT = Robot(str(Path(arm.__file__).with_name("ur5.urdf")), list(JOINTS), "flange")
RATE, STEPS, PAUSE = 100.0, 80, 30
HOME = np.array([0.3, -1.2, 1.4, -1.0, -1.2, 0.2])
AWAY = HOME + np.array([0.4, 0.3, -0.3, 0.2, 0.2, 0.5])


def movement(target: np.ndarray, pushed: int | None = None) -> LoggedMovement:
    """With encoder noise, the arm being pushed for 20 rows from row ``pushed``."""
    actual = target + np.random.default_rng(1).normal(0, 1e-5, target.shape)
    if pushed is not None:
        actual[pushed : pushed + 20, 1] += 0.02
    return LoggedMovement(JOINTS, actual, target, commanded_speeds(target, RATE), {}, {})


def rounds(times: int) -> np.ndarray:
    """There and back, so many times, resting before and after each."""
    way = (1 - np.cos(np.pi * np.arange(1, STEPS + 1) / STEPS))[:, None] / 2
    there, back = HOME + way * (AWAY - HOME), AWAY + way * (HOME - AWAY)
    rest = [np.tile(end, (PAUSE, 1)) for end in (AWAY, HOME)]
    return np.vstack([rest[1], *[there, rest[0], back, rest[1]] * times])


@pytest.mark.parametrize("pushed", [None, 3 * (2 * STEPS + 2 * PAUSE) + PAUSE + 40])
def test_motions_have_ends_steps_pauses_and_repetitions(pushed):
    listed = motions({"run": movement(rounds(5), pushed)}, ROBOT, RATE)
    assert [(motion.steps, motion.pause, len(motion.places)) for motion in listed] == [
        (STEPS, PAUSE, 5)
    ] * 2
    there = next(motion for motion in listed if np.allclose(motion.start, HOME))
    np.testing.assert_allclose(there.end, AWAY, atol=1e-3)
    # the fourth one there, and no other, was disturbed
    assert there.disturbed == ([] if pushed is None else [there.places[3]])
    assert there.deviation < 1e-9 and there.least_singular > 0.05
    # less than half of the pause, so that no row at rest is in two takes
    assert 0 < there.rest(RATE) < PAUSE / 2


def test_a_command_that_never_rests_is_cut_where_the_arm_is_nearly_singular():
    t = np.arange(2000) / RATE
    swing = np.array([0.5, 0.2, 0.2, 0.3, 0.9, 0.4])  # joint 5 passes through 0
    centre = HOME * np.array([1, 1, 1, 1, 0, 1])
    target = centre + swing * np.sin(2 * np.pi * t[:, None] / 5)
    listed = motions({"run": movement(target)}, ROBOT, RATE)
    assert listed and all(motion.pause is None and motion.rest(RATE) == 0 for motion in listed)
    for motion in listed:
        assert np.sign(motion.start[4]) == np.sign(motion.end[4]) and motion.least_singular > 0.01
    # the control: between them the wrist is straight, so that the whole period is none
    assert max(motion.steps for motion in listed) < 250


def test_a_motion_of_other_joints_is_none():
    target = rounds(3)
    target[:, :5] = HOME[:5]
    assert motions({"run": movement(target)}, ROBOT, RATE)
    held = Robot(ROBOT.urdf, list(JOINTS[1:4]), "wrist_centre", plane=True)
    assert not motions({"run": movement(target)}, held, RATE)
