"""Gaussian noise at rest plus noise that grows with the joint speed:

    ω_{k+1} = η + D(q̇)ε,   η ~ N(0, A),   ε ~ N(0, B),   q̇ = J(q_k)⁺ẋᵈ_kΔt (rad a step),

D(q̇) = diag(q̇). Cov(ω) = A + D(q̇)BD(q̇) is positive semidefinite at every speed, as A and B are.
Diagonal A and B give σ_j² = a_j + b_jq̇_j² for each joint; B = σ_ε²·11ᵀ is one timing error ω = εq̇
of all joints; without B the model is the additive one.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy import ndarray

from pipeline.arm.interface import Chain, Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.model import SCALED_LAW, Law, NormalModel, Traits, root, trace_factor


@dataclass(frozen=True)
class ScaledModel(NormalModel):
    """Model with the noise covariance ``floor`` A (n, n) in rad² at rest and ``gain`` B (n, n)
    relative to the step. ``gain`` is None for the additive model, Eq. (InvDiffRndm). Both may be
    singular. Raises ModelDomainError if one is not a covariance.
    """

    traits: ClassVar = Traits(noisy_at_rest=True, needs_jacobian=False)
    floor: ndarray
    gain: ndarray | None = None

    def __post_init__(self) -> None:
        _ = self._roots  # raises if one is no covariance

    @cached_property
    def _roots(self) -> list[ndarray]:
        return [root(each) for each in (self.floor, self.gain) if each is not None]

    def law(self, chain: Chain) -> Law:
        """Law of a compiled step, with one set of normal variates per covariance. Raises
        ModelDomainError if the covariances and the ``chain`` differ in their number of joints.
        """
        n, parameters = len(chain.lower), np.array(self._roots)
        if parameters.shape[1:] != (n, n):
            message = f"the model's matrix must have a row for each of the {n} joints of this arm"
            raise ModelDomainError(f"{message}; run the stage fit for it", shape=self.floor.shape)
        return Law(SCALED_LAW, parameters.ravel(), sets=len(self._roots), normals=n)

    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        if self.gain is None:  # at singular poses too
            return np.broadcast_to(self.floor, (*q.shape, q.shape[-1]))
        return self.covariance_of_joint_step(chain.nominal_step(q, v))

    def covariance_of_joint_step(self, dq: ndarray) -> ndarray:
        """(..., n, n) A + D(q̇)BD(q̇) in rad² for commanded steps ``dq`` q̇ (..., n) in rad."""
        if self.gain is None:
            return np.broadcast_to(self.floor, (*dq.shape, dq.shape[-1]))
        return self.floor + self.gain * (dq[..., :, None] * dq[..., None, :])

    def with_trace(self, chain: Mechanism, q: ndarray, v: ndarray, trace: float) -> "ScaledModel":
        """Return the model with A and B times one factor; ModelDomainError for zero noise."""
        factor = trace_factor(self.covariance(chain, q, v), trace)
        gain = None if self.gain is None else factor * self.gain
        return replace(self, floor=factor * self.floor, gain=gain)


def build(parameters: dict[str, Any]) -> ScaledModel:
    """Build the model from A (``floor``, rad²) and B (``gain``)."""
    return ScaledModel(np.array(parameters["floor"]), np.array(parameters["gain"]))
