"""Joint logs written as a plain table, which :mod:`pipeline.formats.joints.table` reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np


def labels(signal: str, joints: Sequence[str]) -> list[str]:
    """The columns of a ``signal`` of the ``joints``."""
    return [f"{signal}_{joint}" for joint in joints]


def write_joint_table(
    file: Path, time: np.ndarray, signals: Mapping[str, np.ndarray], joints: Sequence[str]
) -> None:
    """Write ``time`` (N,) in s, to a microsecond, and the ``signals``, each (N, joints) in rad, to
    a tenth of a microradian, under a row of :func:`labels`.
    """
    header = ["time", *(label for signal in signals for label in labels(signal, joints))]
    table = np.column_stack([time, *signals.values()])
    row = ",".join(["%.6f", *["%.7f"] * (table.shape[1] - 1)]) + "\n"
    rows = row * len(table) % tuple(table.ravel().tolist())
    Path(file).write_text(",".join(header) + "\n" + rows, newline="")
