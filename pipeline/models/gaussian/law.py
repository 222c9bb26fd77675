"""Gaussian random matrix model of the inverse Jacobian: J⁺ ~ N_{n,m}(J̲⁺, I⊗Σ_k) (Eqs.
GausMod–const2; Algorithm 2); J⁺ = J⁻¹ for m = n.

The rows of the noise matrix are independent with covariance Σ_k = s·I, so one step is exactly
N(J̲⁺v, s‖v‖²·I), isotropic in joint space. A step in the null space of J has no noise.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy import ndarray

from pipeline.arm.chain import Chain
from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.model import (
    GAUSSIAN_LAW,
    Law,
    MotionModel,
    Traits,
    frobenius,
    task_step,
    trace_factor,
)

UNBOUNDED = 1e9  # u, far above the norm of any inverse Jacobian


def noise_scale(norm: ndarray, alpha: float, u: float, n: int, m: int) -> ndarray:
    """(...,) s of Σ_k = s·I_m, the solution of (cost)–(const2): s = α²(u² − ‖J̲_k⁺‖_F²)/(nm) for
    J̲_k⁺ (n, m) of ``norm`` (...,) ‖J̲_k⁺‖_F, with scale ``alpha`` α and bound ``u``; in squared
    units of J⁺ (1/m and 1). Raises ModelDomainError for u below the norm: no solution.
    """
    norm = np.asarray(norm, dtype=float)
    if np.any(norm > u):
        message = "the bound u must be at least the norm of the mean matrix; it is below the norm"
        message = f"{message} at {int((norm > u).sum())} of {norm.size} poses"
        raise ModelDomainError(message, u=u, largest_norm=float(norm.max()))
    return alpha**2 * (u**2 - norm**2) / (n * m)


@dataclass(frozen=True)
class GaussianModel(MotionModel):
    """Random inverse Jacobian J⁺, Eq. (GausMod), with the scale ``alpha`` α ≥ 0. The noise is
    zero where ‖J⁺‖_F exceeds the bound ``u`` > 0. A step, Eq. (RMTInvDiff), has the law of
    Algorithm 2. Raises ModelDomainError for α or u out of range.
    """

    traits: ClassVar = Traits(noisy_at_rest=False, needs_jacobian=True)
    alpha: float
    u: float

    def __post_init__(self) -> None:
        if not (0 <= self.alpha < np.inf and 0 < self.u < np.inf):
            message = "alpha must be finite and not negative, u finite and positive"
            raise ModelDomainError(message, alpha=self.alpha, u=self.u)

    def law(self, chain: Chain) -> Law:
        return Law(
            GAUSSIAN_LAW,
            np.array([self.alpha, self.u], float),
            len(chain.lower),
        )

    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        """(..., n, n) s‖v‖²·I in rad², zero beyond the bound."""
        inverse = chain.inverse_jacobian(q)
        v = task_step(chain, v)
        n, m = inverse.shape[-2:]
        bounded = np.minimum(frobenius(inverse), self.u)
        scale = noise_scale(bounded, self.alpha, self.u, n, m)
        variance = scale * np.vecdot(v, v)
        return variance[..., None, None] * np.eye(n)

    def with_trace(
        self,
        chain: Mechanism,
        q: ndarray,
        v: ndarray,
        trace: float,
    ) -> "GaussianModel":
        """Return the model with another α and the same u; ModelDomainError for zero noise."""
        factor = trace_factor(self.covariance(chain, q, v), trace)
        return replace(self, alpha=float(np.sqrt(factor)) * self.alpha)


def build(parameters: dict[str, Any]) -> GaussianModel:
    """Build the model from ``alpha`` and ``u``, or for an unbounded u from the ``level`` L."""
    if "level" in parameters:
        return GaussianModel(parameters["level"] / UNBOUNDED, UNBOUNDED)
    return GaussianModel(parameters["alpha"], parameters["u"])
