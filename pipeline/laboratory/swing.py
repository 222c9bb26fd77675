"""The commanded out-and-back motion: at rest, folded → most extended, at rest, back, at rest."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.interface import Chain
from pipeline.core.errors import ConfigError
from pipeline.laboratory.joint_path import JointPath
from pipeline.laboratory.options import TrajectoryOptions


def _progress(t: np.ndarray, options: TrajectoryOptions) -> tuple[np.ndarray, np.ndarray]:
    """Share of the way from folded to extended at times ``t`` (s), and its rate (1/s).

    The speed rises and falls as a raised cosine, so that acceleration is continuous; between the
    ramps it is constant.
    """
    half, ramp = options.duration / 2, options.ramp
    moving = half - 2 * options.rest
    peak = 1.0 / (moving - ramp)
    s = np.clip(np.minimum(t, options.duration - t) - options.rest, 0.0, moving)
    back = np.minimum(s, moving - s)
    inside = np.minimum(back, ramp)
    speed = peak * (1 - np.cos(np.pi * inside / ramp)) / 2
    way = peak * ((inside - ramp / np.pi * np.sin(np.pi * inside / ramp)) / 2 + back - inside)
    return np.where(s <= moving / 2, way, 1.0 - way), np.where(t <= half, speed, -speed)


def desired_joints(
    t: np.ndarray, motion: TrajectoryOptions | JointPath
) -> tuple[np.ndarray, np.ndarray]:
    """Commanded joint angles (..., n) in rad and speeds (..., n) in rad/s at times ``t`` (...) in
    s, of the out-and-back motion or of any joint path.
    """
    if isinstance(motion, JointPath):
        return motion.at(t)
    folded, extended = np.asarray(motion.folded), np.asarray(motion.extended)
    progress, rate = _progress(np.asarray(t, dtype=float), motion)
    return folded + progress[..., None] * (extended - folded), rate[..., None] * (extended - folded)


def desired_path(chain: Chain, options: TrajectoryOptions) -> np.ndarray:
    """(M+1, n) commanded joint angles in rad on the motion grid.

    Raises ConfigError for a motion of another number of joints, or beyond their limits of angle or
    speed.
    """
    if len(options.folded) != len(chain.lower):
        raise ConfigError(
            f"laboratory.trajectory: folded and extended must have {len(chain.lower)} angles each",
            folded=options.folded,
        )
    q, speed = desired_joints(
        np.arange(round(options.duration * options.rate) + 1) / options.rate, options
    )
    if not np.all(chain.within_limits(q)):
        raise ConfigError(
            "laboratory.trajectory: the motion leaves the joint limits",
            lower=chain.lower,
            upper=chain.upper,
        )
    if np.any(np.abs(speed) > chain.max_speed):
        raise ConfigError(
            "laboratory.trajectory: the motion is faster than the joints; lengthen it or bring its "
            "ends together",
            peak=np.abs(speed).max(axis=0).round(3).tolist(),
            limit=chain.max_speed.round(3).tolist(),
        )
    return q


def desired_trajectory(chain: Chain, options: TrajectoryOptions) -> pd.DataFrame:
    """The commanded end-effector trajectory xᵈ, ẋᵈ on the motion grid: columns k, t and the
    families x and v (SI); raises what :func:`desired_path` does.
    """
    return trajectory_table(chain, desired_path(chain, options), options.rate)
