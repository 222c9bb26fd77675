"""The additive Gaussian model: q_{k+1} = q_k + J(q_k)⁺ẋᵈ_kΔt + ω_{k+1}, ω ~ N(0, Σ_ω) (Eq.
InvDiffRndm), J⁺ the inverse of a square J; of another what is commanded in its null space is added.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pipeline.arm.interface import Chain, Mechanism
from pipeline.models.covariance import root, trace_factor
from pipeline.models.model import SCALED_LAW, Law, row_by_row
from pipeline.models.normal import NormalModel


@dataclass(frozen=True)
class AdditiveModel(NormalModel):
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

    def law(self, chain: Chain) -> Law:
        """Law of a compiled step: that of the scaled model without noise that grows with speed."""
        n = len(chain.lower)
        return Law(SCALED_LAW, row_by_row(self._root, n), sets=1, each=n)

    def covariance(self, chain: Mechanism, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n, n) Σ_ω, whatever the pose and the step."""
        return np.broadcast_to(self.noise_covariance, (*q.shape, q.shape[-1]))

    def with_trace(
        self, chain: Mechanism, q: np.ndarray, v: np.ndarray, trace: float
    ) -> AdditiveModel:
        """The model of Σ_ω times a factor; raises ModelDomainError where it has no noise."""
        factor = trace_factor(self.covariance(chain, q, v), trace)
        return replace(self, noise_covariance=factor * self.noise_covariance)


def build(parameters: dict[str, Any]) -> AdditiveModel:
    """The model with these parameters."""
    return AdditiveModel(np.array(parameters["noise_covariance"]))
