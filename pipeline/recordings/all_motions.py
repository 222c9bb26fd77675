"""Steps of every motion in a dataset's recordings, each against its command: what the plain models
are fitted to and scored on.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.core.angles import apart
from pipeline.core.options.dataset import Dataset
from pipeline.models.other_motions import MotionSteps
from pipeline.recordings.logged_movement import read_logged_movement
from pipeline.recordings.motions import motions
from pipeline.recordings.take_names import named_takes

SAME = 0.02  # rad: motions whose ends are this near and as long are repetitions of one


def logged_motions(dataset: Dataset) -> list[MotionSteps]:
    """Every motion in the controller's logs of ``dataset``, those that repeat and those that do
    not, most repetitions first; repetitions that differ from the others are left out.

    Raises what reading the logs raises; empty for a command that neither rests nor repeats.
    """
    log, rate, robot = dataset.joint_log, dataset.motion.rate, dataset.robot
    places = named_takes(Path(dataset.recordings), log.movements, key="dataset.joint_log.movements")
    movements = {
        name: read_logged_movement(name, place, log, rate) for name, place in places.items()
    }
    columns = [log.joints.index(joint) for joint in robot.joints]
    found: list[MotionSteps] = []
    ends: list[tuple[np.ndarray, int]] = []
    for motion in motions(movements, robot, rate):
        rest, kept = motion.rest(rate), []
        for name, row in motion.places:
            rows = movements[name]
            first, last = max(row - 1 - rest, 0), row + motion.steps + rest
            if (name, row) in motion.disturbed or last >= len(rows.actual):
                continue
            kept.append([each[first : last + 1, columns] for each in (rows.actual, rows.target)])
        if not kept:
            continue
        length = min(len(actual) for actual, _ in kept)
        actual = np.stack([each[:length] for each, _ in kept])
        dq = np.stack([np.diff(each[:length], axis=0) for _, each in kept])
        steps = MotionSteps("", actual[:, :-1], dq, np.diff(actual, axis=1) - dq)
        place = np.concatenate([motion.start, motion.end])
        if any(
            size == motion.steps and np.abs(apart(other, place)).max() < SAME
            for other, size in ends
        ):
            continue
        ends.append((place, motion.steps))
        found.append(steps)
    return [replace(each, name=str(number)) for number, each in enumerate(found, 1)]
