"""Bounds within which the values of a cable system are uniform and independent, from the options
of the study and of a configuration of the experiment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Wrench
from pipeline.core.options.instruments import Arrangement, Force
from pipeline.wrench.parametric import CableSystem

TINY = np.nextafter(0, 1)
LOWEST = {"tension": TINY, "concentration": TINY, "tension_sd": 0.0, "elevation": -np.pi / 2}


@dataclass(frozen=True)
class Bounds:
    """(low, high) of the values of a cable, uniform for each cable: in space the directions are
    uniform on the sphere.

    Systems are planar without an ``elevation``, and their cables meet in one point without an
    ``attachment``. Raises ConfigError for bounds that bound no system.
    """

    tension: tuple[float, float]  # T̲, N
    direction: tuple[float, float]  # θ̲, rad, in the plane of the first two axes
    tension_sd: tuple[float, float]  # σ_T, N
    concentration: tuple[float, float]  # κ (the paper's σ_θ)
    elevation: tuple[float, float] | None = None  # rad, of a cable above that plane
    attachment: tuple[float, float] | None = None  # m, each coordinate of r

    def __post_init__(self) -> None:
        for name, bounds in vars(self).items():
            least, most = LOWEST.get(name, -np.inf), np.pi / 2 if name == "elevation" else np.inf
            if bounds is None:
                continue
            if not (np.isfinite(bounds).all() and least <= bounds[0] <= bounds[1] <= most):
                limits = f"{least:.3g} ≤ low ≤ high ≤ {most:.3g}, got {bounds[0]}, {bounds[1]}"
                raise ConfigError(f"wrench bounds: {name} must be finite and {limits}", key=name)

    @property
    def dimension(self) -> int:
        """p: 2 in the plane, 3 in space."""
        return 2 if self.elevation is None else 3

    @property
    def coordinates(self) -> int:
        """Number of values of a cable."""
        return self.dimension + 2 + (0 if self.attachment is None else self.dimension)

    def directions(self, angle: np.ndarray, height: np.ndarray | None = None) -> np.ndarray:
        """Unit vectors (..., p) at the shares ``angle`` and, in space, ``height`` of the bounds:
        equal shares are equal arcs or areas.
        """
        theta = within(self.direction, angle)
        plane = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
        if self.elevation is None:
            return plane
        up = within(np.sin(self.elevation), height)[..., None]
        return np.concatenate([np.sqrt(1 - up**2) * plane, up], axis=-1)


def within(bounds: tuple[float, float], share: np.ndarray) -> np.ndarray:
    """Values at ``share`` of the range ``bounds``, any shape."""
    low, high = bounds
    return low + (high - low) * share


def systems_at(bounds: Bounds, points: np.ndarray) -> CableSystem:
    """Systems at ``points`` (coordinates, ..., m) of the unit cube: T̲, θ̲, σ_T and κ as shares
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
    """Draw ``systems`` cable systems of ``agents`` cables within ``bounds``."""
    return systems_at(bounds, rng.random((bounds.coordinates, systems, agents)))


def study_bounds(options: Wrench) -> Bounds:
    """Bounds of the paper's numerical study."""
    o = options
    return Bounds(*map(tuple, (o.tension, o.direction, o.tension_std, o.kappa)))


def configuration_bounds(force: Force, configuration: Arrangement) -> Bounds:
    """Bounds of the class of ``configuration``; attachments as multiples of the characteristic
    length.
    """
    elevation, attachment = configuration.elevation_bounds, configuration.attachment_bounds
    ranges = [force.tension_bounds, configuration.direction_bounds]
    ranges += [force.tension_std_bounds, force.kappa_bounds]
    attachment = None if attachment is None else tuple(np.divide(attachment, force.length))
    return Bounds(*map(tuple, ranges), elevation and tuple(elevation), attachment)


def nominal_system(force: Force, configuration: Arrangement) -> CableSystem:
    """The system of ``configuration`` at its means, its attachments as multiples of the
    characteristic length.

    The matrix model knows no law of the directions: the concentration is given and does not enter
    it. Raises ConfigError where robots have no standard deviation of their tension.
    """
    agents, azimuth = len(configuration.tension), np.array(configuration.direction)
    if len(force.tension_std) < agents:
        given = f"{len(force.tension_std)} values for the {agents} robots of {configuration.file}"
        raise ConfigError(f"tension_std: {given}", key="dataset.force.tension_std")
    direction = [np.cos(azimuth), np.sin(azimuth)]
    if (elevation := configuration.elevation) is not None:
        direction = [*(np.cos(elevation) * part for part in direction), np.sin(elevation)]
    direction, spread = np.stack(direction, axis=-1), force.tension_std[:agents]
    kappa = np.full(agents, force.kappa_bounds[0])
    attachment = configuration.attachment
    system = CableSystem(configuration.tension, direction, spread, kappa, attachment)
    return system.in_units_of(force.length)
