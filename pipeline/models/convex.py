"""Solutions with CVXPY of the paper's two convex problems as printed, and their relative
differences from the closed forms of the motion models.
"""

import warnings

import cvxpy as cp
import numpy as np
from numpy import ndarray
from scipy.linalg import lu, qr

from pipeline.core.errors import SolverError
from pipeline.models.gaussian.law import noise_scale
from pipeline.models.wishart.decomposition import Decomposition

# of duality gap and feasibility, in the problem's unit
TOLERANCES = (1e-10, 1e-9, 1e-8)
Weights = tuple[float, float]  # (α₁, α₂)


def _solve(problem: cp.Problem, **evidence: object) -> float:
    """Return the optimal value at the smallest of TOLERANCES reached, or raise SolverError."""
    for tolerance in TOLERANCES:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # status reports it
                value = problem.solve(
                    solver=cp.CLARABEL,
                    tol_gap_abs=tolerance,
                    tol_gap_rel=tolerance,
                    tol_feas=tolerance,
                )
        except (cp.SolverError, ValueError) as error:  # ValueError: not finite
            message = f"the problem could not be solved: {error}"
            raise SolverError(message, **evidence) from None
        if problem.status == cp.OPTIMAL:
            return float(value)
    message = "the problem was not solved to optimality"
    raise SolverError(message, status=problem.status, **evidence)


def solve_perturbation(
    noise: ndarray,
    v: ndarray,
    j1: ndarray,
    j2: ndarray,
    weights: Weights,
    floor: float,
) -> tuple[ndarray, float]:
    """Return B⁻¹ (m, m) and the objective F of (BsampOpt), with (const10) as B⁻¹ ⪰ εI.

    ``noise`` ω (n,) in rad, measured minus nominal; ``v`` (m,) ẋᵈΔt; J = J₁J₂ of ``j1`` (m, m) and
    ``j2`` (m, n); ``weights`` (α₁, α₂); ``floor`` ε. The unit of the problem is ‖ω‖, because the
    solver's tolerances are absolute. Raises SolverError.
    """
    m = len(v)
    size = float(np.linalg.norm(noise))
    unit = size if 0 < size < np.inf else 1.0
    b_inv = cp.Variable((m, m), symmetric=True)
    a = np.linalg.inv(j1) @ v
    step = np.linalg.pinv(j1 @ j2) @ v
    back = np.linalg.pinv(j2)
    rest = (noise + step) / unit - (back / unit) @ (b_inv @ a)
    perturbation = cp.norm(b_inv - np.eye(m), "fro")
    objective = weights[0] * cp.norm(rest) + weights[1] / unit * perturbation
    problem = cp.Problem(cp.Minimize(objective), [b_inv >> floor * np.eye(m)])
    value = _solve(problem, noise=noise.tolist(), floor=floor)
    return b_inv.value, unit * value


def solve_noise_covariance(
    norm: float,
    alpha: float,
    u: float,
    n: int,
    m: int,
) -> ndarray:
    """(m, m) Σ_k of (cost)–(const2) for a matrix J (n, m) of ``norm`` ‖J‖_F: maximise ln|Σ| subject
    to tr{nΣ} ≤ α²(u² − ‖J‖_F²), Σ ≥ 0, with scale ``alpha`` α and bound ``u``. The unit of the
    problem is the bound, because the solver's tolerances are absolute. Raises SolverError.
    """
    bound = alpha**2 * (u**2 - norm**2)
    evidence = {"norm": norm, "alpha": alpha, "u": u}
    if not bound > 0:
        message = "the problem has no feasible point: u must be above the norm"
        raise SolverError(message, **evidence)
    sigma = cp.Variable((m, m), symmetric=True)
    constraints = [cp.trace(n * sigma) <= 1, sigma >> 0]
    _solve(cp.Problem(cp.Maximize(cp.log_det(sigma)), constraints), **evidence)
    return bound * sigma.value


def perturbation_gap(
    problems: tuple[ndarray, ...],
    decomposition: Decomposition,
    weights: Weights,
    floor: float,
) -> float:
    """Greatest relative difference between the closed-form objectives of (BsampOpt) and the
    solver's objectives. The matrices B⁻¹ are not compared, because the optimum is flat.

    ``problems`` are the objectives (K,), Jacobians (K, m, n), task steps (K, m) and noise ω (K, n)
    in rad. J₁ is computed by SciPy, independently of the closed form. Raises SolverError.
    """
    first_factor = {
        "pivoted_lu": lambda jacobian: lu(jacobian, permute_l=True)[0],
        "qr": lambda jacobian: qr(jacobian)[0],
        "qr_transposed": lambda jacobian: qr(jacobian.T, mode="economic")[1].T,
    }[decomposition.name]
    gaps = []
    for closed, jacobian, step, omega in zip(*problems, strict=True):
        j1 = first_factor(jacobian)
        j2 = np.linalg.solve(j1, jacobian)
        _, objective = solve_perturbation(omega, step, j1, j2, weights, floor)
        gaps.append(abs(closed - objective) / objective)
    return float(max(gaps))


def noise_covariance_gap(
    norms: ndarray,
    alpha: float,
    u: float,
    n: int,
    m: int,
) -> float:
    """Greatest relative difference between the closed-form Σ_k of (cost)–(const2) and the solver's
    Σ_k, at ``norms`` (K,) ‖J̲_k⁺‖_F of matrices (n, m). Raises SolverError.
    """
    gaps = []
    for norm, scale in zip(norms, noise_scale(norms, alpha, u, n, m), strict=True):
        closed = scale * np.eye(m)
        solved = solve_noise_covariance(float(norm), alpha, u, n, m)
        gaps.append(np.linalg.norm(solved - closed) / np.linalg.norm(closed))
    return float(max(gaps))
