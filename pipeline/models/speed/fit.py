"""Fit of the speed law by likelihood, joint by joint, with the measurement noise added."""

from collections.abc import Sequence

import numpy as np
from numpy import ndarray

from pipeline.core import validation
from pipeline.models import steps as base
from pipeline.models.steps import Estimate, Recorded, Truth

LEAST_VARIANCE = 1e-9  # of a step without noise, relative to the joint's mean square


@validation.options(kw_only=True)
class Options(base.Options):
    """Options of the speed law: only those of every model."""


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """Estimate a_j and b_j by the greatest likelihood of ω_j ~ N(0, a_j + b_jΔ_j² + Σ_m,jj); raises
    ModelDomainError if the measurement noise is unknown.
    """
    measured = np.diagonal(recorded.measurement)
    steps = recorded.chain.nominal_step(recorded.q, recorded.v)
    joints = range(recorded.noise.shape[-1])
    fits = []
    for j in joints:
        noise = recorded.noise[..., j]
        steps_of_joint = steps[..., j]
        fits.append(greatest_likelihood(noise, steps_of_joint, measured[j]))
    rest, growth = np.transpose(fits)
    estimates = {f"rest_variance_{j + 1}_rad2": rest[j] for j in joints}
    estimates |= {f"growth_{j + 1}": growth[j] for j in joints}
    parameters = {
        "kind": "speed",
        "rest_variance": rest.tolist(),
        "growth": growth.tolist(),
    }
    return Estimate(parameters, estimates, {})


def greatest_likelihood(
    noise: ndarray,
    steps: ndarray,
    measured: float,
) -> tuple[float, float]:
    """Return a ≥ 0 in rad² and b ≥ 0 of greatest likelihood of ``noise`` in rad under N(0, a + bΔ²
    + ``measured``), Δ the ``steps`` in rad; zeros for a joint without noise.
    """
    from scipy.optimize import minimize

    squares = np.ravel(noise**2)
    speeds = np.ravel(steps**2)
    unit = squares.mean()
    if not unit > 0:
        return 0.0, 0.0
    scale = max(speeds.mean(), np.finfo(float).tiny)
    squares = squares / unit
    speeds = speeds / scale

    def loss(parameters: ndarray) -> tuple[float, ndarray]:
        variances = parameters[0] + parameters[1] * speeds
        value = np.mean(np.log(variances) + squares / variances)
        slopes = (1 - squares / variances) / variances
        return value, np.array([slopes.mean(), np.mean(slopes * speeds)])

    least = max(measured / unit, LEAST_VARIANCE)
    ends = [(least, None), (0.0, None)]
    minima = [
        minimize(loss, start, jac=True, bounds=ends, method="L-BFGS-B")
        for start in ((max(least, 1.0), 0.01), (least, 1.0))
    ]
    rest, growth = min(minima, key=lambda minimum: minimum.fun).x
    return max(rest * unit - measured, 0.0), growth * unit / scale


def truths(
    recorded: Recorded,
    options: Options,
    dispersions: Sequence[float],
) -> list[Truth]:
    """Return the recorded variances as the known parameters."""
    fitted = estimate(recorded, options)
    return [Truth("speed", fitted.parameters, fitted.estimates)]
