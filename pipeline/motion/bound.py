"""The perturbation of one step held back by positive definiteness: (BsampOpt) under B⁻¹ ⪰ εI as a small second-order cone program.

With the notation of :mod:`pipeline.motion.perturbation` write S in a frame whose first axis is e: s∥/r = x, s⊥/r = b and a block C
across e. B⁻¹ ⪰ εI means C ⪰ bbᵀ/(δ + x) − δI with δ = 1 − ε (Schur), and the C of least norm that does is c·bbᵀ/‖b‖² with
c = max(0, ‖b‖²/(δ + x) − δ). So the bound is one rotated cone, ‖b‖² ≤ (δ + x)(δ + c), and no semidefinite solver is needed:

    minimise t₁ + λt₂   s.t.   ‖ω − Ay‖ ≤ t₁,   ‖(y, c)‖ ≤ t₂,   ‖(2b, x − c)‖ ≤ 2δ + x + c,   x = eᵀy, b = (I − eeᵀ)y/√2.
"""

from __future__ import annotations

import clarabel
import numpy as np
from scipy.sparse import csc_matrix

from pipeline.errors import SolverError

TOLERANCE = 1e-8


def _settings() -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    settings.direct_solve_method = "qdldl"
    return settings


def solve_bounded(noise: np.ndarray, e: np.ndarray, matrix: np.ndarray, ratio: float, floor: float) -> np.ndarray:
    """(n, n) the optimal S for ``noise`` ω (n,), the direction ``e`` (n,), ``matrix`` A (n, n), λ = ``ratio`` and ε = ``floor``.

    Raises SolverError with the solver's status where that is not an optimum.
    """
    n, delta = len(e), 1 - floor
    size = np.linalg.norm(noise)  # the solver's tolerances are absolute
    across = np.sqrt(2) * (np.eye(n) - np.outer(e, e))
    # slack = right − rows @ (y, c, t1, t2) lies in the product of the cones (leading entry ≥ norm of the rest)
    rows, right = np.zeros((3 * n + 5, n + 3)), np.zeros(3 * n + 5)
    y, c, t1, t2 = slice(0, n), n, n + 1, n + 2
    rows[0, t1] = -1
    rows[1 : n + 1, y], right[1 : n + 1] = matrix / size, noise / size
    rows[n + 1, t2] = -1
    rows[n + 2 : 2 * n + 2, y], rows[2 * n + 2, c] = -np.eye(n), -1
    rows[2 * n + 3, y], rows[2 * n + 3, c], right[2 * n + 3] = -e, -1, 2 * delta
    rows[2 * n + 4 : 3 * n + 4, y] = -across
    rows[3 * n + 4, y], rows[3 * n + 4, c] = -e, 1
    cost = np.zeros(n + 3)
    cost[t1], cost[t2] = 1, ratio / size
    cones = [clarabel.SecondOrderConeT(m) for m in (n + 1, n + 2, n + 2)]
    quadratic = csc_matrix((n + 3, n + 3))
    solution = clarabel.DefaultSolver(quadratic, cost, csc_matrix(rows), right, cones, _settings()).solve()
    if solution.status != clarabel.SolverStatus.Solved:
        raise SolverError(
            "the perturbation under its bound was not solved to optimality",
            status=str(solution.status),
            noise=noise.tolist(),
            ratio=ratio,
            floor=floor,
        )
    y_best, c_best = np.array(solution.x[:n]), solution.x[n]
    x, b = e @ y_best, across @ y_best / 2
    length = b @ b
    block = c_best / length * np.outer(b, b) if length > 0 else 0.0
    return x * np.outer(e, e) + np.outer(e, b) + np.outer(b, e) + block
