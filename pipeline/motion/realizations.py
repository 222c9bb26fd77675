"""Realisations of a motion model along the desired trajectory, step by step or running freely."""

from __future__ import annotations

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.errors import ConfigError
from pipeline.motion.model import MotionModel


def realize(
    model: MotionModel, chain: PlanarChain, q: np.ndarray, v: np.ndarray, mode: str, rng: np.random.Generator
) -> tuple[np.ndarray, int, int]:
    """(N, M+1, 3) joint angles in rad, for how many steps the noise had to be clipped, and how many realisations were lost.

    ``q`` (N, M+1, 3) recorded angles in rad, one take a realisation; ``v`` (M, 3) commanded steps (m, m, rad). ``one_step``: each step
    starts at the recorded pose, so that what spreads is the process noise of one step. ``free_running``: each realisation starts at its
    take's start pose and goes on from where it came to; one that comes to a singular pose, where no model is defined, is lost: NaN from
    there on. Raises ConfigError for another mode, SingularJacobianError for a singular pose in the recordings.
    """
    if mode not in ("one_step", "free_running"):
        raise ConfigError(f"simulation.mode: no mode {mode!r}; there are one_step, free_running", key="simulation.mode")
    result, clipped = np.full_like(q, np.nan), 0
    result[:, 0] = q[:, 0]
    alive = np.ones(len(q), dtype=bool)
    for k in range(len(v)):
        start = q[:, k]
        if mode == "free_running" and k > 0:
            start = result[:, k]
            alive &= ~chain.singular(start)
        result[alive, k + 1], count = model.sample(chain, start[alive], v[k], rng)
        clipped += count
    return result, clipped, int(np.sum(~alive))
