"""Joint angles on the circle: wrapping, distances, and whole turns between two signals.

``circular`` (joints,) is False for a joint that has no whole turns, such as a prismatic one.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.core.errors import RecordingError

TURN = 2 * np.pi  # rad
ALIKE = 0.1  # rad, greatest distance on the circle at which two angles count as equal


def unwrap(
    angles: np.ndarray,
    time: np.ndarray,
    names: Sequence[str] = (),
    *,
    circular: np.ndarray | bool = True,
    signal: str = "actual",
    **evidence: object,
) -> tuple[np.ndarray, int]:
    """Return ``angles`` (N, joints) in rad without steps of more than half a turn, and the number
    of these steps.

    Raises RecordingError with the ``evidence`` for a step that differs from whole turns by more
    than a quarter turn; it names the joint by ``names`` and the place by ``time`` (N,) in s.
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
    """Return the whole turns (any shape) that bring the angles ``b`` in rad nearest to ``a``."""
    return np.where(circular, np.rint((a - b) / TURN), 0.0)


def apart(a: np.ndarray, b: np.ndarray, circular: np.ndarray | bool = True) -> np.ndarray:
    """Return the distances ``a`` − ``b`` in rad on the circle, from −π to π."""
    return a - b - TURN * turns_apart(a, b, circular)


def whole_turns(a: np.ndarray, b: np.ndarray, circular: np.ndarray | bool = True) -> np.ndarray:
    """Return median whole turns (joints,) of ``a`` − ``b`` (N, joints) rad; 0 if beyond ALIKE."""
    turns = np.rint(np.median(a - b, axis=0) / TURN)
    turns[np.median(np.abs(a - b - TURN * turns), axis=0) > ALIKE] = 0
    return turns * circular
