"""The closed form of (BsampOpt), held against the problem as printed on some of the steps."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lu, qr

from pipeline.arm.chain import PlanarChain
from pipeline.models.convex import solve_perturbation
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.perturbation import Perturbations


def perturbation_gap(
    fits: Perturbations,
    chain: PlanarChain,
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

    ``q``, ``v``, ``noise`` (N, 3): pose in rad, commanded step (m, m, rad) and process noise in rad
    of each problem of ``fits``. J₁ and J₂ come from SciPy here, not from the closed form, unless J₁
    is given. Objectives are compared and not matrices, as the optimum is flat. Raises SolverError.
    """
    gaps = []
    for i in chosen:
        jacobian = chain.jacobian(q[i])
        if isinstance(decomposition, np.ndarray):
            j1, j2 = decomposition, np.linalg.solve(decomposition, jacobian)
        else:
            j1, j2 = lu(jacobian, permute_l=True) if decomposition == "lu" else qr(jacobian)
        _, objective = solve_perturbation(noise[i], v[i], j1, j2, weights, floor)
        gaps.append(abs(fits.objective[i] - objective) / objective)
    return max(gaps)
