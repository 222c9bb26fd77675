"""Maximum-likelihood fit of the noise that grows with the joint speed (:mod:`pipeline.motion.scaled`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.optimize import minimize

from pipeline.errors import ModelDomainError, SolverError
from pipeline.motion.residuals import additive_log_likelihood, pooled_covariance, residuals

Structure = Literal["diagonal", "full", "timing"]
# greatest slope of the mean log likelihood, in the search's own units of one, at which it is at its maximum
FLAT = 1e-5


@dataclass(frozen=True)
class ScaledFit:
    """Maximum of the likelihood; log likelihoods are means per step in nats, of densities in rad⁻³."""

    floor: np.ndarray  # (3, 3) A, rad²
    gain: np.ndarray  # (3, 3) B, 1
    log_likelihood: float
    additive_log_likelihood: float  # of the additive model fitted to the same residuals


def fit_scaled(noise: np.ndarray, dq: np.ndarray, structure: Structure) -> ScaledFit:
    """A and B of greatest likelihood for ``noise`` ω (takes, M, 3) in rad about its mean at each step (see
    :func:`pipeline.motion.residuals.residuals`), the nominal steps of the joints being ``dq`` q̇ (takes, M, 3) in rad.

    ``structure``: ``diagonal`` A and B diagonal, ``full`` neither, ``timing`` A full and B = σ_ε²·11ᵀ. A = LLᵀ and B = KKᵀ, so that
    both stay positive semidefinite, and the quasi-Newton search in the entries of L and K has the exact gradient: with
    G = ½(Σ⁻¹ − Σ⁻¹rrᵀΣ⁻¹) at a step, ∂/∂L = 2·mean(G)·L and ∂/∂K = 2·mean(D(q̇)GD(q̇))·K.

    Raises ModelDomainError where the likelihood has no bound (noise at rest that is zero or lies in a plane) or where a joint never
    moves, SolverError where the search does not end at an optimum.
    """
    if structure not in get_args(Structure):
        raise ModelDomainError(f"the structure must be one of {get_args(Structure)}", structure=structure)
    residual = residuals(noise).reshape(-1, 3)
    # each joint in units of its own noise and its own speed, as a search needs it
    scale, speed = np.sqrt(np.diag(pooled_covariance(residual))), np.sqrt(np.mean(dq.reshape(-1, 3) ** 2, axis=0))
    if not np.all(speed > 0):
        raise ModelDomainError("noise that grows with speed cannot be told where a joint never moves", rms_step=speed.tolist())
    r, x = residual / scale, dq.reshape(-1, 3) / speed
    rest = ~np.any(x, axis=-1)
    if np.any(rest):
        _ = pooled_covariance(residual[rest])  # refuses noise to which a singular floor would give a density without bound
    floor_basis, gain_basis = _bases(structure, speed / scale)
    squares = x[:, :, None] * x[:, None, :]

    def factors(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        split = len(floor_basis)
        return np.tensordot(theta[:split], floor_basis, 1), np.tensordot(theta[split:], gain_basis, 1)

    def loss(theta: np.ndarray) -> tuple[float, np.ndarray]:
        of_floor, of_gain = factors(theta)
        covariance = of_floor @ of_floor.T + (of_gain @ of_gain.T) * squares
        sign, log_determinant = np.linalg.slogdet(covariance)
        if np.any(sign <= 0) or not np.all(np.isfinite(log_determinant)):
            return np.inf, np.zeros_like(theta)
        precision = np.linalg.inv(covariance)
        white = np.matvec(precision, r)
        slope = (precision - white[:, :, None] * white[:, None, :]) / len(r)
        gradients = (floor_basis, slope.sum(axis=0) @ of_floor), (gain_basis, np.sum(slope * squares, axis=0) @ of_gain)
        value = 0.5 * np.mean(log_determinant + np.vecdot(r, white))
        return value, np.concatenate([np.tensordot(basis, gradient, 2) for basis, gradient in gradients])

    # half of the additive model's variances at rest, half at the joints' usual speeds
    start = np.concatenate([_start(floor_basis), _start(gain_basis)])
    found = minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 2000, "maxfun": 4000, "ftol": 1e-14, "gtol": 1e-7})
    of_floor, of_gain = factors(found.x)
    floor, gain = of_floor @ of_floor.T, of_gain @ of_gain.T
    # the slope, not what the search says of itself: its line search may stop where it can no longer tell values apart
    slope = float(np.abs(found.jac).max())
    if not slope < FLAT:
        raise SolverError(f"the likelihood of the {structure} form was not maximised: {found.message}", slope=slope)
    outer = np.outer(scale, scale)
    log_likelihood = -found.fun - 1.5 * np.log(2 * np.pi) - np.log(scale).sum()
    return ScaledFit(floor * outer, gain * outer / np.outer(speed, speed), float(log_likelihood), additive_log_likelihood(residual))


def _bases(structure: Structure, ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (p, 3, 3) whose combinations the factors L and K are; ``ratio`` (3,) one unit of ε in units of each joint's noise."""
    rows, columns = {"diagonal": np.diag_indices(3), "full": np.tril_indices(3), "timing": np.tril_indices(3)}[structure]
    entries = np.zeros((len(rows), 3, 3))
    entries[np.arange(len(rows)), rows, columns] = 1.0
    if structure != "timing":
        return entries, entries
    common = np.zeros((1, 3, 3))
    common[0, :, 0] = ratio / np.linalg.norm(ratio)
    return entries, common


def _start(basis: np.ndarray) -> np.ndarray:
    """Coordinates of the combination of ``basis`` (p, 3, 3) nearest to the root of ½·I, or where it has no diagonal, of its size."""
    return np.sqrt(0.5) * (basis[:, range(3), range(3)].sum(axis=-1) if len(basis) > 1 else np.ones(1))
