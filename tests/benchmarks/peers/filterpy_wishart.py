"""The take filtered with `filterpy`, which has the resampling and leaves the filter to its user."""

from __future__ import annotations

import numpy as np
from filterpy.monte_carlo import systematic_resample
from wishart_take import take_of

CONFIGURATION = (
    "the law of a step in NumPy, all particles at once; weights and moments in NumPy as its "
    "book writes them, resampled by its `systematic_resample` below half of the effective "
    "sample size"
)


def setup(count, **told):
    take = take_of(**told)

    def call() -> list:
        q, weights, means = take.start(count), np.full(count, 1 / count), []
        for k in range(len(take.steps) + 1):
            if k > 0:
                q = take.step(k, q)
            if k in take.y:
                weights = weights * np.exp(take.log_likelihood(k, q))
                weights /= weights.sum()
            means.append(np.average(q, weights=weights, axis=0).tolist())
            np.cov(q, rowvar=False, aweights=weights)
            if 1 / np.sum(weights**2) < count / 2:
                q, weights = q[systematic_resample(weights)], np.full(count, 1 / count)
        return means

    return call
