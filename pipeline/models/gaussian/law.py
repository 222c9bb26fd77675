"""The Gaussian random matrix model of the inverse Jacobian: J⁻¹ ~ N_{n,n}(J̲⁻¹, I⊗Σ_k) (Eqs.
GausMod–const2; Algorithm 2).

The rows of the noise matrix N ~ N(0, I⊗Σ_k) are independent with covariance Σ_k each, so the
components of N v are independent with variance vᵀΣ_k v: one step is exactly N(J̲⁻¹v, (vᵀΣ_k v)·I),
isotropic in joint space. As Σ_k = s·I, that is s‖v‖²·I.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.chain import JOINTS, PlanarChain
from pipeline.core.errors import ModelDomainError
from pipeline.models.density import normal_log_density
from pipeline.models.model import Law
from pipeline.models.norm import frobenius


def noise_scale(norm: np.ndarray, alpha: float, u: float, n: int) -> np.ndarray:
    """(...,) s of Σ_k = s·I_n, the solution of (cost)–(const2): s = α²(u² − ‖J̲_k⁻¹‖_F²)/n², with
    ``norm`` (...,) ‖J̲_k⁻¹‖_F.

    ln|Σ| under a bound on tr Σ is greatest where all eigenvalues are equal. In the paper's units
    (1/m and 1 mixed) of the inverse Jacobian, squared. Raises ModelDomainError where u is below the
    norm: the problem then has no solution.
    """
    norm = np.asarray(norm, dtype=float)
    if np.any(norm > u):
        raise ModelDomainError(
            "the bound u must not be below the norm of the mean matrix, which it is at "
            f"{int((norm > u).sum())} of {norm.size} poses",
            u=u,
            largest_norm=float(norm.max()),
        )
    return alpha**2 * (u**2 - norm**2) / n**2


@dataclass(frozen=True)
class GaussianModel:
    """Random inverse Jacobian of level ``alpha`` α ≥ 0 under the bound ``u`` > 0 on its Frobenius
    norm: Eq. (GausMod) of J⁻¹. The law of a step, Eq. (RMTInvDiff), is that of Algorithm 2.

    Where a single pose exceeds the bound, ‖J̲⁻¹‖_F > u, its noise is zero, and such poses are
    counted.
    """

    alpha: float
    u: float

    def __post_init__(self) -> None:
        if not (0 <= self.alpha < np.inf and 0 < self.u < np.inf):
            raise ModelDomainError(
                "alpha must be finite and not negative, u finite and positive",
                alpha=self.alpha,
                u=self.u,
            )

    def law(self) -> Law:
        """A step, compiled."""
        from pipeline.models.gaussian.step import gaussian  # here, as it loads the compiler

        return Law(gaussian, np.array([self.alpha, self.u], dtype=float), normals=(1, JOINTS))

    def mean(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n) q + J(q)⁻¹v."""
        return q + np.matvec(chain.inverse_jacobian(q), v)

    def covariance(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n, n) s‖v‖²·I in rad², zero beyond the bound."""
        return self._variance(chain.inverse_jacobian(q), v)[..., None, None] * np.eye(q.shape[-1])

    def log_density(
        self,
        chain: PlanarChain,
        q: np.ndarray,
        v: np.ndarray,
        q_next: np.ndarray,
        measurement: np.ndarray | None = None,
    ) -> np.ndarray:
        """(...,) that of N(q + J⁻¹v, s‖v‖²·I + ``measurement``).

        Raises ModelDomainError where that covariance is singular: without ``measurement`` at rest
        and beyond the bound.
        """
        inverse = chain.inverse_jacobian(q)
        deviation = q_next - q - np.matvec(inverse, v)
        return normal_log_density(
            deviation,
            self._variance(inverse, v),
            np.zeros(inverse.shape[-2:]) if measurement is None else measurement,
        )

    def _variance(self, inverse: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(...,) s‖v‖² in rad², zero beyond the bound."""
        bounded = np.minimum(frobenius(inverse), self.u)
        return noise_scale(bounded, self.alpha, self.u, inverse.shape[-1]) * np.vecdot(v, v)
