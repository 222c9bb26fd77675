"""The desired end-effector trajectory that commanded joint angles stand for."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.arm.chain import PlanarChain


def trajectory_table(chain: PlanarChain, q: np.ndarray, rate: float) -> pd.DataFrame:
    """xᵈ and ẋᵈ of commanded joint angles ``q`` (M+1, 3) in rad at ``rate`` per second: columns k,
    t, x, z, phi, vx, vz, vphi (SI).

    The velocity of step k is the mean velocity that takes the pose at t_k to the pose at t_{k+1},
    so that xᵈ_{k+1} = xᵈ_k + ẋᵈ_kΔt; it is exactly zero where the command rests.
    """
    pose = chain.pose(q)
    velocity = np.vstack([np.diff(pose, axis=0) * rate, np.zeros((1, 3))])
    k = np.arange(len(q))
    columns = {c: pose[:, i] for i, c in enumerate(("x", "z", "phi"))} | {
        f"v{c}": velocity[:, i] for i, c in enumerate(("x", "z", "phi"))
    }
    return pd.DataFrame({"k": k, "t": k / rate} | columns)
