"""The closed form of (BsampOpt), held against the problem as printed on some of the steps."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lu, qr

from pipeline.arm.interface import Chain
from pipeline.models.convex import solve_perturbation
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.perturbation import Perturbations


def perturbation_gap(
    fits: Perturbations,
    chain: Chain,
    q: np.ndarray,
    v: np.ndarray,
    noise: np.ndarray,
    decomposition: Decomposition,
    weights: tuple[float, float],
    floor: float,
    chosen: np.ndarray,
) -> float:
    """Greatest relative distance of the objectives of (BsampOpt), closed form against solver, over
    the problems ``chosen``.

    ``q`` (N, n), ``v`` (N, m) or longer and ``noise`` (N, n): pose in rad, command and process
    noise in rad of each problem of ``fits``. J₁ comes from SciPy here, not from the closed form,
    unless it is given. Objectives are compared and not matrices, as the optimum is flat. Raises
    SolverError.
    """
    gaps = []
    for i in chosen:
        jacobian = chain.jacobian(q[i])
        j1 = _first_factor(jacobian, decomposition)
        j2 = np.linalg.solve(j1, jacobian)
        _, objective = solve_perturbation(noise[i], v[i, : len(j1)], j1, j2, weights, floor)
        gaps.append(abs(fits.objective[i] - objective) / objective)
    return max(gaps)


def _first_factor(jacobian: np.ndarray, decomposition: Decomposition) -> np.ndarray:
    """J₁ (m, m) of ``jacobian`` (m, n) by SciPy."""
    match decomposition:
        case Decomposition("pivoted_lu"):
            return lu(jacobian, permute_l=True)[0]
        case Decomposition("qr"):
            return qr(jacobian)[0]
        case Decomposition("qr_transposed"):
            return qr(jacobian.T, mode="economic")[1].T
        case Decomposition(left=left):
            return np.array(left)
