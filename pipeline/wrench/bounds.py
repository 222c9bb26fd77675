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


@dataclass(frozen=True)
class Bounds:
    """(low, high) of the values of a cable, which a system draws uniformly for each cable: in space
    the directions uniformly on the sphere.

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
        lowest = {"tension": np.nextafter(0, 1), "concentration": np.nextafter(0, 1)}
        lowest |= {"tension_sd": 0.0, "elevation": -np.pi / 2}
        for name, bounds in vars(self).items():
            least, most = lowest.get(name, -np.inf), np.pi / 2 if name == "elevation" else np.inf
            if bounds is not None and not least <= bounds[0] <= bounds[1] <= most:
                raise ConfigError(
                    f"wrench bounds: {name} must be {least:.3g} ≤ low ≤ high ≤ {most:.3g}, got "
                    f"{bounds[0]}, {bounds[1]}",
                    key=name,
                )
            if bounds is not None and not np.all(np.isfinite(bounds)):
                raise ConfigError(f"wrench bounds: {name} must be finite, got {bounds}", key=name)

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


def within(range_: tuple[float, float], share: np.ndarray) -> np.ndarray:
    """Values at ``share`` of a range (low, high), any shape."""
    low, high = range_
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
    """``systems`` cable systems of ``agents`` cables within ``bounds``."""
    return systems_at(bounds, rng.random((bounds.coordinates, systems, agents)))


def study_bounds(options: Wrench) -> Bounds:
    """Bounds of the paper's numerical study."""
    ranges = (options.tension, options.direction, options.tension_std, options.kappa)
    return Bounds(*map(tuple, ranges))


def configuration_bounds(force: Force, configuration: Arrangement) -> Bounds:
    """Bounds of the class that ``configuration`` belongs to; attachments as multiples of the
    characteristic length.
    """
    elevation, attachment = configuration.elevation_bounds, configuration.attachment_bounds
    return Bounds(
        tuple(force.tension_bounds),
        tuple(configuration.direction_bounds),
        tuple(force.tension_std_bounds),
        tuple(force.kappa_bounds),
        None if elevation is None else tuple(elevation),
        None if attachment is None else tuple(np.divide(attachment, force.length)),
    )


def nominal_system(force: Force, configuration: Arrangement) -> CableSystem:
    """The system of ``configuration`` at its means, its attachments as multiples of the
    characteristic length.

    The matrix model knows no law of the directions: the concentration is given and does not enter
    it. Raises ConfigError where robots have no standard deviation of their tension.
    """
    agents, azimuth = len(configuration.tension), np.array(configuration.direction)
    if len(force.tension_std) < agents:
        raise ConfigError(
            f"tension_std: {len(force.tension_std)} values for the {agents} robots of "
            f"{configuration.file}",
            key="dataset.force.tension_std",
        )
    direction = [np.cos(azimuth), np.sin(azimuth)]
    if (elevation := configuration.elevation) is not None:
        direction = [*(np.cos(elevation) * part for part in direction), np.sin(elevation)]
    return CableSystem(
        configuration.tension,
        np.stack(direction, axis=-1),
        force.tension_std[:agents],
        np.full(agents, force.kappa_bounds[0]),
        configuration.attachment,
    ).in_units_of(force.length)
