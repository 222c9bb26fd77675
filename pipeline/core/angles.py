"""Joint angles on the circle: wrapping, distances, and whole turns between two signals.

``circular`` (joints,) is False for a joint that has no whole turns, such as a prismatic one.
"""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pipeline.core.errors import RecordingError

TURN = 2 * np.pi  # rad
ALIKE = 0.1  # rad, greatest distance on the circle at which two angles count as equal
# turns, greatest angle of an arm's joint; greater angles have another unit
MOST_TURNS = 4
# rows before and after a jump that show the speed, and in which a spike ends
BESIDE = 5
SIDES = np.array([(0, 0), (1, 1), (0, 0)])  # sides of the rows, behind another axis
FASTEST = 3.0  # greatest speed during a jump over the speed beside it
TURN_NOISE = 0.02  # rad, greatest noise of a measured angle at a jump
# least step to a damaged row: rad, and over the steps beside it, or over all but the FEW greatest
SPIKE = 0.2
SHARPER = 20.0
FEW = 3


def unwrap(
    angles: np.ndarray,
    time: np.ndarray,
    names: Sequence[str] = (),
    *,
    circular: np.ndarray | bool = True,
    signal: str = "actual",
    lines: Sequence[int] = (),
    **evidence: object,
) -> tuple[np.ndarray, int]:
    """Return ``angles`` (N, joints) in rad without steps of more than half a turn, and the number
    of these steps.

    A step is whole turns if the rest of it is a motion as fast as in the rows beside it, and if the
    angles stay there, or never leave the window of a wrapped angle. Raises RecordingError with the
    ``evidence`` for any other step; it names the joint by ``names`` and the place by ``time`` (N,)
    in s and ``lines`` (N,) of the file.
    """
    steps = np.diff(angles, axis=0)
    turns = np.where(circular, np.rint(steps / TURN), 0.0)
    motion = steps - TURN * turns
    seconds = np.diff(time)[:, None]
    spikes = _spikes(motion, seconds, circular if signal == "actual" else False)
    if not turns.any() and not spikes.any():
        return angles, 0
    unlike = _unlike_turns(angles, turns, motion, seconds)
    faulty = spikes | ((turns != 0) & unlike)
    if faulty.any():
        row, joint = np.argwhere(faulty)[0].tolist()
        name = names[joint] if len(names) == angles.shape[1] else f"joint {joint + 1}"
        if len(lines):
            # after a step to the second row only, the first row is damaged
            first_row_only = row == 0 and not faulty[1:2, joint].any()
            damaged = row if first_row_only else row + 1
            evidence = {"line": lines[damaged]} | evidence
        raise RecordingError(
            f"{name} ({signal}) jumps by {steps[row, joint]:.4g} rad at "
            f"{time[row + 1] - time[0]:.6g} s from the start, which is neither a motion nor whole "
            "turns of 2π = 6.283 rad; a lost sign, rows before the first measurement, an encoder "
            "that was set anew? Check angle_unit, or leave this part of the log out",
            **evidence,
        )
    removed = np.cumsum(turns, axis=0)
    before = np.zeros_like(removed[:1])
    unwrapped = angles - TURN * np.vstack([before, removed])
    return unwrapped, int((turns != 0).sum())


def _unlike_turns(
    angles: np.ndarray,
    turns: np.ndarray,
    motion: np.ndarray,
    seconds: np.ndarray,
) -> np.ndarray:
    """Return the mask (N − 1, joints) of steps of ``angles`` (N, joints) in rad that are not whole
    ``turns``: the rest ``motion`` is too fast, the turns are too many, or the angles soon return
    from outside a wrapped angle's window.
    """
    reach = min(BESIDE, len(motion) - 1)
    size = np.abs(motion)
    count = np.abs(turns)
    speed = size / seconds
    without_turns = np.where(turns, 0.0, speed)
    both = np.stack([speed, without_turns])
    around = np.pad(both, SIDES * reach, mode="reflect")
    of_all, of_others = sliding_window_view(around, 2 * reach + 1, axis=1)
    fastest = np.maximum(np.median(of_all, axis=-1), of_others.max(axis=-1))
    beside = FASTEST * fastest * seconds + TURN_NOISE
    too_fast = size > np.minimum(beside, TURN / 4)

    after = np.pad(turns, ((0, reach), (0, 0)))
    later = sliding_window_view(after, reach + 1, axis=0)
    returns = (later == -turns[..., None]).any(axis=-1)
    outside = np.ptp(angles, axis=0) > TURN * count + TURN_NOISE
    return too_fast | (count > MOST_TURNS) | (returns & outside)


def _spikes(
    motion: np.ndarray,
    seconds: np.ndarray,
    measured: np.ndarray | bool,
) -> np.ndarray:
    """Return the mask (N − 1, joints) of steps to a single row far from the rows beside it, and of
    at most FEW steps of a ``measured`` angle far beyond all other steps; a command may step. A step
    over missing rows counts as the mean step in them.
    """
    size = np.abs(motion)
    if len(motion) < 2 * BESIDE:
        return np.zeros(motion.shape, dtype=bool)
    periods = np.maximum(seconds / np.median(seconds), 1)
    mean = size / periods
    most = np.partition(mean, -FEW - 1, axis=0)[-FEW - 1]
    measured_mean = np.where(measured, mean, 0.0)
    spikes = measured_mean > np.maximum(SPIKE, SHARPER * most)

    beside = np.pad(size, SIDES[1:] * BESIDE)
    # of the steps k and k + 1
    around = sliding_window_view(beside, 2 * BESIDE + 2, axis=0)
    usual = np.sort(around, axis=-1)[..., -3]  # the greatest but for the two of a spike
    smaller = np.minimum(size[:-1], size[1:])
    sharp = smaller > np.maximum(SPIKE, SHARPER * usual)
    back_and_forth = motion[:-1] * motion[1:] < 0
    spikes[:-1] |= back_and_forth & sharp
    return spikes


def turns_apart(
    a: np.ndarray,
    b: np.ndarray,
    circular: np.ndarray | bool = True,
) -> np.ndarray:
    """Return the whole turns (any shape) that bring the angles ``b`` in rad nearest to ``a``."""
    return np.where(circular, np.rint((a - b) / TURN), 0.0)


def apart(
    a: np.ndarray,
    b: np.ndarray,
    circular: np.ndarray | bool = True,
) -> np.ndarray:
    """Return the distances ``a`` − ``b`` in rad on the circle, from −π to π."""
    return a - b - TURN * turns_apart(a, b, circular)


def whole_turns(
    a: np.ndarray,
    b: np.ndarray,
    circular: np.ndarray | bool = True,
) -> np.ndarray:
    """Return median whole turns (joints,) of ``a`` − ``b`` (N, joints) rad; 0 if beyond ALIKE."""
    difference = a - b
    turns = np.rint(np.median(difference, axis=0) / TURN)
    distance = np.median(np.abs(difference - TURN * turns), axis=0)
    turns[distance > ALIKE] = 0
    return turns * circular
