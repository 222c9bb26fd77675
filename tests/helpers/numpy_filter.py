"""The particle filter in plain NumPy, drawing from the same stream: an oracle. Indices alone are
chosen by compiled code, whose counts have tests of their own.
"""

import numpy as np
from compiled_calls import chosen_by
from numpy_laws import plain_steps

from pipeline.core.errors import DegenerateFilterError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Posterior, initial_particles


def plain_filter(
    model,
    chain,
    commands,
    dt,
    start,
    measurements,
    options,
    rng,
) -> Posterior:
    """Arguments and result of :func:`pipeline.filtering.particle_filter.particle_filter`."""
    grid = len(commands.v) + 1
    count = options.particles
    frame, step, share = measurements.schedule(len(commands.v), dt)
    left_out = len(measurements.t) - len(frame)
    mean = np.empty((grid, 3))
    covariance = np.empty((grid, 3, 3))
    ess = np.empty(grid)
    resampled, measured = np.zeros((2, grid), dtype=bool)
    clipped, outside = np.zeros((2, grid), dtype=int)

    uniform = np.full(count, 1.0 / count)
    log_uniform = np.log(uniform)
    weights = uniform
    log_weights = log_uniform
    q, outside[0] = initial_particles(start, chain, count, rng, measurements.take)
    before = q
    for k in range(grid):
        if k > 0:
            before = q
            off = chain.displacement(chain.pose(before), commands.path[k - 1])
            v = commands.v[k - 1] + commands.share * off
            q, clipped[k] = plain_steps(model, chain, before, v, rng)
            gone = ~chain.within_limits(q) | chain.singular(q)
            outside[k] = np.sum(gone & (log_weights > -np.inf))
            log_weights = np.where(gone, -np.inf, log_weights)
            q = np.where(gone[:, None], before, q)

        measured[k] = np.any(step == k)
        for j in np.flatnonzero(step == k):
            pose = before + share[j] * (q - before)
            log_weights = log_weights + log_likelihood(measurements, frame[j], pose)
        if measured[k] or outside[k]:
            peak = log_weights.max()
            if not np.isfinite(peak):
                raise DegenerateFilterError("all weights vanished", step=k)
            weights = np.exp(log_weights - peak)
            log_total = peak + np.log(weights.sum())
            weights = weights / weights.sum()
            log_weights = log_weights - log_total

        mean[k] = weights @ q
        covariance[k] = (weights * (q - mean[k]).T) @ (q - mean[k])
        ess[k] = 1.0 / (weights @ weights)
        if options.scheme != "none" and ess[k] < options.threshold * count:
            q = q[chosen_by(options.scheme, weights, rng)]
            weights = uniform
            log_weights = log_uniform
            resampled[k] = True
    return Posterior(
        mean,
        covariance,
        ess,
        resampled,
        clipped,
        outside,
        measured,
        left_out,
    )


def log_likelihood(measurements: Measurements, frame: int, q: np.ndarray) -> np.ndarray:
    """(P,) log p(y_j | q) + constant of poses ``q`` (P, 3) in rad at the time of ``frame``."""
    deviation = measurements.y[frame] - measurements.bias[frame] - q
    white = deviation @ measurements.whitening[frame].T
    return -0.5 * np.vecdot(white, white)
