"""The density of Student noise t_ν(0, Λ), in closed form, and of t_ν(0, Λ) plus normal noise N(0, R), by quadrature.

Given the precision τ ~ Γ(ν/2, rate ν/2) the sum is N(0, Λ/τ + R); what is left is one integral, over x = ln τ. In the axes in which
Λ = diag(λ), R = diag(ρ) and λ + ρ = 1 the normal is a product of scalars of variances λe⁻ˣ + ρ, which are the same for all residuals: one
set of nodes serves them all, and the exponents are one matrix product. The rule is trapezoidal. Its error falls exponentially with the
spacing h, as the Fourier transform of the integrand at Ω = 2π/h does; without R that is |Γ(a + iΩ)|/Γ(a) with a = (ν+n)/2 for every
residual, and R only makes the integrand wider.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import betaln, digamma, gammainccinv, gammaincinv, gammaln, loggamma

from pipeline.errors import ModelDomainError
from pipeline.motion.density import principal_axes
from pipeline.randommatrix.normal import cholesky

ERROR = 1e-11  # of the density, relative, that the spacing of the nodes leaves
NEGLIGIBLE = 1e-16  # probability beyond either end of the quadrature, as a share of what is within
ROUNDING = 1e-14  # share of the noise along an axis below which Λ has none there
COARSE = 1000  # points at which the ends of the quadrature are sought
BLOCK = 1024  # residuals at a time, so that the exponents stay in the cache


def student_log_density(residual: np.ndarray, nu: float, scale: np.ndarray) -> np.ndarray:
    """(...,) natural log of t_ν(``residual``; 0, Λ) in rad⁻ⁿ, ``residual`` (..., n) in rad, ``scale`` Λ (n, n) in rad².

    Raises ModelDomainError for a singular Λ.
    """
    n = residual.shape[-1]
    lower = cholesky(scale, what="the scale matrix")
    white = np.linalg.solve(lower, residual[..., None])[..., 0]
    # ln Γ((ν+n)/2) − ln Γ(ν/2) by the beta function, which keeps its digits where ν is large
    constant = gammaln(n / 2) - betaln(nu / 2, n / 2) - n / 2 * np.log(nu * np.pi) - np.log(np.diag(lower)).sum()
    return constant - (nu + n) / 2 * np.log1p(np.vecdot(white, white) / nu)


def blurred_log_density(residual: np.ndarray, nu: float, scale: np.ndarray, measurement: np.ndarray) -> np.ndarray:
    """(...,) natural log of the density of t_ν(0, Λ) plus N(0, R) at ``residual`` (..., 3), R = ``measurement`` (3, 3) in rad².

    The relative error of the density is below 1e-10 up to ν = 1e4, where the terms of its constant begin to cancel. Raises
    ModelDomainError where Λ + R is singular or a residual is not finite.
    """
    flat = residual.reshape(-1, residual.shape[-1])
    mixture = Mixture(flat, nu, scale, measurement)
    result = np.empty(len(flat))
    for rows in mixture.blocks():
        result[rows] = mixture.log_terms(rows)[1]
    return result.reshape(residual.shape[:-1])


@dataclass(frozen=True)
class Slopes:
    """Mean of ln p over the residuals, and its slopes."""

    mean: float
    by_nu: float
    by_scale: np.ndarray  # (n, n) by Λ, symmetric


def mean_slopes(residual: np.ndarray, nu: float, scale: np.ndarray, measurement: np.ndarray) -> Slopes:
    """The mean of :func:`blurred_log_density` over ``residual`` (N, n), and how it rises with ν and Λ.

    By Fisher's identity: the slope of ln p is the expected slope of ln p(r, τ) under the law of τ given r, whose weights the quadrature
    has at hand. With u = 1/(λe⁻ˣ + ρ), in the axes, the slope by Λ is ½E[e⁻ˣ(u_iu_jr_ir_j − u_iδ_ij)].
    """
    mixture = Mixture(residual, nu, scale, measurement)
    n = residual.shape[-1]
    precisions, x = 1 / mixture.variances, mixture.x
    rows, columns = np.tril_indices(n)
    pairs = np.exp(-x)[:, None] * precisions[:, rows] * precisions[:, columns]
    total, of_nodes, of_pairs = 0.0, np.zeros(len(x)), np.zeros(len(rows))
    for block in mixture.blocks():
        terms, log_density = mixture.log_terms(block)
        total += log_density.sum()
        of_nodes += terms.sum(axis=0)
        turned = mixture.turned[block]
        of_pairs += np.sum(terms @ pairs * turned[:, rows] * turned[:, columns], axis=0)
    by_scale = np.zeros((n, n))
    by_scale[rows, columns] = by_scale[columns, rows] = of_pairs
    by_scale = 0.5 * mixture.axes @ (by_scale - np.diag((np.exp(-x)[:, None] * precisions).T @ of_nodes)) @ mixture.axes.T
    by_nu = of_nodes @ (x - np.expm1(x)) + len(residual) * (np.log(nu / 2) - digamma(nu / 2))
    return Slopes(float(total / len(residual)), float(0.5 * by_nu / len(residual)), by_scale / len(residual))


class Mixture:
    """The quadrature for residuals (N, n): nodes ``x`` (K,), ``variances`` (K, n) of the normal at each along ``axes`` (n, n), which are
    columns, and ``turned`` (N, n), the residuals in these axes."""

    def __init__(self, residual: np.ndarray, nu: float, scale: np.ndarray, measurement: np.ndarray) -> None:
        n = residual.shape[-1]
        _ = principal_axes(measurement)  # refuses what is not a covariance
        if not np.all(np.isfinite(residual)):
            raise ModelDomainError(
                "a step that is not finite has no density", steps=int(np.count_nonzero(~np.isfinite(residual).all(axis=-1)))
            )
        lower = cholesky(scale + measurement, what="the scale matrix with the measurement's covariance")
        half = np.linalg.solve(lower, scale)
        shares, turn = np.linalg.eigh(np.linalg.solve(lower, half.T))
        self.of_scale = np.where(shares > ROUNDING, np.minimum(shares, 1.0), 0.0)
        self.nu, self.of_measurement = nu, 1 - self.of_scale
        self.axes = np.linalg.solve(lower.T, turn)
        self.turned = residual @ self.axes
        self.squares = self.turned**2
        low, high = self._ends(n)
        spacing = _spacing((nu + n) / 2)
        self.x = low + spacing * np.arange(np.ceil((high - low) / spacing) + 1)
        constant = nu / 2 * (np.log(nu / 2) - 1) - gammaln(nu / 2) - n / 2 * np.log(2 * np.pi) - np.log(np.diag(lower)).sum()
        self.variances = self._variances(self.x)
        self._of_nodes = self._log_weights(self.x) + constant + np.log(spacing)
        self._precisions = -0.5 / self.variances.T

    def blocks(self) -> list[slice]:
        """Rows of the residuals, BLOCK at a time."""
        return [slice(start, start + BLOCK) for start in range(0, len(self.squares), BLOCK)]

    def log_terms(self, rows: slice) -> tuple[np.ndarray, np.ndarray]:
        """(B, K) the probability of each node given each residual, and (B,) ln p."""
        terms = self.squares[rows] @ self._precisions
        terms += self._of_nodes
        top = terms.max(axis=1, keepdims=True)
        terms -= top
        np.exp(terms, out=terms)
        total = terms.sum(axis=1, keepdims=True)
        terms /= total
        return terms, (top + np.log(total))[:, 0]

    def _variances(self, x: np.ndarray) -> np.ndarray:
        return self.of_scale * np.exp(-x)[:, None] + self.of_measurement

    def _log_weights(self, x: np.ndarray) -> np.ndarray:
        """Of x and of a residual of zero, but for a constant; the largest terms of the prior are taken together, for they cancel."""
        return self.nu / 2 * (x - np.expm1(x)) - 0.5 * np.log(self._variances(x)).sum(axis=-1)

    def _ends(self, n: int) -> tuple[float, float]:
        """Between which x all but a NEGLIGIBLE share of every integral lies.

        First between the quantiles of the prior, the rate for the lower being that of the largest residual without R. Then closer: the
        larger the residual, the lower x lies, whatever R is, so the largest tells of the lower end and one of zero of the upper.
        """
        largest = self.squares.max(axis=0, initial=0.0)
        with_scale = self.of_scale > 0
        distance = np.sum(largest[with_scale] / self.of_scale[with_scale])
        low = np.log(np.maximum(gammaincinv(self.nu / 2, NEGLIGIBLE), np.finfo(float).tiny)) - np.log((self.nu + distance) / 2)
        high = np.log(gammainccinv((self.nu + n) / 2, NEGLIGIBLE)) - np.log(self.nu / 2)
        x = np.linspace(low, high, COARSE)
        of_zero = self._log_weights(x)
        of_largest = of_zero - 0.5 * np.sum(largest / self._variances(x), axis=-1)
        reach = np.log(NEGLIGIBLE)
        first = np.flatnonzero(of_largest > of_largest.max() + reach)[0]
        last = np.flatnonzero(of_zero > of_zero.max() + reach)[-1]
        return float(x[max(first - 1, 0)]), float(x[min(last + 1, COARSE - 1)])


def _spacing(a: float) -> float:
    """h at which the trapezoidal rule for the integral of exp(ax − beˣ) over x has the relative ERROR, whatever b."""

    def excess(frequency: float) -> float:
        return float(loggamma(complex(a, frequency)).real - gammaln(a) - np.log(ERROR / 2))

    return 2 * np.pi / brentq(excess, 0.0, 40 + 10 * np.sqrt(a))
