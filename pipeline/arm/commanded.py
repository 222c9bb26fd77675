"""The desired end-effector trajectory that commanded joint angles stand for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.arm.interface import Chain
from pipeline.core.columns import spread


def trajectory_table(
    chain: Chain, q: np.ndarray, rate: float, joints: Sequence[str] = ()
) -> pd.DataFrame:
    """xᵈ and ẋᵈ of commanded joint angles ``q`` (M+1, n) in rad at ``rate`` per second: columns k,
    t, the families x and v of the chain's task (SI), and, of a redundant arm, u of its ``joints``,
    their commanded speed in rad/s.

    The velocity of step k is the mean velocity that takes the pose at t_k to the pose at t_{k+1},
    so that v_kΔt is their displacement; it is exactly zero where the command rests. x is the pose,
    or, where a pose has no coordinates of its own (a rotation in space), its displacement from the
    first one.
    """
    pose = chain.pose(q)
    k = np.arange(len(q))
    coordinates = pose.shape[-1] == len(chain.task)
    x = pose if coordinates else chain.displacement(pose[:1], pose)
    v = _speeds(chain.displacement(pose[:-1], pose[1:]), rate)
    table = {"k": k, "t": k / rate} | spread("x", chain.task, x) | spread("v", chain.task, v)
    if len(chain.task) < q.shape[1]:
        table |= spread("u", joints, _speeds(np.diff(q, axis=0), rate))
    return pd.DataFrame(table)


def _speeds(steps: np.ndarray, rate: float) -> np.ndarray:
    """(M+1, …) per second; none follows the last row."""
    return np.vstack([steps * rate, np.zeros((1, steps.shape[1]))])
