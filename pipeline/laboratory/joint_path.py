"""Any joint path that the laboratory's arm is commanded to follow, as its controller interpolates
it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.errors import ConfigError

ROUNDING = 1e-9  # of a joint's speed limit, by which a step computed at the limit may be beyond it


@dataclass(frozen=True)
class JointPath:
    """Joint angles ``joints`` (M+1, n) in rad, ``rate`` of them a second.

    Between them the monotone cubic interpolant of Fritsch and Butland (SIAM J. Sci. Stat. Comput.
    5, 1984), whose speed is continuous: a joint turns back only where the path does, and rests
    where it rests.
    """

    joints: np.ndarray
    rate: float

    @property
    def duration(self) -> float:
        """s, from the first pose to the last."""
        return (len(self.joints) - 1) / self.rate

    @cached_property
    def _interpolant(self) -> Callable[..., np.ndarray]:
        from scipy.interpolate import PchipInterpolator

        return PchipInterpolator(np.arange(len(self.joints)) / self.rate, self.joints)

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angles (..., n) in rad and speeds (..., n) in rad/s at times ``t`` (...) in s."""
        return self._interpolant(t), self._interpolant(t, 1)

    def require_followable(self, chain: Chain) -> None:
        """Raise ConfigError, with the first step, where the path is none of ``chain``'s joints or
        beyond their limits of angle or of speed.
        """
        path = np.asarray(self.joints)
        if path.ndim != 2 or path.shape[1] != len(chain.lower) or len(path) < 2:
            raise ConfigError(
                f"a joint path has {len(chain.lower)} angles a pose, and two poses or more",
                shape=path.shape,
            )
        inside = chain.within_limits(path)
        if not np.all(inside):
            step = int(np.argmin(inside))
            raise ConfigError(
                "the joint path leaves the joint limits", step=step, q=path[step].tolist()
            )
        speed = np.abs(np.diff(path, axis=0)) * self.rate
        slow = np.all(speed <= (1 + ROUNDING) * chain.max_speed, axis=1)
        if not np.all(slow):
            step = int(np.argmin(slow))
            raise ConfigError(
                "the joint path is faster than the joints; give it more time",
                step=step,
                speed=speed[step].round(3).tolist(),
                limit=chain.max_speed.round(3).tolist(),
            )
