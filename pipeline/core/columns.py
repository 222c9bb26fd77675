"""Families of columns: one for each joint, or for each pair of joints, under the joints' own names.

A column ``q:arm_joint_2`` belongs to family ``q`` and joint ``arm_joint_2``;
``c:arm_joint_2:arm_joint_3`` is an entry of a symmetric matrix. The rows of the task are named
alike: ``v:x``. A colon within a name is written %3A, and a per cent sign before 3A or 25 as %25.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:  # an exported model is loaded with NumPy alone
    import pandas as pd

# rows that a task may have, in m and rad: of the plane of parallel joints, and of space
PLANE, SPACE = ("x", "z", "phi"), ("x", "y", "z", "rx", "ry", "rz")


def column(family: str, *names: str) -> str:
    """The column of ``family`` for a name, or for a pair of names."""
    written = (re.sub("%(?=3A|25)", "%25", name).replace(":", "%3A") for name in names)
    return ":".join([family, *written])


def columns(family: str, names: Sequence[str]) -> list[str]:
    """The columns of ``family`` for each of ``names``."""
    return [column(family, name) for name in names]


def pairs(family: str, names: Sequence[str]) -> list[str]:
    """The columns of the upper triangle of a symmetric matrix over ``names``, row by row."""
    return [column(family, *pair) for pair in combinations_with_replacement(names, 2)]


def members(table: pd.DataFrame, family: str) -> tuple[str, ...]:
    """The names that ``table`` has a column of ``family`` for, in its order."""
    split = (str(column).split(":") for column in table.columns)
    found = [parts[1] for parts in split if len(parts) == 2 and parts[0] == family]
    return tuple(name.replace("%3A", ":").replace("%25", "%") for name in found)


def values(table: pd.DataFrame, family: str) -> np.ndarray:
    """(rows, n) the values of ``family``, a column a joint."""
    return table[columns(family, members(table, family))].to_numpy()


def matrices(table: pd.DataFrame, family: str, names: Sequence[str]) -> np.ndarray:
    """(rows, n, n) symmetric matrices whose upper triangles stand in the columns of ``family``."""
    first, second = np.triu_indices(len(names))
    full = np.empty((len(table), len(names), len(names)))
    full[:, first, second] = full[:, second, first] = table[pairs(family, names)].to_numpy()
    return full


def spread(family: str, names: Sequence[str], array: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of ``family`` from ``array`` (..., n), its leading axes one after the other."""
    flat = np.reshape(array, (-1, len(names)))
    return dict(zip(columns(family, names), flat.T, strict=True))


def triangle(family: str, names: Sequence[str], array: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of the upper triangles of ``array`` (..., n, n)."""
    first, second = np.triu_indices(len(names))
    flat = np.reshape(array, (-1, len(names), len(names)))[:, first, second]
    return dict(zip(pairs(family, names), flat.T, strict=True))
