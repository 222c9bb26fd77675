"""The parametric force model: tensions are normal, cable directions von Mises, everything
independent.

Planar cables that meet in one point pull with F = Σᵢ Tᵢ·(cos θᵢ, sin θᵢ), Tᵢ ~ N(T̲ᵢ, σ_Tᵢ²), θᵢ ~
vM(θ̲ᵢ, κᵢ). The concentration κ is what the paper writes σ_θ: the larger, the narrower.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import i0e, i1e

from pipeline.core.errors import ModelDomainError


@dataclass(frozen=True)
class CableSystem:
    """One planar cable system, or an array of them: every field has shape (..., m), m the number of
    cables.

    Its force is that of Eq. (WrenchStatEq), the directions those of Eq. (vMis).
    """

    tension: np.ndarray  # T̲, N
    direction: np.ndarray  # θ̲, rad, from the platform along the cable
    tension_sd: np.ndarray  # σ_T, N
    concentration: np.ndarray  # κ (the paper's σ_θ), dimensionless

    def __post_init__(self) -> None:
        for name in ("tension", "direction", "tension_sd", "concentration"):
            values = np.asarray(getattr(self, name), dtype=float)
            if values.ndim == 0 or values.shape != np.shape(self.tension):
                raise ModelDomainError(
                    f"{name} {values.shape} and tension {np.shape(self.tension)} must have one "
                    "shape, (..., cables)"
                )
            if not np.isfinite(values).all():
                raise ModelDomainError(f"{name} has values that are not finite")
            object.__setattr__(self, name, values)
        if np.any(self.tension_sd < 0) or np.any(self.concentration <= 0):
            raise ModelDomainError("a cable system needs tension_sd ≥ 0 and concentration > 0")


def mean_resultant_length(concentration: np.ndarray) -> np.ndarray:
    """A(κ) = I₁(κ)/I₀(κ) = E cos(θ − θ̲) of the von Mises law, any shape.

    The exponential scaling cancels in the ratio; without it I₀ overflows a double beyond κ = 713.
    """
    return i1e(concentration) / i0e(concentration)


def force_covariance(system: CableSystem) -> np.ndarray:
    """Cov(F) in N², (..., 2, 2): Eqs. (kapF11) and (kapF22) on the diagonal, and the covariance
    that the paper leaves out.

    Off the diagonal each cable gives ½·sin 2θ̲·(ā − 2b̄), with the paper's ā and b̄.
    """
    length = mean_resultant_length(system.concentration)
    second_moment = system.tension**2 + system.tension_sd**2
    a = second_moment - (length * system.tension) ** 2
    b = length * second_moment / system.concentration
    cos2 = np.cos(2 * system.direction)
    xx = np.sum(a * np.cos(system.direction) ** 2 - b * cos2, axis=-1)
    yy = np.sum(a * np.sin(system.direction) ** 2 + b * cos2, axis=-1)
    xy = np.sum(np.sin(2 * system.direction) * (a - 2 * b) / 2, axis=-1)
    return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
