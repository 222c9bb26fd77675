"""The closed forms that do the bulk, held against the paper's convex problems as printed, on some of them."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lu, qr

from pipeline.arm.chain import PlanarChain
from pipeline.motion.convex import solve_noise_covariance, solve_perturbation
from pipeline.motion.decomposition import Decomposition
from pipeline.motion.gaussian import noise_scale
from pipeline.motion.perturbation import Perturbations


def perturbation_gap(
    fits: Perturbations, chain: PlanarChain, q: np.ndarray, v: np.ndarray, noise: np.ndarray,
    decomposition: Decomposition, weights: tuple[float, float], floor: float, chosen: np.ndarray,
) -> float:  # fmt: skip
    """Greatest relative distance of the objectives of (BsampOpt), closed form against solver, over the problems ``chosen``.

    ``q``, ``v``, ``noise`` (N, 3): pose in rad, commanded step (m, m, rad) and process noise in rad of each problem of ``fits``. J₁ and J₂
    come from SciPy here, not from the closed form, unless J₁ is given. Objectives are compared and not matrices, as the optimum is flat.
    Raises SolverError.
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


def noise_covariance_gap(norms: np.ndarray, alpha: float, u: float) -> float:
    """Greatest relative distance of Σ_k of (cost)–(const2), closed form against solver, at ``norms`` (K,) ‖J̲_k⁻¹‖_F. Raises SolverError."""
    gaps = []
    for norm, scale in zip(norms, noise_scale(norms, alpha, u, 3), strict=True):
        solved = solve_noise_covariance(float(norm), alpha, u, 3)
        gaps.append(np.linalg.norm(solved - scale * np.eye(3)) / np.linalg.norm(scale * np.eye(3)))
    return float(max(gaps))
