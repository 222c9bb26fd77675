"""Angles of joints on the circle: jumps of whole turns, distances, turns between two signals.

A joint that is not ``circular`` (joints,), as a prismatic one, has no whole turns.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.core.errors import RecordingError

TURN = 2 * np.pi  # rad
ALIKE = 0.1  # rad, within which two angles on the circle are one


def unwrapped(
    angles: np.ndarray,
    time: np.ndarray,
    names: Sequence[str] = (),
    *,
    circular: np.ndarray | bool = True,
    signal: str = "actual",
    **evidence: object,
) -> tuple[np.ndarray, int]:
    """Return ``angles`` (N, joints) in rad without jumps, steps of more than half a turn, and their
    number; ``time`` (N,) in s and ``names`` (joints) say where one is.

    Raises RecordingError with the ``evidence`` for a jump that differs from whole turns by more
    than a quarter of one: no controller wraps an angle so, and no joint moves so.
    """
    steps = np.diff(angles, axis=0)
    turns = np.where(circular, np.rint(steps / TURN), 0.0)
    if not turns.any():
        return angles, 0
    wrong = (turns != 0) & (np.abs(steps - TURN * turns) > TURN / 4)
    if wrong.any():
        row, joint = np.argwhere(wrong)[0].tolist()
        name = names[joint] if len(names) == angles.shape[1] else f"joint {joint + 1}"
        raise RecordingError(
            f"{name} ({signal}) jumps by {steps[row, joint]:.4g} rad at "
            f"{time[row + 1] - time[0]:.6g} s from the start, which is neither a motion nor whole "
            "turns of 2π = 6.283 rad: check angle_unit, or leave this part of the log out",
            **evidence,
        )
    removed = np.cumsum(turns, axis=0)
    return angles - TURN * np.vstack([np.zeros_like(removed[:1]), removed]), int((turns != 0).sum())


def turns_apart(a: np.ndarray, b: np.ndarray, circular: np.ndarray | bool = True) -> np.ndarray:
    """Return the whole turns (any shape) that take the angles ``b`` in rad nearest to ``a``."""
    return np.where(circular, np.rint((a - b) / TURN), 0.0)


def apart(a: np.ndarray, b: np.ndarray, circular: np.ndarray | bool = True) -> np.ndarray:
    """Return the distance ``a`` − ``b``: of angles in rad on the circle, from −π to π."""
    return a - b - TURN * turns_apart(a, b, circular)


def whole_turns(a: np.ndarray, b: np.ndarray, circular: np.ndarray | bool = True) -> np.ndarray:
    """Return the whole turns (joints,) by which angles ``a`` are beside ``b`` (N, joints) in rad; 0
    of a joint whose angles are not within a tenth of a radian of each other on the circle.
    """
    turns = np.rint(np.median(a - b, axis=0) / TURN)
    turns[np.median(np.abs(a - b - TURN * turns), axis=0) > ALIKE] = 0
    return turns * circular
