"""The error of the depth camera's joint angles against the deviation of the arm, in bins."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.core.columns import members, values
from pipeline.perception.depth_state import near_a_sample

BINS = 8  # of as many frames each


def error_bins(table: pd.DataFrame, step: float) -> pd.DataFrame:
    """Mean error by deviation over the frames near a sample of the motion capture: columns joint,
    deviation, error and standard_error, in rad.

    ``table``: as of :func:`pipeline.perception.depth_state.deviations`; ``step`` in s.
    """
    part, rows = table[near_a_sample(table, step)], []
    for joint, d, e in zip(
        members(part, "e"), values(part, "d").T, values(part, "e").T, strict=True
    ):
        for inside in np.array_split(np.argsort(d, kind="stable"), min(BINS, len(d)) or 1):
            if len(inside):
                own = e[inside]
                spread = own.std(ddof=1) / np.sqrt(len(own)) if len(own) > 1 else np.nan
                row = {"deviation": d[inside].mean(), "error": own.mean()}
                rows.append({"joint": joint} | row | {"standard_error": spread})
    return pd.DataFrame(rows, columns=["joint", "deviation", "error", "standard_error"])
