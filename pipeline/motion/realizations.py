"""Realisations of a motion model along the desired trajectory, step by step or running freely."""

from __future__ import annotations

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.errors import ConfigError
from pipeline.motion.model import MotionModel


def realize(
    model: MotionModel, chain: PlanarChain, q: np.ndarray, v: np.ndarray, mode: str, rng: np.random.Generator
) -> tuple[np.ndarray, int]:
    """(N, M+1, 3) joint angles in rad, and for how many steps the model's noise had to be clipped.

    ``q`` (N, M+1, 3) recorded angles in rad, one take a realisation; ``v`` (M, 3) commanded steps (m, m, rad). ``one_step``: each step
    starts at the recorded pose, so that what spreads is the process noise of one step. ``free_running``: each realisation starts at its
    take's start pose and goes on from where it came to. Raises ConfigError for another mode, SingularJacobianError.
    """
    if mode not in ("one_step", "free_running"):
        raise ConfigError(f"simulation.mode: no mode {mode!r}; there are one_step, free_running", key="simulation.mode")
    result, clipped = np.empty_like(q), 0
    result[:, 0] = q[:, 0]
    for k in range(len(v)):
        start = q[:, k] if mode == "one_step" else result[:, k]
        result[:, k + 1], count = model.sample(chain, start, v[k], rng)
        clipped += count
    return result, clipped
