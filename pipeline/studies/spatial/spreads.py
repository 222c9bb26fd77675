"""The spread of every reading of the models on one motion of one arm, from their exact covariances
(Eqs. LUDecom, RMTInvDiff).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import pandas as pd

from pipeline.arm.interface import Chain
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.wishart.decomposition import COMPUTED, LU, Decomposition
from pipeline.models.wishart.factors import split
from pipeline.models.wishart.law import step_covariance

UNITS_FREE, GAUSSIAN = "qr_transposed", "gaussian"
READINGS = (*COMPUTED, GAUSSIAN)


@dataclass(frozen=True)
class Motion:
    """Steps ``step`` (K, n) of the joints from the poses ``q`` (K, n), in rad (m of prismatic
    joints), of an arm whose task has a characteristic length.
    """

    chain: Chain
    q: np.ndarray
    step: np.ndarray

    @property
    def v(self) -> np.ndarray:
        """(K, m) step of the task, m."""
        return np.matvec(self.chain.jacobian(self.q), self.step)

    @property
    def nominal(self) -> np.ndarray:
        """(K,) ‖J⁺v‖, which no length changes; raises SingularJacobianError."""
        return np.linalg.norm(np.matvec(self.chain.inverse_jacobian(self.q), self.v), axis=-1)


def straight(chain: Chain, start: Sequence[float], end: Sequence[float], places: int) -> Motion:
    """The way from ``start`` to ``end`` (n,) in rad at constant speed, in as many equal steps as
    poses ``places`` along it.
    """
    way = np.subtract(end, start)
    q = start + way * np.linspace(0, 1, places)[:, None]
    return Motion(chain, q, np.broadcast_to(way / places, q.shape))


@dataclass(frozen=True)
class Parameters:
    """Of the models: ``sigma_b`` σ_B of every Wishart one; ``level`` α of the Gaussian one, and
    ``bound``, its u over the greatest norm of J⁺ on the motion.
    """

    sigma_b: float
    level: float
    bound: float

    def calibrated(self, motion: Motion) -> Parameters:
        """With the level that gives the Gaussian model on ``motion`` the spread that the Wishart
        model has under QR of Jᵀ.
        """
        wanted, own = (
            spread(covariance(motion, reading, self), motion.nominal)
            for reading in (UNITS_FREE, GAUSSIAN)
        )
        return replace(self, level=self.level * wanted / own)


def covariance(motion: Motion, reading: str | Decomposition, parameters: Parameters) -> np.ndarray:
    """(K, n, n) of the steps under a reading or an order of LU; NaN where a pivot is small."""
    if reading == GAUSSIAN:
        norms = np.linalg.norm(motion.chain.inverse_jacobian(motion.q), axis=(-2, -1))
        model = GaussianModel(parameters.level, parameters.bound * norms.max())
        return model.covariance(motion.chain, motion.q, motion.v)
    decomposition = Decomposition(reading) if isinstance(reading, str) else reading
    factors = split(motion.chain.jacobian(motion.q), motion.v, decomposition)
    return step_covariance(factors.a, factors.back, parameters.sigma_b)


def joint_spreads(covariance: np.ndarray, nominal: np.ndarray) -> np.ndarray:
    """(n,) spread of each joint, see the study's tables; ``nominal`` (K,) ‖J⁺v‖."""
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    return np.sqrt(variances.mean(axis=0) / np.mean(nominal**2))


def spread(covariance: np.ndarray, nominal: np.ndarray) -> float:
    """Spread of all joints together."""
    return float(np.linalg.norm(joint_spreads(covariance, nominal)))


def course(covariance: np.ndarray, nominal: np.ndarray) -> float:
    """Greatest over least share of the step that is noise, along the motion: 1 for a law that knows
    nothing of the pose beside the step.
    """
    shares = np.sqrt(np.trace(covariance, axis1=-2, axis2=-1)) / nominal
    return float(shares.max() / shares.min())


def orders(rows: int) -> list[Decomposition]:
    """LU without pivoting in every order of so many ``rows`` of the task."""
    return [Decomposition(LU.name, rows=order) for order in permutations(range(rows))]


def spread_rows(
    motion: Motion, usable: Sequence[Decomposition], parameters: Parameters
) -> pd.DataFrame:
    """A row a reading of the table ``spatial``, without arm and length; ``usable`` are the
    :func:`orders` that meet no small pivot.
    """
    nominal, count = motion.nominal, len(orders(len(motion.chain.task)))
    rows = []
    for reading in READINGS:
        here = covariance(motion, reading, parameters)
        ends = [spread(here, nominal)]  # of the other readings the order changes nothing
        if reading == LU.name:
            ends = [spread(covariance(motion, lu, parameters), nominal) for lu in usable]
        small = count - len(usable) if reading == LU.name else 0
        least, greatest = min(ends, default=np.nan), max(ends, default=np.nan)
        together = spread(here, nominal), course(here, nominal)
        rows.append((reading, *together, count, small, least, greatest))
    names = ["reading", "spread", "course", "orders", "small_pivot", "least", "greatest"]
    return pd.DataFrame(rows, columns=names)


def joint_rows(motion: Motion, joints: Sequence[str], parameters: Parameters) -> pd.DataFrame:
    """The table ``spatial_joints`` without arm: a row for each reading and joint."""
    tables = [
        pd.DataFrame(
            {
                "reading": reading,
                "joint": list(joints),
                "spread": joint_spreads(covariance(motion, reading, parameters), motion.nominal),
            }
        )
        for reading in READINGS
    ]
    return pd.concat(tables, ignore_index=True)
