"""Every reading of "LU or QR" (Eq. LUDecom), and the spread of the Wishart model under each.

A step's covariance depends on the first factor J₁ through J₁J₁ᵀ alone, and not on its size. For LU
without pivoting J₁J₁ᵀ is another for each order of the task rows and of the joints, so that the 36
orders of three rows and three joints are 36 laws. Pivoted LU is at every pose one of these. For the
QR of J it is the identity, for that of Jᵀ it is JJᵀ, in whatever order.
"""

from __future__ import annotations

from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np

from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.factors import split
from pipeline.models.wishart.law import step_covariance


class Reading(NamedTuple):
    """A factorisation, and the orders of task rows and joints that it is given."""

    name: str
    rows: tuple[int, ...]
    joints: tuple[int, ...]


def all_readings(m: int, n: int) -> list[Reading]:
    """Of a task of ``m`` rows and ``n`` joints: each factorisation in each order that makes another
    law of it.
    """
    rows, joints = tuple(range(m)), tuple(range(n))
    return [
        *(Reading("lu", r, j) for r in permutations(rows) for j in permutations(joints)),
        *(Reading("pivoted_lu", rows, j) for j in permutations(joints)),
        Reading("qr", rows, joints),
        Reading("qr_transposed", rows, joints),
    ]


def crossings(jacobian: np.ndarray) -> dict[tuple[frozenset, frozenset], np.ndarray]:
    """Whether each proper square minor of J changes its sign along a path, (P,) by its rows and
    joints, of ``jacobian`` (P, K, m, n).

    The k-th pivot of LU without pivoting is the quotient of two of them, the k-th leading one and
    the one before: a path along which a leading minor changes its sign meets a pivot that is zero.
    """
    m, n = jacobian.shape[-2:]
    result = {}
    for k in range(1, m):
        for rows in combinations(range(m), k):
            for joints in combinations(range(n), k):
                positive = np.linalg.det(jacobian[..., rows, :][..., joints]) > 0
                crossed = np.any(positive != positive[:, :1], axis=1)
                result[frozenset(rows), frozenset(joints)] = crossed
    return result


def wishart_spread(
    reading: Reading,
    jacobian: np.ndarray,
    v: np.ndarray,
    weights: np.ndarray,
    sigma_b: float,
    crossed: dict[tuple[frozenset, frozenset], np.ndarray],
) -> np.ndarray:
    """(P, n) root of the mean variance of each joint along every path, in rad, by the exact
    covariance of a step; NaN for a path that meets a small pivot, at a pose or between two.

    Args:
        reading: what is decomposed how.
        jacobian: (P, K, m, n) J at the poses of a path.
        v: (P, K, m) commanded steps there.
        weights: (K,) of the poses in the mean.
        sigma_b: σ_B.
        crossed: the :func:`crossings` of ``jacobian``.
    """
    result = np.full((len(jacobian), jacobian.shape[-1]), np.nan)
    regular = np.ones(len(jacobian), dtype=bool)
    rows, joints = list(reading.rows), list(reading.joints)
    if reading.name == "lu":
        for k in range(1, len(rows)):
            regular &= ~crossed[frozenset(rows[:k]), frozenset(joints[:k])]
    ordered = jacobian[regular][..., rows, :][..., joints]
    a, back, _ = split(ordered, v[regular][..., rows], Decomposition(reading.name))
    variance = np.diagonal(step_covariance(a, back, sigma_b), axis1=-2, axis2=-1)
    mean = np.sqrt(np.einsum("k,pkj->pj", weights, variance))
    result[np.flatnonzero(regular)[:, None], joints] = mean
    return result
