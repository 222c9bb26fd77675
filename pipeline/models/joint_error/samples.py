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
USUAL = 0.9  # quantile of the size of the commanded acceleration in motion
JUMP = 5.0  # times the USUAL acceleration: a jump of the speed
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
        return moving_samples(self.command, self.rate)


def accelerations(command: ndarray, rate: float) -> ndarray:
    """(N, n) size in rad/s² of the steps of the commanded speed; 0 at the first two samples."""
    change = np.zeros_like(command)
    change[2:] = rate**2 * np.abs(np.diff(command, 2, axis=0))
    return change


def moving_samples(command: ndarray, rate: float) -> ndarray:
    """(N, n) True at samples to which a joint is commanded to move."""
    result = np.zeros(command.shape, dtype=bool)
    result[1:] = np.abs(np.diff(command, axis=0)) * rate > STANDING
    return result


def jump_threshold(commands: Sequence[ndarray], rate: float) -> ndarray:
    """(n,) rad/s², acceleration beyond which the speed of the ``commands`` (N, n) in rad jumps:
    JUMP times their USUAL quantile in motion, or times SMALL.
    """
    changes = [accelerations(command, rate) for command in commands]
    samples = [moving_samples(command, rate) for command in commands]
    change = np.concatenate(changes)
    moving = np.concatenate(samples)
    usual = np.full(change.shape[1], SMALL)
    for j, moves in enumerate(moving.T):
        if moves.any():
            in_motion = change[moves, j]
            quantile = np.quantile(in_motion, USUAL)
            usual[j] = max(quantile, SMALL)
    return JUMP * usual


def settled(command: ndarray, rate: float) -> ndarray:
    """(N, n) True where no jump of the commanded speed lies within the last SETTLING s."""
    jump = accelerations(command, rate) > jump_threshold([command], rate)
    count = np.cumsum(np.concatenate([np.zeros_like(jump[:1]), jump]), axis=0)
    now = np.arange(1, len(command) + 1)
    return count[now] == count[np.maximum(now - 1 - round(SETTLING * rate), 0)]


def lasting_speeds(run: JointRun) -> ndarray:
    """(M, n) commanded speeds in rad/s that last for two samples, 0 elsewhere: what a command does
    between two rows of a gap in the clock is not a speed of the arm.
    """
    speed = run.rate * np.diff(run.command, axis=0)
    following = np.concatenate([speed[1:], np.zeros_like(speed[:1])])
    lower = np.minimum(np.abs(speed), np.abs(following))
    return np.where(speed * following > 0, np.sign(speed) * lower, 0.0)


def lags_of_logs(runs: Sequence[JointRun]) -> ndarray:
    """(logs, n) lags in s of the logs of ``runs``: the runs of one log have one lag."""
    return np.unique([run.lag for run in runs], axis=0)


def horizon_samples(rate: float) -> list[int]:
    """Numbers of samples of HORIZONS."""
    return [max(1, round(horizon * rate)) for horizon in HORIZONS]
