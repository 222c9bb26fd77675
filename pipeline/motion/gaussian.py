"""The Gaussian random matrix model of the inverse Jacobian: J⁻¹ ~ N_{n,n}(J̲⁻¹, I⊗Σ_k) (Eqs. GausMod–const2; Algorithm 2).

The rows of the noise matrix N ~ N(0, I⊗Σ_k) are independent with covariance Σ_k each, so the components of N v are independent
with variance vᵀΣ_k v: one step is exactly N(J̲⁻¹v, (vᵀΣ_k v)·I), isotropic in joint space. As Σ_k = s·I, that is s‖v‖²·I.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.errors import ModelDomainError
from pipeline.motion.density import normal_log_density
from pipeline.motion.model import Law


def frobenius(matrix: np.ndarray) -> np.ndarray:
    """(...,) Frobenius norm of ``matrix`` (..., n, n)."""
    return np.sqrt(np.einsum("...ij,...ij->...", matrix, matrix))


def noise_scale(norm: np.ndarray, alpha: float, u: float, n: int) -> np.ndarray:
    """(...,) s of Σ_k = s·I_n, the solution of (cost)–(const2): s = α²(u² − ‖J̲_k⁻¹‖_F²)/n², with ``norm`` (...,) ‖J̲_k⁻¹‖_F.

    ln|Σ| under a bound on tr Σ is greatest where all eigenvalues are equal. In the paper's units (1/m and 1 mixed) of the inverse
    Jacobian, squared. Raises ModelDomainError where u is below the norm: the problem then has no solution.
    """
    norm = np.asarray(norm, dtype=float)
    if np.any(norm > u):
        raise ModelDomainError(
            f"the bound u must not be below the norm of the mean matrix, which it is at {int((norm > u).sum())} of {norm.size} poses",
            u=u,
            largest_norm=float(norm.max()),
        )
    return alpha**2 * (u**2 - norm**2) / n**2


@dataclass(frozen=True)
class GaussianModel:
    """Random inverse Jacobian of level ``alpha`` α ≥ 0 under the bound ``u`` > 0 on its Frobenius norm: Eq. (GausMod) of J⁻¹.

    Where a single pose exceeds the bound, ‖J̲⁻¹‖_F > u, its noise is zero, and such poses are counted.
    """

    alpha: float
    u: float

    def __post_init__(self) -> None:
        if not (0 <= self.alpha < np.inf and 0 < self.u < np.inf):
            raise ModelDomainError("alpha must be finite and not negative, u finite and positive", alpha=self.alpha, u=self.u)

    def sample(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, int]:
        """One draw of the next joint angles (..., 3) for each of ``q``: Algorithm 2 in law; the number of poses beyond u."""
        inverse = chain.inverse_jacobian(q)
        variance, clipped = self._variance(inverse, v)
        return q + np.matvec(inverse, v) + np.sqrt(variance)[..., None] * rng.standard_normal(q.shape), clipped

    def law(self) -> Law:
        """:meth:`sample` compiled."""
        from pipeline.motion.compiled import gaussian  # here, as it loads the compiler

        return Law(gaussian.of_inverse, np.array([self.alpha, self.u], dtype=float), normals=(1, 3))

    def require_bound(self, chain: PlanarChain, path: np.ndarray) -> None:
        """Raise ModelDomainError where u is below ‖J̲⁻¹‖_F on ``path`` (M, 3) in rad: particles may stray there, the motion may not."""
        noise_scale(frobenius(chain.inverse_jacobian(path, what="mean pose")), self.alpha, self.u, 3)

    def mean(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3) q + J(q)⁻¹v."""
        return q + np.matvec(chain.inverse_jacobian(q), v)

    def covariance(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3, 3) s‖v‖²·I in rad², zero beyond the bound."""
        return self._variance(chain.inverse_jacobian(q), v)[0][..., None, None] * np.eye(3)

    def log_density(
        self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, q_next: np.ndarray, measurement: np.ndarray | None = None
    ) -> np.ndarray:
        """(...,) that of N(q + J⁻¹v, s‖v‖²·I + ``measurement``).

        Raises ModelDomainError where that covariance is singular: without ``measurement`` at rest and beyond the bound.
        """
        inverse = chain.inverse_jacobian(q)
        deviation = q_next - q - np.matvec(inverse, v)
        return normal_log_density(deviation, self._variance(inverse, v)[0], np.zeros((3, 3)) if measurement is None else measurement)

    def _variance(self, inverse: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, int]:
        norm = frobenius(inverse)
        return noise_scale(np.minimum(norm, self.u), self.alpha, self.u, 3) * np.vecdot(v, v), int(np.count_nonzero(norm > self.u))
