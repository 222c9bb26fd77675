"""Gaussian noise that grows with the joint speed: the law that a random Jacobian has to be held
against.

    ω_{k+1} = η + D(q̇)ε,   η ~ N(0, A),   ε ~ N(0, B),   q̇ = J(q_k)⁺ẋᵈ_kΔt  (rad a step),   D(q̇)
    = diag(q̇),

so Cov(ω) = A + D(q̇)BD(q̇): a floor A at rest, and for each joint a share of its own step that
varies, with covariance B between the joints. It is positive semidefinite at every speed since A and
B are. With A and B diagonal it is σ_j² = a_j + b_jq̇_j² for each joint alone; with B = σ_ε²·11ᵀ it
is A + σ_ε²q̇q̇ᵀ, one timing error w = εq̇ that all joints share; with B = 0 the additive model.
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


def scaled_covariance(floor: np.ndarray, gain: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """(..., n, n) A + D(q̇)BD(q̇) in rad² for the steps ``dq`` q̇ (..., n) in rad; ``floor`` A (n,
    n) in rad², ``gain`` B (n, n).
    """
    return floor + gain * (dq[..., :, None] * dq[..., None, :])


@dataclass(frozen=True)
class ScaledModel(NormalModel):
    """Noise of covariance ``floor`` A (n, n) in rad² at rest and ``gain`` B (n, n), in shares of a
    step, for what grows with speed.

    Both may be singular or zero; raises ModelDomainError where one is no covariance.
    """

    floor: np.ndarray
    gain: np.ndarray

    def __post_init__(self) -> None:
        _ = self._roots  # refuses what is not a covariance

    @cached_property
    def _roots(self) -> tuple[np.ndarray, np.ndarray]:
        return root(self.floor), root(self.gain)

    def law(self, chain: Chain) -> Law:
        """Law of a compiled step."""
        n = len(chain.lower)
        parameters = np.concatenate([row_by_row(each, n) for each in self._roots])
        return Law(SCALED_LAW, parameters, sets=2, each=n)

    def covariance(self, chain: Mechanism, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n, n) A + D(q̇)BD(q̇) in rad²."""
        return scaled_covariance(self.floor, self.gain, chain.nominal_step(q, v))

    def with_trace(
        self, chain: Mechanism, q: np.ndarray, v: np.ndarray, trace: float
    ) -> ScaledModel:
        """The model of A and B times one factor; raises ModelDomainError where it has no noise."""
        factor = trace_factor(self.covariance(chain, q, v), trace)
        return replace(self, floor=factor * self.floor, gain=factor * self.gain)


def build(parameters: dict[str, Any]) -> ScaledModel:
    """The model with these parameters."""
    return ScaledModel(np.array(parameters["floor"]), np.array(parameters["gain"]))
