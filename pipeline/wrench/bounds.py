"""What alone is known of a cable system in the study: bounds, within which its values are uniform
and independent.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Wrench
from pipeline.wrench.parametric import CableSystem


@dataclass(frozen=True)
class Bounds:
    """(low, high) of what characterises a cable; a system draws each cable's values independently
    within them, uniformly: in space the directions on the sphere.

    Systems are planar unless there is an ``elevation``, and their cables meet in one point unless
    there is an ``attachment``. Raises ConfigError for bounds that bound no system.
    """

    tension: tuple[float, float]  # T̲, N
    direction: tuple[float, float]  # θ̲, rad, in the plane of the first two axes
    tension_sd: tuple[float, float]  # σ_T, N
    concentration: tuple[float, float]  # κ (the paper's σ_θ)
    elevation: tuple[float, float] | None = None  # rad, of a cable above that plane
    attachment: tuple[float, float] | None = None  # m, each coordinate of r

    def __post_init__(self) -> None:
        for field in fields(self):
            if (bounds := getattr(self, field.name)) is None:
                continue
            low, high = bounds
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
        if self.elevation is not None and np.any(np.abs(self.elevation) > np.pi / 2):
            raise ConfigError("wrench bounds: must lie within ±π/2", key="elevation")

    @property
    def dimension(self) -> int:
        """p: 2 in the plane, 3 in space."""
        return 2 if self.elevation is None else 3

    @property
    def coordinates(self) -> int:
        """Numbers that a cable is drawn by."""
        return self.dimension + 2 + (0 if self.attachment is None else self.dimension)

    def directions(self, angle: np.ndarray, height: np.ndarray | None = None) -> np.ndarray:
        """Unit vectors (..., p) at the shares ``angle`` and ``height``, in space, of the bounds:
        equal shares are equal arcs or areas.
        """
        theta = within(self.direction, angle)
        plane = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
        if self.elevation is None:
            return plane
        up = within(tuple(np.sin(self.elevation)), height)
        return np.concatenate([np.sqrt(1 - up**2)[..., None] * plane, up[..., None]], axis=-1)


def study_bounds(options: Wrench) -> Bounds:
    """The bounds of the paper's numerical study."""
    return Bounds(
        tuple(options.tension),
        tuple(options.direction),
        tuple(options.tension_std),
        tuple(options.kappa),
    )


def within(range_: tuple[float, float], share: np.ndarray) -> np.ndarray:
    """The values at ``share`` of a range (low, high), any shape."""
    low, high = range_
    return low + (high - low) * share


def systems_at(bounds: Bounds, points: np.ndarray) -> CableSystem:
    """The systems at ``points`` (coordinates, ..., m) of the unit cube: T̲, θ̲, σ_T and κ as shares
    of their ranges, then in space the height, then the p coordinates of the attachment.
    """
    tension, angle, tension_sd, concentration, *rest = points
    height = rest.pop(0) if bounds.elevation else None
    return CableSystem(
        within(bounds.tension, tension),
        bounds.directions(angle, height),
        within(bounds.tension_sd, tension_sd),
        within(bounds.concentration, concentration),
        within(bounds.attachment, np.stack(rest, axis=-1)) if bounds.attachment else None,
    )


def draw_systems(
    bounds: Bounds, systems: int, agents: int, rng: np.random.Generator
) -> CableSystem:
    """``systems`` cable systems of ``agents`` cables within ``bounds``; tensions (systems,
    agents).
    """
    return systems_at(bounds, rng.random((bounds.coordinates, systems, agents)))
