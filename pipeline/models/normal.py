"""Covariances of the joints, and models whose step is the nominal one plus normal noise: mean,
draws and density follow from the covariance of a step.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError

# asymmetry or negative eigenvalue that rounding may leave, as a share of the largest entry or
# eigenvalue
TOLERANCE = 1e-12


def principal_axes(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variances (n,), ascending and not negative, and axes (n, n), in columns, of ``covariance``
    (n, n); raises ModelDomainError where it is not finite, symmetric and positive semidefinite.
    """
    covariance = np.asarray(covariance, dtype=float)
    square = covariance.ndim == 2 and covariance.shape[0] == covariance.shape[1] > 0
    finite = square and np.all(np.isfinite(covariance))
    if not finite or np.abs(covariance - covariance.T).max() > TOLERANCE * np.abs(covariance).max():
        message = "a covariance must be a finite symmetric matrix"
        raise ModelDomainError(message, covariance=covariance.tolist())
    variances, axes = np.linalg.eigh(covariance)
    if variances[0] < -TOLERANCE * abs(variances[-1]):
        message = "a covariance must be positive semidefinite"
        raise ModelDomainError(message, eigenvalues=variances.tolist())
    return np.maximum(variances, 0.0), axes


def root(covariance: np.ndarray) -> np.ndarray:
    """(n, n) symmetric square root of ``covariance`` (n, n), which may be singular."""
    variances, axes = principal_axes(covariance)
    return (axes * np.sqrt(variances)) @ axes.T


def trace_factor(covariances: np.ndarray, trace: float) -> float:
    """Factor on ``covariances`` (..., n, n) in rad² that gives them a mean trace of ``trace`` rad²;
    raises ModelDomainError where they are zero throughout.
    """
    own = float(np.trace(covariances, axis1=-2, axis2=-1).mean())
    if not own > 0:
        message = "a model without noise at any step has no level that could be solved"
        raise ModelDomainError(message, trace_rad2=own)
    return trace / own


def without_measurement(covariance: np.ndarray, measurement: np.ndarray) -> tuple[np.ndarray, int]:
    """(n, n) ``covariance`` less ``measurement`` (n, n) in rad², and the number of axes along which
    the difference is negative by chance and set to zero.
    """
    variances, axes = np.linalg.eigh(covariance - measurement)
    return (axes * np.maximum(variances, 0.0)) @ axes.T, int(np.count_nonzero(variances < 0))


class NormalModel(ABC):
    """q_{k+1} ~ N(q_k + J⁺v, Cov), the step in the null space of J added; a subclass gives Cov."""

    @abstractmethod
    def covariance(self, chain: Mechanism, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n, n) Cov(q_{k+1} | q_k = q) in rad²."""

    def mean(self, chain: Mechanism, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n) q and the nominal step, in rad."""
        return q + chain.nominal_step(q, v)

    def sample(
        self, chain: Mechanism, q: np.ndarray, v: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """(..., n) the mean plus noise, in rad."""
        mean = self.mean(chain, q, v)
        variances, axes = np.linalg.eigh(self.covariance(chain, q, v))
        white = np.sqrt(np.maximum(variances, 0.0)) * rng.standard_normal(mean.shape)
        return mean + np.matvec(axes, white)

    def log_density(
        self, chain: Mechanism, q: np.ndarray, v: np.ndarray, q_next: np.ndarray, measurement=None
    ) -> np.ndarray:
        """(...,) ln of the density of ``q_next`` (..., n) in rad⁻ⁿ; ``measurement`` (n, n) in rad²
        adds to the covariance. Raises ModelDomainError where the sum is singular.
        """
        covariance = self.covariance(chain, q, v)
        if measurement is not None:
            _ = principal_axes(measurement)  # raises where it is no covariance
            covariance = covariance + measurement
        return normal_log_density(q_next - self.mean(chain, q, v), covariance)


def normal_log_density(deviation: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(...,) ln N(``deviation``; 0, ``covariance``) in rad⁻ⁿ, of (..., n) in rad and (..., n, n) in
    rad², which broadcast. Raises ModelDomainError where a covariance is singular.
    """
    variances, axes = np.linalg.eigh(covariance)
    return axis_log_density(np.vecmat(deviation, axes) ** 2, variances)


def axis_log_density(squared: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """(...,) ln density of independent normals of ``variances`` (..., n), ascending, at deviations
    of squares ``squared`` (..., n). Raises ModelDomainError as :func:`normal_log_density`.
    """
    singular = ~(variances[..., 0] > TOLERANCE * variances[..., -1])
    if np.any(singular):
        raise ModelDomainError(
            f"the covariance is singular at {int(np.count_nonzero(singular))} of {singular.size} "
            "step(s), where the law has no density: "
            "give the covariance of the measurement noise",
            least_variance=float(variances.min()),
        )
    return -0.5 * (np.log(2 * np.pi * variances) + squared / variances).sum(axis=-1)
