"""Families of table columns: one column for each joint, task row, or pair of joints.

The column ``q:arm_joint_2`` belongs to the family ``q`` and the joint ``arm_joint_2``; ``v:x``
belongs to the task row x. The column ``c:arm_joint_2:arm_joint_3`` is an entry of a symmetric
matrix. A colon in a name is written %3A, and a per cent sign before 3A or 25 as %25.
"""

import re
from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:  # an exported model is loaded with NumPy alone
    import pandas as pd

# possible rows of a task, in m and rad: in the plane of parallel joints, and in space
PLANE = ("x", "z", "phi")
SPACE = ("x", "y", "z", "rx", "ry", "rz")


def column(family: str, *names: str) -> str:
    """Name of the column of ``family`` for one name, or for a pair of ``names``."""
    escaped = (re.sub("%(?=3A|25)", "%25", name).replace(":", "%3A") for name in names)
    return ":".join([family, *escaped])


def columns(family: str, names: Sequence[str]) -> list[str]:
    """Names of the columns of ``family`` for each of ``names``."""
    return [column(family, name) for name in names]


def pairs(family: str, names: Sequence[str]) -> list[str]:
    """Names of the columns of the upper triangle of a matrix over ``names``, row by row."""
    return [column(family, *pair) for pair in combinations_with_replacement(names, 2)]


def members(table: "pd.DataFrame", family: str) -> tuple[str, ...]:
    """Names for which ``table`` has a column of ``family``, in the order of the columns."""
    names = []
    for label in table.columns:
        first, *escaped = str(label).split(":")
        if first == family and len(escaped) == 1:
            name = escaped[0].replace("%3A", ":")
            names.append(name.replace("%25", "%"))
    return tuple(names)


def values(table: "pd.DataFrame", family: str) -> np.ndarray:
    """Values (rows, n) of the columns of ``family``."""
    return table[columns(family, members(table, family))].to_numpy()


def matrices(table: "pd.DataFrame", family: str, names: Sequence[str]) -> np.ndarray:
    """Symmetric matrices (rows, n, n) over ``names``, from the columns of ``family``."""
    n = len(names)
    first, second = np.triu_indices(n)
    entries = table[pairs(family, names)].to_numpy()
    full = np.empty((len(table), n, n))
    full[:, first, second] = entries
    full[:, second, first] = entries
    return full


def spread(
    family: str,
    names: Sequence[str],
    array: np.ndarray,
) -> dict[str, np.ndarray]:
    """Columns of ``family`` by name, from ``array`` (..., n) with its leading axes flattened."""
    flat = np.reshape(array, (-1, len(names)))
    return dict(zip(columns(family, names), flat.T, strict=True))


def triangle(
    family: str,
    names: Sequence[str],
    array: np.ndarray,
) -> dict[str, np.ndarray]:
    """Columns of ``family`` by name, from the upper triangles of ``array`` (..., n, n)."""
    first, second = np.triu_indices(len(names))
    flat = np.reshape(array, (-1, len(names), len(names)))
    entries = flat[:, first, second]
    labels = pairs(family, names)
    return dict(zip(labels, entries.T, strict=True))
