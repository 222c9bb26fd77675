"""From the arm's points in a take's depth frames to its joint angles: Eq. (KinObj), frame by
frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.arm.model import Arm
from pipeline.core.columns import spread
from pipeline.perception.articulation import ArticulationOptions, fit_sequence

NODES = ("2", "3", "e")


def articulate_rows(
    rows: pd.DataFrame,
    clouds: Sequence[np.ndarray],
    arm: Arm,
    joints: Sequence[str],
    trajectory: pd.DataFrame,
    options: ArticulationOptions,
    start: np.ndarray,
) -> pd.DataFrame:
    """Rows of the table ``angles`` of one take; frames without enough points of the arm are left
    out.

    Args:
        rows: the take's rows of the table ``frames``.
        clouds: of each of them the arm's points (I, 2), m in its plane.
        arm: whose chain is fitted.
        joints: names of its joints.
        trajectory: the table; EE is where it is commanded to be at the frames' times.
        options: of the articulation.
        start: (3,) rad, nominal pose of the first frame.
    """
    ee = [np.interp(rows["t"], trajectory["t"], trajectory[f"x:{row}"]) for row in ("x", "z")]
    origin, take = arm.chain.origin, rows["take"].iloc[0]
    fitted = fit_sequence(
        clouds, origin, np.stack(ee, axis=-1), arm.chain, options, start, take=take
    )
    nodes = {
        f"{axis}{name}": fitted.nodes[:, node, i]
        for node, name in enumerate(NODES, 1)
        for i, axis in enumerate("xz")
    }
    table = rows[["take", "part", "frame", "t"]].assign(
        **spread("q", joints, fitted.q), **nodes, points=fitted.points, objective=fitted.objective
    )
    return table[np.isfinite(fitted.objective)]
