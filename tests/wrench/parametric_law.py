"""Mean and draws of the parametric force model, which the matrix model is tested against."""

from __future__ import annotations

import numpy as np

from pipeline.wrench.parametric import CableSystem, mean_resultant_length


def force_mean(system: CableSystem) -> np.ndarray:
    """E[F] = Σᵢ A(κᵢ)·T̲ᵢ·(cos θ̲ᵢ, sin θ̲ᵢ) in N, (..., 2): shorter than the nominal force S̲T̲ by
    the spread of the directions.
    """
    pull = mean_resultant_length(system.concentration) * system.tension
    return np.stack(
        [
            np.sum(pull * np.cos(system.direction), axis=-1),
            np.sum(pull * np.sin(system.direction), axis=-1),
        ],
        axis=-1,
    )


def sample_forces(system: CableSystem, samples: int, rng: np.random.Generator) -> np.ndarray:
    """``samples`` independent forces of the parametric model in N, (samples, ..., 2).

    The forces of Eq. (WrenchStatEq) with directions of Eq. (vMis); cables that meet in one point
    have no moment.
    """
    shape = (samples, *system.tension.shape)
    tension = rng.normal(system.tension, system.tension_sd, shape)
    direction = rng.vonmises(np.zeros(shape), system.concentration) + system.direction
    return np.stack(
        [
            np.sum(tension * np.cos(direction), axis=-1),
            np.sum(tension * np.sin(direction), axis=-1),
        ],
        axis=-1,
    )
