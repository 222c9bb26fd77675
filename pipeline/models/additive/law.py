"""Additive Gaussian model: q_{k+1} = q_k + J(q_k)⁺ẋᵈ_kΔt + ω_{k+1}, ω ~ N(0, Σ_ω) (Eq.
InvDiffRndm).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy import ndarray

from pipeline.arm.chain import Chain
from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.model import (
    ADDITIVE_LAW,
    Law,
    MotionModel,
    Traits,
    root,
    trace_factor,
)


@dataclass(frozen=True)
class AdditiveModel(MotionModel):
    """Model of Eq. (InvDiffRndm) with the noise covariance ``noise`` Σ_ω (n, n) in rad², which may
    be singular. Raises ModelDomainError if it is not a covariance.
    """

    traits: ClassVar = Traits(noisy_at_rest=True, needs_jacobian=False)
    noise: ndarray

    def __post_init__(self) -> None:
        _ = self._root  # raises if it is no covariance

    @cached_property
    def _root(self) -> ndarray:
        return root(self.noise)

    def law(self, chain: Chain) -> Law:
        """Law of a compiled step. Raises ModelDomainError if the covariance and the ``chain``
        differ in their number of joints.
        """
        n = len(chain.lower)
        if self.noise.shape != (n, n):
            raise ModelDomainError(
                f"the model's matrix must have a row for each of the {n} joints of this arm; run "
                "the stage fit for it",
                shape=self.noise.shape,
            )
        return Law(ADDITIVE_LAW, self._root.ravel(), normals=n)

    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        shape = *q.shape, q.shape[-1]
        return np.broadcast_to(self.noise, shape)  # at singular poses too

    def with_trace(
        self,
        chain: Mechanism,
        q: ndarray,
        v: ndarray,
        trace: float,
    ) -> "AdditiveModel":
        """Return the model with Σ_ω times a factor; ModelDomainError for zero noise."""
        factor = trace_factor(self.covariance(chain, q, v), trace)
        return AdditiveModel(factor * self.noise)


def build(parameters: dict[str, Any]) -> AdditiveModel:
    """Build the model of Eq. (InvDiffRndm) from its ``noise_covariance`` Σ_ω in rad²."""
    return AdditiveModel(np.array(parameters["noise_covariance"], float))
