"""The desired end-effector trajectory that commanded joint angles stand for."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.arm.interface import Chain
from pipeline.arm.serial import ROWS, SerialChain
from pipeline.core.columns import spread


def trajectory_table(
    chain: Chain, q: np.ndarray, rate: float, joints: Sequence[str] = ()
) -> pd.DataFrame:
    """xᵈ and ẋᵈ of commanded joint angles ``q`` (M+1, n) in rad at ``rate`` per second: columns k,
    t, the families x (:func:`task_coordinates`) and v of the chain's task (SI), and, of a redundant
    arm, u of its ``joints``, their speed in rad/s. v_kΔt is the displacement between the poses at
    t_k and t_{k+1}, zero in the last row.
    """
    pose, k = chain.pose(q), np.arange(len(q))
    steps = chain.displacement(pose[:-1], pose[1:]), np.diff(q, axis=0)
    v, u = (np.vstack([each * rate, np.zeros((1, each.shape[1]))]) for each in steps)
    x = task_coordinates(chain, pose)
    table = {"k": k, "t": k / rate} | spread("x", chain.task, x) | spread("v", chain.task, v)
    if len(chain.task) < q.shape[1]:
        table |= spread("u", joints, u)
    return pd.DataFrame(table)


def task_coordinates(chain: Chain, pose: np.ndarray) -> np.ndarray:
    """(M+1, m) the rows of the task along the poses ``pose`` (M+1, p) of a motion, in m and rad; of
    a serial chain, whose rotations have no coordinates, they are displaced from the first pose.
    """
    if not isinstance(chain, SerialChain):
        return pose
    x, rows = chain.displacement(pose[:1], pose), np.array([ROWS[name] for name in chain.task])
    return np.where(rows < 3, pose[:, np.minimum(rows, 2)], x)
