"""The particle filter of `pfilter` on the take."""

from __future__ import annotations

import numpy as np
from pfilter import ParticleFilter, systematic_resample
from wishart_take import take_of

CONFIGURATION = (
    "the law of a step in NumPy, all particles at once; `ParticleFilter` with its "
    "`systematic_resample` below half of the effective sample size, noise within the "
    "dynamics, observations by identity"
)


def setup(count, **told):
    take = take_of(**told)

    def call() -> list:
        filtered = ParticleFilter(
            prior_fn=take.start,
            dynamics_fn=lambda q, k: take.step(k, q) if k > 0 else q,
            noise_fn=lambda q, k: q,
            observe_fn=lambda q, k: q,
            weight_fn=lambda q, y, k: np.exp(take.log_likelihood(k, q)),
            resample_fn=systematic_resample,
            n_particles=count,
            n_eff_threshold=0.5,
        )
        means = []
        for k in range(len(take.steps) + 1):
            filtered.update(take.y.get(k), k=k)
            means.append(filtered.mean_state.tolist())
        return means

    return call
