"""Covariances of the joints, and models whose step is the nominal one plus normal noise: mean,
draws and density follow from the covariance of a step.
"""

from abc import ABC, abstractmethod

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError

# asymmetry or negative eigenvalue that rounding may leave, as a share of the largest one
TOLERANCE = 1e-12


def principal_axes(covariance: ndarray) -> tuple[ndarray, ndarray]:
    """Variances (n,), ascending and not negative, and axes (n, n), in columns, of ``covariance``
    (n, n). Raises ModelDomainError if it is not finite, symmetric and positive semidefinite.
    """
    covariance = np.asarray(covariance, dtype=float)
    square = covariance.ndim == 2 and covariance.shape[0] == covariance.shape[1] > 0
    if square and np.all(np.isfinite(covariance)):
        variances, axes = np.linalg.eigh(covariance)
        asymmetry = np.abs(covariance - covariance.T).max() / max(np.abs(covariance).max(), 1e-300)
        if max(asymmetry, -variances[0] / max(abs(variances[-1]), 1e-300)) <= TOLERANCE:
            return np.maximum(variances, 0.0), axes
    message = "a covariance must be a finite, symmetric and positive semidefinite matrix"
    raise ModelDomainError(message, covariance=covariance.tolist())


def root(covariance: ndarray) -> ndarray:
    """(n, n) symmetric square root of ``covariance`` (n, n), which may be singular."""
    variances, axes = principal_axes(covariance)
    return (axes * np.sqrt(variances)) @ axes.T


def trace_factor(covariances: ndarray, trace: float) -> float:
    """Factor on ``covariances`` (..., n, n) in rad² that gives them the mean ``trace`` in rad²;
    raises ModelDomainError if they are all zero.
    """
    current = float(np.trace(covariances, axis1=-2, axis2=-1).mean())
    if not current > 0:
        message = "a model without noise at any step has no level that could be solved"
        raise ModelDomainError(message, trace_rad2=current)
    return trace / current


def without_measurement(covariance: ndarray, measurement: ndarray) -> tuple[ndarray, int]:
    """(n, n) ``covariance`` less ``measurement`` (n, n) in rad², negative variances set to zero;
    and the number of those.
    """
    variances, axes = np.linalg.eigh(covariance - measurement)
    return (axes * np.maximum(variances, 0.0)) @ axes.T, int(np.count_nonzero(variances < 0))


class NormalModel(ABC):
    """q_{k+1} ~ N(q_k + J⁺v + the null-space step, Cov); a subclass defines Cov. The methods are
    described in :class:`pipeline.models.model.MotionModel`.
    """

    @abstractmethod
    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray: ...

    def mean(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        return q + chain.nominal_step(q, v)

    def sample(self, chain: Mechanism, q: ndarray, v: ndarray, rng: Generator) -> ndarray:
        mean = self.mean(chain, q, v)
        variances, axes = np.linalg.eigh(self.covariance(chain, q, v))
        white = np.sqrt(np.maximum(variances, 0.0)) * rng.standard_normal(mean.shape)
        return mean + np.matvec(axes, white)

    def log_density(
        self, chain: Mechanism, q: ndarray, v: ndarray, q_next: ndarray, measurement=None
    ) -> ndarray:
        covariance = self.covariance(chain, q, v)
        if measurement is not None:
            _ = principal_axes(measurement)  # raises if it is no covariance
            covariance = covariance + measurement
        return normal_log_density(q_next - self.mean(chain, q, v), covariance)


def normal_log_density(deviation: ndarray, covariance: ndarray) -> ndarray:
    """(...,) ln N(``deviation``; 0, ``covariance``) in rad⁻ⁿ, of (..., n) in rad and (..., n, n) in
    rad², which broadcast. Raises ModelDomainError for a singular covariance.
    """
    variances, axes = np.linalg.eigh(covariance)
    return axis_log_density(np.vecmat(deviation, axes) ** 2, variances)


def axis_log_density(squared: ndarray, variances: ndarray) -> ndarray:
    """(...,) log density of independent normals of ``variances`` (..., n), ascending, at deviations
    with the squares ``squared`` (..., n). Raises ModelDomainError as :func:`normal_log_density`.
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
