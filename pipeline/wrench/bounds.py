"""What alone is known of a cable system in the study: bounds, within which its values are uniform
and independent.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from pipeline.core.errors import ConfigError
from pipeline.wrench.parametric import CableSystem


@dataclass(frozen=True)
class Bounds:
    """(low, high) of what characterises a cable; a system draws each cable's values uniformly and
    independently within them.
    """

    tension: tuple[float, float]  # T̲, N
    direction: tuple[float, float]  # θ̲, rad
    tension_sd: tuple[float, float]  # σ_T, N
    concentration: tuple[float, float]  # κ (the paper's σ_θ)

    def __post_init__(self) -> None:
        for field in fields(self):
            low, high = getattr(self, field.name)
            if not -np.inf < low <= high < np.inf:
                raise ConfigError(
                    f"wrench bounds: {field.name} must be finite with low ≤ high, found ({low}, "
                    f"{high})",
                    key=field.name,
                )
        if self.tension[0] <= 0 or self.tension_sd[0] < 0 or self.concentration[0] <= 0:
            raise ConfigError(
                "wrench bounds: tension and concentration must be positive, tension_sd not negative"
            )


def systems_at(bounds: Bounds, points: np.ndarray) -> CableSystem:
    """The systems at ``points`` (4, ..., m) of the unit cube: a point's four coordinates are T̲,
    θ̲, σ_T and κ as shares of their ranges.
    """
    ranges = {field.name: getattr(bounds, field.name) for field in fields(bounds)}
    return CableSystem(
        **{
            name: low + (high - low) * share
            for (name, (low, high)), share in zip(ranges.items(), points, strict=True)
        }
    )


def draw_systems(
    bounds: Bounds, systems: int, agents: int, rng: np.random.Generator
) -> CableSystem:
    """``systems`` cable systems of ``agents`` cables within ``bounds``; every field (systems,
    agents).
    """
    return systems_at(bounds, rng.random((len(fields(bounds)), systems, agents)))
