"""Models whose step is the nominal one and normal noise: mean, draws and density follow from the
covariance of a step.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.covariance import TOLERANCE, principal_axes


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
        """(..., n) the mean and noise, in rad."""
        mean = self.mean(chain, q, v)
        variances, axes = np.linalg.eigh(self.covariance(chain, q, v))
        white = np.sqrt(np.maximum(variances, 0.0)) * rng.standard_normal(mean.shape)
        return mean + np.matvec(axes, white)

    def log_density(
        self,
        chain: Mechanism,
        q: np.ndarray,
        v: np.ndarray,
        q_next: np.ndarray,
        measurement: np.ndarray | None = None,
    ) -> np.ndarray:
        """(...,) ln of the density of ``q_next`` (..., n) in rad⁻ⁿ; ``measurement`` (n, n) in rad²
        adds to the covariance.

        Raises ModelDomainError where the covariance is singular: at rest and beyond the bound of a
        matrix model without ``measurement``.
        """
        covariance = self.covariance(chain, q, v)
        if measurement is not None:
            _ = principal_axes(measurement)  # refuses what is not a covariance
            covariance = covariance + measurement
        return normal_log_density(q_next - self.mean(chain, q, v), covariance)


def normal_log_density(deviation: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(...,) ln N(``deviation``; 0, ``covariance``), (..., n) in rad and (..., n, n) in rad², which
    broadcast; in rad⁻ⁿ. Raises ModelDomainError where a covariance is singular.
    """
    variances, axes = np.linalg.eigh(covariance)
    return axis_log_density(np.vecmat(deviation, axes) ** 2, variances)


def axis_log_density(squared: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """(...,) ln density of independent normals of ``variances`` (..., n), ascending, at deviations
    with these squares ``squared`` (..., n). Raises ModelDomainError as :func:`normal_log_density`.
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
