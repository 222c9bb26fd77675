"""Runs of a position-controlled arm: commanded and measured joint angles on one clock."""

from dataclasses import dataclass

from numpy import ndarray


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
