"""The paper's two convex problems as printed, in CVXPY: an independent route to what the motion
models have in closed form.
"""

from __future__ import annotations

import warnings

import cvxpy as cp
import numpy as np
from oracles import first_factor

TOLERANCE = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), 1e-8)  # in its own unit


def _solve(problem: cp.Problem) -> float:
    """The optimal value; a status that is not optimal never yields one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the status names an inaccuracy
        value = problem.solve(solver=cp.CLARABEL, **TOLERANCE)
    assert problem.status == cp.OPTIMAL, problem.status
    return float(value)


def solve_perturbation(noise, v, j1, j2, weights, floor) -> tuple[np.ndarray, float]:
    """B⁻¹ (m, m) and the objective of (BsampOpt) under (const10) as B⁻¹ ⪰ εI, ε the ``floor``.

    ``noise`` ω (n,) in rad, measured minus nominal; ``v`` (m,) ẋᵈΔt; J = J₁J₂ of ``j1`` (m, m) and
    ``j2`` (m, n); ``weights`` (α₁, α₂). In units of ‖ω‖, as the solver's tolerances are absolute.
    """
    m, unit = len(v), np.linalg.norm(noise)
    b_inv = cp.Variable((m, m), symmetric=True)
    a, step, back = np.linalg.inv(j1) @ v, np.linalg.pinv(j1 @ j2) @ v, np.linalg.pinv(j2)
    rest = (noise + step) / unit - (back / unit) @ (b_inv @ a)
    objective = weights[0] * cp.norm(rest) + weights[1] / unit * cp.norm(b_inv - np.eye(m), "fro")
    value = _solve(cp.Problem(cp.Minimize(objective), [b_inv >> floor * np.eye(m)]))
    return b_inv.value, unit * value


def perturbation_gap(objectives, jacobians, v, noise, decomposition, weights, floor) -> float:
    """Greatest relative distance of the ``objectives`` (K,) of (BsampOpt) in closed form from the
    solver's; of matrices it would say little, as the optimum is flat.
    """
    gaps = []
    for closed, jacobian, step, omega in zip(objectives, jacobians, v, noise, strict=True):
        j1 = first_factor(jacobian, decomposition)
        j2 = np.linalg.solve(j1, jacobian)
        _, objective = solve_perturbation(omega, step, j1, j2, weights, floor)
        gaps.append(abs(closed - objective) / objective)
    return float(max(gaps))


def solve_noise_covariance(norm: float, alpha: float, u: float, n: int, m: int) -> np.ndarray:
    """(m, m) Σ_k of (cost)–(const2) for a matrix J (n, m) of ``norm`` ‖J‖_F < u: maximise ln|Σ|
    subject to tr{nΣ} ≤ α²(u² − ‖J‖_F²), Σ ≥ 0, in units of that bound.
    """
    sigma = cp.Variable((m, m), symmetric=True)
    constraints = [cp.trace(n * sigma) <= 1, sigma >> 0]
    _solve(cp.Problem(cp.Maximize(cp.log_det(sigma)), constraints))
    return alpha**2 * (u**2 - norm**2) * sigma.value
