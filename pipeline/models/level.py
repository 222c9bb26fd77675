"""The recorded level of noise, and motion models at it.

Spreads of two models over time or over joints can be compared at an equal level alone: whichever
has less noise in total has the smaller error where noise is missed. A model's level is its own
parameter (σ_B; α under a fixed u; a factor on a covariance), which each model's ``with_trace``
solves for.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.errors import ModelDomainError
from pipeline.models.model import MotionModel
from pipeline.models.noise import mean_covariance
from pipeline.models.steps import Recorded


def recorded_trace(recorded: Recorded) -> float:
    """tr Σ̂_ω in rad², the mean over the steps of the trace of the sample covariance over the takes
    of the process noise, which holds the measurement noise; raises ModelDomainError for a single
    take.
    """
    return float(np.trace(mean_covariance(recorded.noise)))


def trace_of_motion(recorded: Recorded) -> float:
    """The :func:`recorded_trace` without that of the measurement noise, in rad².

    Raises ModelDomainError where it is not positive, and where the measurement noise is not known.
    """
    whole, measured = recorded_trace(recorded), float(np.trace(recorded.measurement))
    if not whole > measured:
        raise ModelDomainError(
            "the variance of the recorded process noise is not above that of the measurement noise "
            "(sums over the joints): it tells nothing of the motion's own noise; record faster "
            "motions or more takes",
            recorded_trace_rad2=whole,
            measurement_trace_rad2=measured,
        )
    return whole - measured


def model_trace(model: MotionModel, recorded: Recorded) -> float:
    """Mean over the takes and steps of ``recorded`` of the trace of the model's exact covariance of
    a step, in rad², the measurement noise not included.

    Raises SingularJacobianError, and ModelDomainError where the model has no covariance.
    """
    covariance = model.covariance(recorded.chain, recorded.q, recorded.v)
    return float(np.trace(covariance, axis1=-2, axis2=-1).mean())


def at_recorded_level(model: MotionModel, recorded: Recorded) -> MotionModel:
    """The same model, its level solved again so that :func:`model_trace` and the trace of the
    measurement noise sum to the :func:`recorded_trace`.

    ``model`` need have no covariance itself: a Wishart model of σ_B beyond its limit has one at the
    recorded level. Raises SingularJacobianError, and ModelDomainError where the recorded trace is
    not above that of the measurement noise, where that noise is not known, where the model has no
    noise at any step, and where σ_B would be at the limit sqrt((m + 1)/(m + 3)).
    """
    return model.with_trace(recorded.chain, recorded.q, recorded.v, trace_of_motion(recorded))
