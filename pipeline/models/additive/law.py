"""The additive Gaussian model: q_{k+1} = q_k + J(q_k)⁻¹ẋᵈ_kΔt + ω_{k+1}, ω ~ N(0, Σ_ω) (Eq.
InvDiffRndm).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.models.covariance import root
from pipeline.models.density import normal_log_density
from pipeline.models.model import Law


@dataclass(frozen=True)
class AdditiveModel:
    """Eq. (InvDiffRndm): noise of one covariance at every pose and speed, ``noise_covariance`` Σ_ω
    (n, n) in rad²; zero is allowed.
    """

    noise_covariance: np.ndarray

    def __post_init__(self) -> None:
        _ = self._root  # refuses what is not a covariance

    @cached_property
    def _root(self) -> np.ndarray:
        """(n, n) symmetric square root of Σ_ω."""
        return root(self.noise_covariance)

    def law(self) -> Law:
        """A step, compiled."""
        from pipeline.models.additive.step import additive  # here, as it loads the compiler
        from pipeline.models.law import row_by_row

        return Law(additive, row_by_row(self._root), normals=(1, len(self._root)))

    def mean(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n) q + J(q)⁻¹v."""
        return q + np.matvec(chain.inverse_jacobian(q), v)

    def covariance(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n, n) Σ_ω, whatever the pose and the step."""
        return np.broadcast_to(self.noise_covariance, (*q.shape, q.shape[-1]))

    def log_density(
        self,
        chain: PlanarChain,
        q: np.ndarray,
        v: np.ndarray,
        q_next: np.ndarray,
        measurement: np.ndarray | None = None,
    ) -> np.ndarray:
        """(...,) that of N(q + J⁻¹v, Σ_ω + ``measurement``); raises ModelDomainError where that
        covariance is singular.
        """
        covariance = (
            self.noise_covariance if measurement is None else self.noise_covariance + measurement
        )
        return normal_log_density(q_next - self.mean(chain, q, v), 0.0, covariance)
