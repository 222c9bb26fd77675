"""The closed form of (cost)–(const2), held against the problem as printed on some of the steps."""

from __future__ import annotations

import numpy as np

from pipeline.models.convex import solve_noise_covariance
from pipeline.models.gaussian.law import noise_scale


def noise_covariance_gap(norms: np.ndarray, alpha: float, u: float, n: int, m: int) -> float:
    """Greatest relative distance of Σ_k of (cost)–(const2), closed form against solver, at
    ``norms`` (K,) ‖J̲_k⁺‖_F of matrices (n, m). Raises SolverError.
    """
    gaps = []
    for norm, scale in zip(norms, noise_scale(norms, alpha, u, n, m), strict=True):
        solved = solve_noise_covariance(float(norm), alpha, u, n, m)
        gaps.append(np.linalg.norm(solved - scale * np.eye(m)) / np.linalg.norm(scale * np.eye(m)))
    return float(max(gaps))
