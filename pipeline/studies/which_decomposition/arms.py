"""The decompositions on an arm in space, in other units and axes, and at the recorded level.

Pivoted LU compares entries of different units and axes with each other. The QR of J depends on the
units alone, the QR of Jᵀ on neither. The recorded level is the moment estimate of σ_B: the trace of
the exact covariance of a step, averaged over steps and takes, plus the trace of the measurement
noise equals the recorded trace.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.arm.interface import Chain
from pipeline.core.errors import ModelDomainError
from pipeline.models.steps import Recorded
from pipeline.models.wishart.law import StepSquares, dispersion_of_trace
from pipeline.studies.which_decomposition.laws import (
    PIVOTED,
    PLAIN,
    QR,
    QR_TRANSPOSED,
    wishart_parts,
    wishart_variance,
)

GENERAL = (PIVOTED, QR, QR_TRANSPOSED)  # readings for a task of any size
MILLIMETRES = np.diag([1000.0] * 3 + [1.0] * 3)  # of a task in m and rad


def turned_axes(degrees: float) -> np.ndarray:
    """(6, 6) task rows x, y, z and their rotations, in axes turned about z."""
    angle = np.radians(degrees)
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    return np.kron(np.eye(2), turn)


def unit_rows(chain: Chain, q: np.ndarray, turns: Sequence[float], sigma_b: float) -> pd.DataFrame:
    """Return the table ``units`` of the poses ``q`` (K, n), equally far apart on a straight line in
    the joints, of an arm whose task is its whole pose; ``turns`` in degrees.
    """
    jacobian, pseudoinverse = chain.jacobian(q), chain.inverse_jacobian(q)
    cases = [("m", 0.0, np.eye(6)), ("mm", 0.0, MILLIMETRES)]
    cases += [("m", degrees, turned_axes(degrees)) for degrees in turns]
    rows = []
    for unit, degrees, change in cases:
        changed = np.moveaxis(change @ jacobian, 0, -1)
        inverse = np.moveaxis(pseudoinverse @ np.linalg.inv(change), 0, -1)
        v = np.einsum("ijk,j->ik", changed, q[1] - q[0])
        for reading in GENERAL:
            parts = wishart_parts(reading, changed, inverse, v)
            variance = wishart_variance(parts, len(v), sigma_b)
            noise = np.sqrt(variance.sum() / parts[1].sum())
            rows.append({"reading": reading, "unit": unit, "turn": degrees, "noise": noise})
    return pd.DataFrame(rows)


def level_rows(recorded: Recorded) -> pd.DataFrame:
    """Return the table ``level``; a reading without a σ_B at the recorded level, as where a pivot
    vanishes on the motion, has gaps.

    Raises ModelDomainError where the motion never rests and the measurement noise is not stated.
    """
    chain, (takes, steps, n) = recorded.chain, recorded.q.shape
    m = len(chain.task)
    v = np.broadcast_to(recorded.v[..., :m], (takes, steps, m)).reshape(-1, m).T.copy()
    jacobian, inverse = (
        np.moveaxis(of(recorded.q.reshape(-1, n)), 0, -1).copy()
        for of in (chain.jacobian, chain.inverse_jacobian)
    )
    variance = recorded.noise.var(axis=0, ddof=1).mean(axis=0) - np.diag(recorded.measurement)
    rows = [_level("recorded", np.nan, variance)]
    plain = tuple(PLAIN) if m == n == 3 else ()
    for reading in (PIVOTED, *plain, QR, QR_TRANSPOSED):
        parts = [part.mean(axis=-1) for part in wishart_parts(reading, jacobian, inverse, v)]
        squares = StepSquares(*(part.sum() for part in parts))
        try:
            sigma_b = dispersion_of_trace(squares, variance.sum(), m)
        except ModelDomainError:
            sigma_b = np.nan
        rows.append(_level(reading, sigma_b, wishart_variance(parts, m, sigma_b)))
    return pd.concat(rows, ignore_index=True)


def _level(reading: str, sigma_b: float, variance: np.ndarray) -> pd.DataFrame:
    joints = {"joint": range(1, len(variance) + 1), "std": np.sqrt(np.maximum(variance, 0.0))}
    return pd.DataFrame(joints).assign(reading=reading, sigma_b=sigma_b)
