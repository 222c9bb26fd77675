"""Additive noise of heavy tails: q_{k+1} = q_k + J(q_k)⁻¹ẋᵈ_kΔt + ω_{k+1}, ω ~ t_ν(0, Λ), the multivariate Student distribution.

It is Gaussian noise whose precision varies from step to step, ω | τ ~ N(0, Λ/τ) with τ ~ Γ(ν/2, rate ν/2); for ν → ∞ it is the
additive model with Σ_ω = Λ.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.errors import ModelDomainError
from pipeline.motion.covariance import root
from pipeline.motion.model import Law
from pipeline.motion.student_density import blurred_log_density, student_log_density


@dataclass(frozen=True)
class StudentModel:
    """Student noise of ``nu`` ν > 0 degrees of freedom and scale matrix ``scale`` Λ (3, 3) in rad², the same at every pose and speed.

    Λ may be singular; raises ModelDomainError where it is no covariance, and for other ν.
    """

    nu: float
    scale: np.ndarray

    def __post_init__(self) -> None:
        if not 0 < self.nu < np.inf:
            raise ModelDomainError("the degrees of freedom must be positive and finite", nu=self.nu)
        _ = self._root  # refuses what is not a covariance

    @cached_property
    def _root(self) -> np.ndarray:
        return root(self.scale)

    def sample(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, int]:
        """One draw of the next joint angles (..., 3) for each of ``q``; nothing is ever clipped."""
        precision = rng.chisquare(self.nu, q.shape[:-1]) / self.nu
        return self._nominal(chain, q, v) + rng.standard_normal(q.shape) @ self._root / np.sqrt(precision)[..., None], 0

    def law(self) -> Law:
        """:meth:`sample` compiled."""
        from pipeline.motion.compiled import additive  # here, as it loads the compiler

        return Law(additive.student, np.array([self.nu, *self._root.ravel()]), normals=(1, 3), degrees=self.nu)

    def mean(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3) q + J(q)⁻¹v. Raises ModelDomainError for ν ≤ 1, where it does not exist."""
        self._require(1)
        return self._nominal(chain, q, v)

    def covariance(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3, 3) ν/(ν−2)·Λ, whatever the pose and the step. Raises ModelDomainError for ν ≤ 2, where it does not exist."""
        self._require(2)
        return np.broadcast_to(self.nu / (self.nu - 2) * self.scale, (*q.shape, 3))

    def log_density(
        self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, q_next: np.ndarray, measurement: np.ndarray | None = None
    ) -> np.ndarray:
        """(...,) natural log of the density of ``q_next`` (..., 3) in rad⁻³: closed without ``measurement`` (3, 3) in rad², by
        quadrature over the precision with it (:func:`blurred_log_density`). Raises ModelDomainError where there is none: Λ singular,
        and no measurement noise to make up for it."""
        residual = q_next - self._nominal(chain, q, v)
        if measurement is None:
            return student_log_density(residual, self.nu, self.scale)
        return blurred_log_density(residual, self.nu, self.scale, measurement)

    def _nominal(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return q + np.matvec(chain.inverse_jacobian(q), v)

    def _require(self, moment: int) -> None:
        if not self.nu > moment:
            name = ("mean", "covariance")[moment - 1]
            raise ModelDomainError(f"the {name} of a Student step does not exist for nu of {moment} or less", nu=self.nu)
