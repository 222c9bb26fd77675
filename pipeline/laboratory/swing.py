"""The commanded motion: folded → extended and back with rests, or any joint path."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from pipeline.arm.interface import Chain, trajectory_table
from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import TrajectoryOptions

ROUNDING = 1e-9  # of a joint's speed limit, by which a step computed at the limit may be beyond it


@dataclass(frozen=True)
class JointPath:
    """Joint angles ``joints`` (M+1, n) in rad, ``rate`` a second; between them the monotone cubic
    interpolant of Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5, 1984): no overshoot.
    """

    joints: np.ndarray
    rate: float

    @property
    def duration(self) -> float:
        """s, from the first pose to the last."""
        return (len(self.joints) - 1) / self.rate

    @cached_property
    def interpolant(self) -> Callable[..., np.ndarray]:
        """Angles (..., n) in rad at times (...) in s, and their derivatives of an order."""
        from scipy.interpolate import PchipInterpolator

        return PchipInterpolator(np.arange(len(self.joints)) / self.rate, self.joints)

    def require_followable(self, chain: Chain) -> None:
        """ConfigError, with the first step, where the path is beyond the limits of ``chain``."""
        speed, inside = np.abs(np.diff(self.joints, axis=0)) * self.rate, chain.within_limits
        slow = np.all(speed <= (1 + ROUNDING) * chain.max_speed, axis=1)
        for fits, fault in (
            (inside(self.joints), "leaves the joint limits"),
            (slow, "is faster than the joints; give it more time"),
        ):
            if not fits.all():
                raise ConfigError(f"the joint path {fault}", step=int(np.argmin(fits)))


Commanded = TrajectoryOptions | JointPath


def desired_joints(t: np.ndarray, motion: Commanded) -> tuple[np.ndarray, np.ndarray]:
    """Return commanded joint angles (..., n) in rad and speeds (..., n) in rad/s at times ``t``
    (...) in s; out and back the speed rises and falls as a raised cosine, constant in between.
    """
    if isinstance(motion, JointPath):
        return motion.interpolant(t), motion.interpolant(t, 1)
    t, half, ramp = np.asarray(t, dtype=float), motion.duration / 2, motion.ramp
    moving = half - 2 * motion.rest
    peak = 1.0 / (moving - ramp)
    s = np.clip(np.minimum(t, motion.duration - t) - motion.rest, 0.0, moving)
    back = np.minimum(s, moving - s)
    inside = np.minimum(back, ramp)
    speed = peak * (1 - np.cos(np.pi * inside / ramp)) / 2
    way = peak * ((inside - ramp / np.pi * np.sin(np.pi * inside / ramp)) / 2 + back - inside)
    progress, rate = np.where(s <= moving / 2, way, 1.0 - way), np.where(t <= half, speed, -speed)
    folded, extended = np.asarray(motion.folded), np.asarray(motion.extended)
    return folded + progress[..., None] * (extended - folded), rate[..., None] * (extended - folded)


def desired_path(chain: Chain, options: TrajectoryOptions) -> np.ndarray:
    """Return commanded angles (M+1, n) in rad; ConfigError beyond the joints' limits."""
    key = "laboratory.trajectory"
    if len(options.folded) != len(chain.lower):
        raise ConfigError(f"{key}: folded and extended must have {len(chain.lower)} angles each")
    grid = np.arange(round(options.duration * options.rate) + 1) / options.rate
    q, speed = desired_joints(grid, options)
    if not np.all(chain.within_limits(q)):
        message = f"{key}: the motion leaves the joint limits"
        raise ConfigError(message, lower=chain.lower, upper=chain.upper)
    if np.any(np.abs(speed) > chain.max_speed):
        message = f"{key}: the motion is faster than the joints; give it more time or a shorter way"
        peak, limit = (v.round(3).tolist() for v in (np.abs(speed).max(axis=0), chain.max_speed))
        raise ConfigError(message, peak=peak, limit=limit)
    return q


def desired_trajectory(chain: Chain, options: TrajectoryOptions) -> pd.DataFrame:
    """Return the commanded trajectory on the grid: columns k, t and the families x and v (SI)."""
    return trajectory_table(chain, desired_path(chain, options), options.rate)
