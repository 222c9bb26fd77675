"""Maximum likelihood of σ_B of the Wishart model.

What is maximised is Σ ln p(q̃_{k+1} | q̃_k) over the recorded steps, where p is the exact density
of a step plus the measurement noise N(0, Σ_m). Without Σ_m the steps at rest would have no density,
and the slowest of the others would decide everything.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.errors import ModelDomainError
from pipeline.models.steps import moving_steps
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.randommatrix.wishart import largest_dispersion

LEAST_SIGMA_B = 0.01  # d = 40 000: a step that differs from the nominal one by 1 %
GREATEST_SIGMA_B = 2.0  # beyond all that have a density, but for a single task row
TOLERANCE = 1e-4  # of ln σ_B, below the widest that has a density
# of ln σ_B: how near the greatest likelihood is sought before it is read off a spline
COARSE = 0.05
# of that spline over ln σ_B, on either side, and its nodes: they leave an error below 1e-4
REACH, NODES = 0.4, 9


@dataclass(frozen=True)
class DispersionFit:
    """σ̂_B of greatest likelihood, and the likelihood of each take about it."""

    sigma_b: float
    at_end: bool  # whether it is at an end of the interval where B has a density
    log_sigma_b: np.ndarray  # (NODES,) ascending
    log_likelihoods: np.ndarray  # (takes, NODES) Σ ln p over the steps of each take

    def from_takes(self, takes: np.ndarray) -> dict[str, float]:
        """σ̂_B of the takes with these numbers, as often as each is named; raises ModelDomainError
        where it is beyond the nodes.
        """
        best = _greatest(self.log_sigma_b, self.log_likelihoods[takes].sum(axis=0))
        if not self.at_end and best in (self.log_sigma_b[0], self.log_sigma_b[-1]):
            raise ModelDomainError(
                "the likelihood of these takes is greatest beyond where it was evaluated",
                takes=takes.tolist(),
            )
        return {"sigma_b": float(np.exp(best))}


def _greatest(x: np.ndarray, values: np.ndarray) -> float:
    """Where the spline through ``values`` (N,) at ``x`` (N,) is greatest."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(x, values)
    candidates = np.concatenate([x[[0, -1]], spline.derivative().roots(extrapolate=False)])
    return float(candidates[spline(candidates).argmax()])


def fit_sigma_b(
    chain: Chain,
    q: np.ndarray,
    v: np.ndarray,
    noise: np.ndarray,
    measurement: np.ndarray,
    decomposition: Decomposition,
) -> DispersionFit:
    """σ̂_B by a search over ln σ_B between LEAST_SIGMA_B and the widest σ_B that has a density.

    Raises SingularJacobianError and ModelDomainError.

    Args:
        chain: of n joints.
        q: (takes, M, n) measured poses in rad before each step.
        v: (M, m) or longer, commands.
        noise: (takes, M, n) ω of each step in rad.
        measurement: (n, n) Σ_m in rad².
        decomposition: of the Jacobian.
    """
    from scipy.optimize import minimize_scalar

    takes = len(q)
    q, v, noise = moving_steps(q, v, noise)
    q_next = q + chain.nominal_step(q, v) + noise

    def by_take(log_sigma_b: float) -> np.ndarray:
        density = WishartModel(np.exp(log_sigma_b), decomposition).log_density(
            chain, q, v, q_next, measurement
        )
        return density.reshape(takes, -1).sum(axis=1)

    widest = min(largest_dispersion(len(chain.task)), GREATEST_SIGMA_B)
    low, high = np.log(LEAST_SIGMA_B), np.log(widest) - TOLERANCE
    coarse = minimize_scalar(
        lambda x: -by_take(x).sum(),
        bounds=(low, high),
        method="bounded",
        options={"xatol": COARSE},
    )
    nodes = np.linspace(max(low, coarse.x - REACH), min(high, coarse.x + REACH), NODES)
    log_likelihoods = np.stack([by_take(x) for x in nodes], axis=1)
    best = _greatest(nodes, log_likelihoods.sum(axis=0))
    return DispersionFit(float(np.exp(best)), best in (low, high), nodes, log_likelihoods)
