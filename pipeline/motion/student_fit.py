"""Maximum-likelihood fit of the Student noise by expectation and conditional maximisation (Liu and Rubin 1995, ECME)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from pipeline.errors import ModelDomainError, SolverError
from pipeline.motion.residuals import additive_log_likelihood, pooled_covariance, residuals
from pipeline.motion.student import student_log_density

DEGREES = (0.5, 1e4)  # interval of ν: from tails heavier than Cauchy's to a Gaussian to four digits
TOLERANCE = 1e-10  # change of the mean log likelihood in nats at which the iteration has converged
ITERATIONS = 500
# variance, as a share of the additive model's, below which the scale has run off to zero
VANISHING = 1e-12


@dataclass(frozen=True)
class StudentFit:
    """Maximum of the likelihood; log likelihoods are means per step in nats, of densities in rad⁻³."""

    nu: float
    scale: np.ndarray  # (3, 3) Λ, rad²
    at_end: bool  # ν at an end of its interval: as good as Gaussian above, below drawn down by noise that is exactly zero
    log_likelihood: float
    additive_log_likelihood: float  # of the additive model fitted to the same residuals


def fit_student(noise: np.ndarray) -> StudentFit:
    """ν and Λ of greatest likelihood for ``noise`` ω (takes, M, 3) in rad about its mean at each step (see
    :func:`pipeline.motion.residuals.residuals`).

    In turn: the expected precision of each residual r, w = (ν+n)/(ν+rᵀΛ⁻¹r); Λ = mean(w·rrᵀ)/mean(w), whose denominator is one at the
    optimum and hastens the way there (Kent, Tyler and Vardi 1994); ν by a search in ln ν of the likelihood itself.
    Raises ModelDomainError where the likelihood has no bound (too many residuals that are exactly zero), SolverError where the
    iteration does not converge.
    """
    residual = residuals(noise).reshape(-1, 3)
    pooled = pooled_covariance(residual)
    units = np.sqrt(np.diag(pooled))
    r, n = residual / units, 3
    interval = np.log(DEGREES)
    scale, log_nu, previous = pooled / np.outer(units, units), np.log(10.0), -np.inf
    for _ in range(ITERATIONS):
        nu = np.exp(log_nu)
        weights = (nu + n) / (nu + np.vecdot(r, np.linalg.solve(scale, r.T).T))
        scale = (weights[:, None] * r).T @ r / weights.sum()
        if np.linalg.eigvalsh(scale)[0] < VANISHING:
            raise ModelDomainError("too much of the noise is exactly zero: the likelihood of a Student law has no bound")
        found = minimize_scalar(_loss, args=(r, scale), bounds=interval, method="bounded", options={"xatol": 1e-8})
        log_nu, value = found.x, -found.fun
        if abs(value - previous) < TOLERANCE:
            break
        previous = value
    else:
        raise SolverError(f"the likelihood of the Student noise was not maximised in {ITERATIONS} iterations", nu=float(np.exp(log_nu)))
    at_end = bool(np.min(np.abs(interval - log_nu)) < 1e-3)
    log_likelihood = value - np.log(units).sum()
    scale = scale * np.outer(units, units)
    return StudentFit(float(np.exp(log_nu)), scale, at_end, float(log_likelihood), additive_log_likelihood(residual))


def _loss(log_nu: float, r: np.ndarray, scale: np.ndarray) -> float:
    return -float(np.mean(student_log_density(r, np.exp(log_nu), scale)))
