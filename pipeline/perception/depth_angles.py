"""From the depth frames of one take to its joint angles: Eq. (KinObj) on the arm's points, frame by frame."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.arm.model import Arm
from pipeline.perception.articulation import ArticulationOptions, fit_sequence
from pipeline.perception.depth_sequence import DepthSequence


def articulate_rows(
    rows: pd.DataFrame, sequence: DepthSequence, arm: Arm, trajectory: pd.DataFrame, options: ArticulationOptions, start: np.ndarray
) -> pd.DataFrame:
    """Rows of the table ``angles`` of one take's ``rows`` of the table ``frames``; frames without enough points of the arm are left out.

    EE is that of the table ``trajectory`` at the frames' times; ``start`` (3,) rad the nominal pose of the first frame.
    """
    clouds = [points for points, _ in sequence.points(rows["frame"])]
    ee = np.stack([np.interp(rows["t"], trajectory["t"], trajectory[c]) for c in "xz"], axis=-1)
    fitted = fit_sequence(clouds, arm.chain.origin, ee, arm.chain, options, start, take=rows["take"].iloc[0])
    nodes = {f"{c}{name}": fitted.nodes[:, node, i] for node, name in ((1, "2"), (2, "3"), (3, "e")) for i, c in enumerate("xz")}
    angles = {f"q{j + 1}": fitted.q[:, j] for j in range(3)}
    table = rows[["take", "part", "frame", "t"]].assign(**angles, **nodes, points=fitted.points, objective=fitted.objective)
    return table[np.isfinite(fitted.objective)]
