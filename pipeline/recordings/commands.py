"""The commanded motion of the end-effector: the table ``trajectory``, and the steps that it asks
for.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.core.columns import values

STEADY = 0.9  # of the speed, so that noise of the mean path leaves no gap


def commanded_steps(trajectory: pd.DataFrame, rate: float) -> np.ndarray:
    """(M, m) v = ẋᵈΔt of the steps that start at k = 0 … M − 1 of the table ``trajectory``, in m
    and rad; ``rate`` of the motion in 1/s. Of a redundant arm (M, m + n): v, and the commanded
    joint steps that it leaves a choice of.
    """
    return np.hstack([values(trajectory, family) for family in ("v", "u")])[:-1] / rate


def constant_speed(q: np.ndarray) -> np.ndarray:
    """(M,) which steps of the mean of ``q`` (takes, M+1, n) in rad go at the motion's constant
    speed: at least STEADY of the speed that only a tenth of them exceed.
    """
    pace = np.linalg.norm(np.diff(q.mean(axis=0), axis=0), axis=-1)
    return pace >= STEADY * np.quantile(pace, 0.9)
