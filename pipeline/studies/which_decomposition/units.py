"""Noise of a step of an arm in space under each decomposition: units of length and the base's axes.

Pivoted LU compares entries of different units and axes with each other. The QR of J depends on the
units alone, the QR of Jᵀ on neither.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from omegaconf import MISSING

from pipeline.arm.interface import Chain
from pipeline.studies.which_decomposition.laws import (
    PIVOTED,
    QR,
    QR_TRANSPOSED,
    wishart_parts,
    wishart_variance,
)

GENERAL = (PIVOTED, QR, QR_TRANSPOSED)  # readings for a task of any size
MILLIMETRES = 1000.0  # a metre


@dataclass
class SpaceMotion:
    """A motion straight in the joints of an arm of ``pipeline/conf/dataset``."""

    arm: str = MISSING
    start: list[float] = field(default_factory=list)  # rad
    end: list[float] = field(default_factory=list)
    poses: int = MISSING
    turns: list[float] = field(default_factory=list)  # degrees, of the base's axes about z


def turned(degrees: float) -> np.ndarray:
    """(6, 6) task rows x, y, z and their rotations, in axes turned about z."""
    angle = np.radians(degrees)
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    return np.kron(np.eye(2), turn)


def step_noise(
    reading: str, jacobian: np.ndarray, inverse: np.ndarray, v: np.ndarray, sigma_b: float
) -> float:
    """Root mean square noise over the root mean square step ‖J⁺v‖, of ``jacobian`` (m, n, K),
    ``inverse`` J⁺ (n, m, K) and ``v`` (m, K).
    """
    total, nominal = wishart_parts(reading, jacobian, inverse, v)
    variance = wishart_variance((total, nominal), len(v), sigma_b)
    return float(np.sqrt(variance.sum() / nominal.sum()))


def unit_rows(chain: Chain, motion: SpaceMotion, sigma_b: float) -> pd.DataFrame:
    """Return the table ``units`` of ``motion`` along the whole pose of the arm ``chain``."""
    way = np.subtract(motion.end, motion.start)
    q = motion.start + way * np.linspace(0, 1, motion.poses)[:, None]
    jacobian = chain.jacobian(q)
    lengths = np.diag([MILLIMETRES] * 3 + [1.0] * 3)
    cases = [("m", 0.0, np.eye(6)), ("mm", 0.0, lengths)]
    cases += [("m", degrees, turned(degrees)) for degrees in motion.turns]
    rows = []
    for unit, degrees, change in cases:
        changed = np.moveaxis(change @ jacobian, 0, -1)
        inverse = np.moveaxis(np.linalg.pinv(jacobian) @ np.linalg.inv(change), 0, -1)
        v = np.einsum("ijk,j->ik", changed, way / motion.poses)
        for reading in GENERAL:
            noise = step_noise(reading, changed, inverse, v, sigma_b)
            rows.append({"reading": reading, "unit": unit, "turn": degrees, "noise": noise})
    return pd.DataFrame(rows)
