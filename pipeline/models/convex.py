"""The paper's two convex problems as printed, in CVXPY: the independent route to what the motion
models have in closed form.
"""

from __future__ import annotations

import warnings

import cvxpy as cp
import numpy as np

from pipeline.core.errors import SolverError

TOLERANCES = (1e-10, 1e-9, 1e-8)  # of gap and feasibility, in the problem's own unit


def _solve(problem: cp.Problem, **evidence: object) -> float:
    """The optimal value to the least of TOLERANCES that the solver reaches; raises SolverError for
    any status but optimal.
    """
    for tolerance in TOLERANCES:
        tolerances = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), tolerance)
        try:
            with warnings.catch_warnings():
                # of an inaccurate solution the status says so
                warnings.simplefilter("ignore", UserWarning)
                value = problem.solve(solver=cp.CLARABEL, **tolerances)
        # a ValueError is CVXPY's answer to data that are not numbers
        except (cp.SolverError, ValueError) as error:
            raise SolverError(f"the problem could not be solved: {error}", **evidence) from None
        if problem.status == cp.OPTIMAL:
            return float(value)
    raise SolverError("the problem was not solved to optimality", status=problem.status, **evidence)


def solve_perturbation(
    noise: np.ndarray,
    v: np.ndarray,
    j1: np.ndarray,
    j2: np.ndarray,
    weights: tuple[float, float],
    floor: float,
) -> tuple[np.ndarray, float]:
    """B⁻¹ (m, m) and the objective F of (BsampOpt) under (const10) as B⁻¹ ⪰ εI.

    Solved in units of ‖ω‖, as the solver's tolerances are absolute. Raises SolverError.

    Args:
        noise: (n,) ω in rad, measured minus nominal.
        v: (m,) ẋᵈΔt.
        j1: (m, m) first factor of the Jacobian.
        j2: (m, n) the second.
        weights: (α₁, α₂).
        floor: ε.
    """
    m, size = len(v), float(np.linalg.norm(noise))
    unit = size if 0 < size < np.inf else 1.0
    alpha1, alpha2 = weights
    b_inv = cp.Variable((m, m), symmetric=True)
    a, step, back = np.linalg.inv(j1) @ v, np.linalg.pinv(j1 @ j2) @ v, np.linalg.pinv(j2)
    rest = (noise + step) / unit - (back / unit) @ (b_inv @ a)
    objective = alpha1 * cp.norm(rest) + alpha2 / unit * cp.norm(b_inv - np.eye(m), "fro")
    value = _solve(
        cp.Problem(cp.Minimize(objective), [b_inv >> floor * np.eye(m)]),
        noise=noise.tolist(),
        floor=floor,
    )
    return b_inv.value, unit * value


def solve_noise_covariance(norm: float, alpha: float, u: float, n: int, m: int) -> np.ndarray:
    """(m, m) Σ_k of (cost)–(const2) for a matrix J (n, m) of ``norm`` ‖J‖_F: maximise ln|Σ| subject
    to tr{nΣ} ≤ α²(u² − ‖J‖_F²), Σ ≥ 0, with levels ``alpha`` α and ``u``. Raises SolverError.

    Σ is solved for in units of the bound, as the solver's tolerances are absolute: that adds a
    constant to ln|Σ|.
    """
    bound = alpha**2 * (u**2 - norm**2)
    if not bound > 0:
        raise SolverError(
            "the problem has no feasible point with a logarithm: u is not above the norm",
            norm=norm,
            alpha=alpha,
            u=u,
        )
    sigma = cp.Variable((m, m), symmetric=True)
    _solve(
        cp.Problem(cp.Maximize(cp.log_det(sigma)), [cp.trace(n * sigma) <= 1, sigma >> 0]),
        norm=norm,
        alpha=alpha,
        u=u,
    )
    return bound * sigma.value
