"""Additive noise of heavy tails: q_{k+1} = q_k + J(q_k)⁻¹ẋᵈ_kΔt + ω_{k+1}, ω ~ t_ν(0, Λ), the multivariate Student distribution.

It is Gaussian noise whose precision varies from step to step, ω | τ ~ N(0, Λ/τ) with τ ~ Γ(ν/2, rate ν/2); for ν → ∞ it is the
additive model with Σ_ω = Λ.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import betaln, gammainccinv, gammaincinv, gammaln

from pipeline.arm.chain import PlanarChain
from pipeline.errors import ModelDomainError
from pipeline.motion.covariance import root
from pipeline.motion.density import principal_axes
from pipeline.randommatrix.normal import cholesky

NODES = 400  # of the quadrature over ln τ
NEGLIGIBLE = 1e-16  # probability beyond either end of the quadrature


def student_log_density(residual: np.ndarray, nu: float, scale: np.ndarray) -> np.ndarray:
    """(...,) natural log of t_ν(``residual``; 0, Λ) in rad⁻ⁿ, ``residual`` (..., n) in rad, ``scale`` Λ (n, n) in rad²."""
    n = residual.shape[-1]
    lower = cholesky(scale, what="the scale matrix")
    white = np.linalg.solve(lower, residual[..., None])[..., 0]
    # ln Γ((ν+n)/2) − ln Γ(ν/2) by the beta function, which keeps its digits where ν is large
    constant = gammaln(n / 2) - betaln(nu / 2, n / 2) - n / 2 * np.log(nu * np.pi) - np.log(np.diag(lower)).sum()
    return constant - (nu + n) / 2 * np.log1p(np.vecdot(white, white) / nu)


def blurred_log_density(residual: np.ndarray, nu: float, scale: np.ndarray, measurement: np.ndarray) -> np.ndarray:
    """(...,) natural log of the density of t_ν(0, Λ) plus N(0, R) at ``residual`` (..., n), R = ``measurement`` (n, n) in rad².

    The integral of N(r; 0, Λ/τ + R) over the law of x = ln τ by the trapezoidal rule, whose error falls exponentially with the number
    of nodes, between quantiles that neither the prior nor the posterior of τ leaves. In the axes where Λ = I and R = diag(ρ) a node
    costs n divisions.
    """
    n = residual.shape[-1]
    _ = principal_axes(measurement)  # refuses what is not a covariance
    lower = cholesky(scale, what="the scale matrix")
    half = np.linalg.solve(lower, measurement)
    shares, axes = np.linalg.eigh(np.linalg.solve(lower, half.T))
    squares = (np.linalg.solve(lower, residual[..., None])[..., 0] @ axes) ** 2
    # τ given r: between its posterior without measurement noise, Γ((ν+n)/2, rate (ν+δ)/2), and its prior
    least = np.log(np.maximum(gammaincinv(nu / 2, NEGLIGIBLE), np.finfo(float).tiny)) - np.log((nu + squares.sum(axis=-1)) / 2)
    greatest = np.log(gammainccinv((nu + n) / 2, NEGLIGIBLE)) - np.log(nu / 2)
    total = np.full(squares.shape[:-1], -np.inf)
    for share in np.linspace(0.0, 1.0, NODES):
        x = least + share * (greatest - least)
        variances = np.exp(-x)[..., None] + np.maximum(shares, 0.0)
        # the density of x with its largest terms taken together: they cancel where ν is large
        prior = nu / 2 * (x - np.expm1(x))
        total = np.logaddexp(total, prior - 0.5 * np.sum(np.log(variances) + squares / variances, axis=-1))
    constant = nu / 2 * (np.log(nu / 2) - 1) - gammaln(nu / 2) - n / 2 * np.log(2 * np.pi) - np.log(np.diag(lower)).sum()
    return total + constant + np.log((greatest - least) / (NODES - 1))


@dataclass(frozen=True)
class StudentModel:
    """Student noise of ``nu`` ν > 0 degrees of freedom and positive definite scale matrix ``scale`` Λ (3, 3) in rad², the same at
    every pose and speed; raises ModelDomainError for other values."""

    nu: float
    scale: np.ndarray

    def __post_init__(self) -> None:
        if not 0 < self.nu < np.inf:
            raise ModelDomainError("the degrees of freedom must be positive and finite", nu=self.nu)
        _ = self._root
        cholesky(self.scale, what="the scale matrix")

    @cached_property
    def _root(self) -> np.ndarray:
        return root(self.scale)

    def sample(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, int]:
        """One draw of the next joint angles (..., 3) for each of ``q``; nothing is ever clipped."""
        precision = rng.chisquare(self.nu, q.shape[:-1]) / self.nu
        return self._nominal(chain, q, v) + rng.standard_normal(q.shape) @ self._root / np.sqrt(precision)[..., None], 0

    def mean(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3) q + J(q)⁻¹v. Raises ModelDomainError for ν ≤ 1, where it does not exist."""
        self._require(1)
        return self._nominal(chain, q, v)

    def covariance(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3, 3) ν/(ν−2)·Λ, whatever the pose and the step. Raises ModelDomainError for ν ≤ 2, where it does not exist."""
        self._require(2)
        return np.broadcast_to(self.nu / (self.nu - 2) * self.scale, (*q.shape, 3))

    def log_density(
        self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, q_next: np.ndarray, measurement: np.ndarray | None = None
    ) -> np.ndarray:
        """(...,) natural log of the density of ``q_next`` (..., 3) in rad⁻³: closed without ``measurement`` (3, 3) in rad², by
        quadrature over the precision with it (:func:`blurred_log_density`)."""
        residual = q_next - self._nominal(chain, q, v)
        if measurement is None:
            return student_log_density(residual, self.nu, self.scale)
        return blurred_log_density(residual, self.nu, self.scale, measurement)

    def _nominal(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return q + np.matvec(chain.inverse_jacobian(q), v)

    def _require(self, moment: int) -> None:
        if not self.nu > moment:
            name = ("mean", "covariance")[moment - 1]
            raise ModelDomainError(f"the {name} of a Student step does not exist for nu of {moment} or less", nu=self.nu)
