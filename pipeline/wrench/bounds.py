"""Bounds within which the values of a cable system are uniform and independent, from the options
of the study and of a configuration of the experiment.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Wrench
from pipeline.core.options.dataset import Arrangement, Force
from pipeline.wrench.parametric import CableSystem

LIMITS = dict.fromkeys(("tension", "tension_sd", "concentration"), (0.0, np.inf))
LIMITS["elevation"] = (-np.pi / 2, np.pi / 2)


@dataclass(frozen=True)
class Bounds:
    """(low, high) of the values of a cable, uniform and independent: planar without an
    ``elevation``, in space uniform on the sphere; the cables meet in one point without an
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
            if bounds is None:
                continue
            (low, high), (least, most) = bounds, LIMITS.get(name, (-np.inf, np.inf))
            if not (least <= low <= high <= most and np.isfinite(high - low)):
                limits = f"{least:.3g} ≤ low ≤ high ≤ {most:.3g}, got {low}, {high}"
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
        """Unit vectors (..., p) at the shares ``angle`` and, in space, ``height`` of the bounds."""
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
    """Systems at ``points`` (coordinates, ..., m) of the unit cube: T̲, θ̲, σ_T, κ, in space the
    height, and the p coordinates of the attachment as shares of their ranges.
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
    ranges = options.tension, options.direction, options.tension_std, options.kappa
    return Bounds(*map(tuple, ranges))


def configuration_bounds(force: Force, own: Arrangement) -> Bounds:
    """Bounds of the configuration ``own``; attachments over the characteristic length."""
    ranges = (force.tension_bounds, own.direction_bounds)
    ranges += (force.tension_std_bounds, force.kappa_bounds)
    place = own.attachment_bounds and tuple(np.divide(own.attachment_bounds, force.length))
    return Bounds(*map(tuple, ranges), own.elevation_bounds and tuple(own.elevation_bounds), place)


def nominal_system(force: Force, configuration: Arrangement) -> CableSystem:
    """The system of ``configuration`` at its means, attachments over the characteristic length;
    its concentration does not enter the matrix model. Raises ConfigError where robots have no
    standard deviation of their tension.
    """
    agents, azimuth = len(configuration.tension), np.array(configuration.direction)
    if len(force.tension_std) < agents:
        given = f"{len(force.tension_std)} values for the {agents} robots of {configuration.file}"
        raise ConfigError(f"tension_std: {given}", key="dataset.force.tension_std")
    direction = [np.cos(azimuth), np.sin(azimuth)]
    if (elevation := configuration.elevation) is not None:
        direction = [*(np.cos(elevation) * part for part in direction), np.sin(elevation)]
    kappa, place = np.full(agents, force.kappa_bounds[0]), configuration.attachment
    values = np.stack(direction, axis=-1), force.tension_std[:agents], kappa, place
    return CableSystem(configuration.tension, *values).in_units_of(force.length)
