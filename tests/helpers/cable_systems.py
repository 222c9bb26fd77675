"""Planar cable systems by their angles, and wrenches by SciPy's sampler of directions."""

import numpy as np
from scipy.stats import vonmises_fisher

from pipeline.wrench.models import CableSystem


def planar_cables(tension, angle, tension_sd, concentration) -> CableSystem:
    """Return the system whose cables point along ``angle`` θ̲ (..., m) in rad."""
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return CableSystem(tension, direction, tension_sd, concentration)


def sample_wrench(
    system: CableSystem,
    samples: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """``samples`` independent wrenches of one ``system``, (samples, n): Eq. (WrenchStatEq) in the
    plane, f and r × f in space; forces alone where the cables meet in one point.
    """
    force = 0.0
    moment = 0.0
    for i in range(len(system.tension)):
        tension = rng.normal(system.tension[i], system.tension_sd[i], (samples, 1))
        cable = vonmises_fisher(system.direction[i], system.concentration[i], seed=rng)
        pull = tension * cable.rvs(samples)
        force = force + pull
        if system.attachment is not None:
            moment = moment + moment_of(pull, system.attachment[i])
    if system.attachment is None:
        return force
    return np.concatenate([force, moment], axis=-1)


def moment_of(pull: np.ndarray, r: np.ndarray) -> np.ndarray:
    """(samples, 1) or (samples, 3) moments of forces (samples, 2) or (samples, 3) at ``r``."""
    if len(r) == 2:
        x = pull[:, :1]
        y = pull[:, 1:]
        return r[0] * y - r[1] * x
    return np.cross(r, pull)
