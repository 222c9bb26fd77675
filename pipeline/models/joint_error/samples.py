"""Runs of a position-controlled arm, commanded and measured joint angles on one clock, and the
predictions that count: horizons, commanded samples and jumps of the commanded speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray

HORIZONS = (0.0, 0.1, 0.5)  # s; the first is one sample
SETTLING = 0.6  # s after a jump of the commanded speed
JUMP = 5.0  # times the 0.8 quantile of the commanded acceleration: a jump of the speed
SMALL = 0.2  # rad/s², acceleration below which nothing counts as a jump
STANDING = 2e-4  # rad/s, commanded speed below which a joint stands still


@dataclass(frozen=True)
class JointRun:
    """One run of n joints at M+1 samples of a constant period, the data of a joint error law."""

    name: str
    rate: float  # samples per second
    command: ndarray  # (M+1, n) rad, commanded angles c_k, delayed by the run's own lag
    measured: ndarray  # (M+1, n) rad, measured angles q_k
    joints: tuple[str, ...]  # names of the joints, base to tip
    lag: ndarray  # (n,) s, delay of the measured angles that ``command`` includes
    quantum: ndarray  # (n,) rad, step of the recorded angles; 0 if unknown
    pose_noise: float | None  # rad, standard deviation of a measured angle, if known
    motion: str  # runs with equal commands have equal motions

    @cached_property
    def calm(self) -> ndarray:
        """(M+1, n) samples of :func:`settled`."""
        return settled(self.command, self.rate)

    @cached_property
    def moving(self) -> ndarray:
        """(M+1, n) True at samples to which a joint was commanded to move."""
        result = np.zeros(self.command.shape, dtype=bool)
        result[1:] = np.abs(np.diff(self.command, axis=0)) * self.rate > STANDING
        return result


def settled(command: ndarray, rate: float) -> ndarray:
    """(N, n) True where no jump of the commanded speed lies within the last SETTLING s."""
    change = np.zeros_like(command)
    change[2:] = rate**2 * np.abs(np.diff(command, 2, axis=0))
    moving = np.where(change > 1e-3, change, np.nan)
    usual = np.array(
        [np.nanquantile(a, 0.8) if np.any(a > 0) else 0.0 for a in moving.T]
    )
    jump = change > JUMP * np.maximum(usual, SMALL)
    count = np.cumsum(np.concatenate([np.zeros_like(jump[:1]), jump]), axis=0)
    now = np.arange(1, len(command) + 1)
    return count[now] == count[np.maximum(now - 1 - round(SETTLING * rate), 0)]


def counted(
    run: JointRun, steps: int, joints: Sequence[int] | slice = slice(None)
) -> ndarray:
    """(N − steps, n) True where a prediction ``steps`` samples ahead counts: the joint, one of the
    columns ``joints``, is commanded to move, and neither end is within SETTLING s of a jump of the
    commanded speed.
    """
    calm, moving = run.calm[:, joints], run.moving[:, joints]
    return (calm & moving)[steps:] & calm[: max(len(calm) - steps, 0)]


def horizons(rate: float) -> list[int]:
    """Numbers of samples of HORIZONS."""
    return [max(1, round(each * rate)) for each in HORIZONS]
