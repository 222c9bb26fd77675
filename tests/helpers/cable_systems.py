"""Planar cable systems by their angles, and wrenches by samplers of their own."""

import numpy as np

from pipeline.wrench.models import CableSystem


def planar_cables(tension, angle, tension_sd, concentration) -> CableSystem:
    """Return the system whose cables point along ``angle`` θ̲ (..., m) in rad."""
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return CableSystem(tension, direction, tension_sd, concentration)


def directions_about(
    mean: np.ndarray, concentration: float, samples: int, rng: np.random.Generator
) -> np.ndarray:
    """(samples, p) unit vectors about ``mean`` (p,): an angle of the von Mises law in the plane, in
    space the inverse distribution function of eᵀe̲ and a uniform angle about it.
    """
    if len(mean) == 2:
        angle = rng.vonmises(0.0, concentration, samples) + np.arctan2(mean[1], mean[0])
        return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    u, turn = rng.random(samples), rng.uniform(0, 2 * np.pi, samples)
    along = 1 + np.log(u + (1 - u) * np.exp(-2 * concentration)) / concentration
    first = np.cross(mean, [1.0, 0.0, 0.0] if abs(mean[0]) < 0.7 else [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    across = np.outer(np.cos(turn), first) + np.outer(np.sin(turn), np.cross(mean, first))
    return along[:, None] * mean + np.sqrt(1 - along**2)[:, None] * across


def sample_wrench(system: CableSystem, samples: int, rng: np.random.Generator) -> np.ndarray:
    """``samples`` independent wrenches of one ``system``, (samples, n): Eq. (WrenchStatEq) in the
    plane, f and r × f in space; forces alone where the cables meet in one point.
    """
    force, moment = 0.0, 0.0
    for i in range(len(system.tension)):
        tension = rng.normal(system.tension[i], system.tension_sd[i], (samples, 1))
        pull = tension * directions_about(
            system.direction[i], system.concentration[i], samples, rng
        )
        force = force + pull
        if system.attachment is not None:
            r = system.attachment[i]
            planar = system.dimension == 2
            turned = r[0] * pull[:, 1:] - r[1] * pull[:, :1] if planar else np.cross(r, pull)
            moment = moment + turned
    return force if system.attachment is None else np.concatenate([force, moment], axis=-1)
