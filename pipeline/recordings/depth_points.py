"""The arm's points in the frames of a depth take, in a file beside the table ``frames``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd


def write_points(clouds: Sequence[np.ndarray], take: str, folder: Path) -> None:
    """Write of each frame of ``take`` the points (I, 2) of the arm, in m in its plane."""
    np.save(folder / f"{take}.npy", np.concatenate(clouds))


def arm_points(rows: pd.DataFrame, folder: Path) -> list[np.ndarray]:
    """Of each of a take's ``rows`` of the table ``frames``, all of them in their order: what
    :func:`write_points` wrote below ``folder``.
    """
    take = rows["take"].iloc[0]
    return np.split(np.load(folder / f"{take}.npy"), np.cumsum(rows["points"])[:-1])
