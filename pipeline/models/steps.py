"""Recorded steps of a motion, their variances, and the result of an estimator.

Standard deviations of two models are compared at an equal level, since the model with less noise in
total has the smaller error where noise is missed. A model's level is its own parameter (σ_B; α
under a fixed u; a factor on a covariance), which ``with_trace`` solves for.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.arm.interface import Chain
from pipeline.core.errors import ModelDomainError
from pipeline.models import kinds
from pipeline.models.model import MotionModel
from pipeline.models.noise import measurement_covariance


@dataclass(frozen=True)
class Recorded:
    """Recorded steps of one motion of n joints and m task rows, the data of every estimator."""

    chain: Chain
    q: ndarray  # (takes, M, n) rad, measured pose before each step
    # (M, m) or (M, m + n), commands (pipeline.models.model); of a closed loop one for each take
    v: ndarray
    noise: ndarray  # (takes, M, n) rad, ω of each step
    joints: tuple[str, ...]  # names of the joints, base to tip
    known_measurement: ndarray | None = None  # (n, n) rad², where Σ_m is known

    @cached_property
    def measurement(self) -> ndarray:
        """(n, n) Σ_m in rad², the noise of a step at rest where it is not known; raises
        ModelDomainError where the motion never rests.
        """
        if self.known_measurement is not None:
            return self.known_measurement
        return measurement_covariance(self.noise, self.v)

    @property
    def q_next(self) -> ndarray:
        """(takes, M, n) rad, measured pose after each step."""
        return self.q + self.chain.nominal_step(self.q, self.v) + self.noise

    def subset(self, takes: ndarray) -> "Recorded":
        """The takes with these numbers, as often as each is named."""
        v = self.v if self.v.ndim == 2 else self.v[takes]
        return replace(self, q=self.q[takes], v=v, noise=self.noise[takes])


@dataclass(frozen=True)
class Estimate:
    """Result of an estimator."""

    # of the model, plain values, as :func:`pipeline.models.kinds.build_model` takes them
    parameters: dict[str, Any]
    estimates: dict[str, float]  # by name and unit: what a standard error can be given to
    diagnostics: dict[str, float]  # how the estimate came about
    details: Any = None  # the fit itself, where more than its parameters is needed
    # numbers of the takes → the estimates of these takes, where that is quicker than another fit
    from_takes: Callable[[ndarray], dict[str, float]] | None = None
    undetermined: tuple[str, ...] = ()  # estimates at an end of their search, without an interval

    @property
    def model(self) -> MotionModel:
        """The model with these parameters."""
        return kinds.build_model(self.parameters)


class Truth(NamedTuple):
    """Known parameters of a model, and their values by the names of an estimator's estimates."""

    label: str
    parameters: dict[str, Any]
    values: dict[str, float]


def moving_steps(recorded: Recorded) -> tuple[ndarray, ndarray, ndarray]:
    """Poses (N, n), commands (N, m) or longer and ω (N, n) of the steps with a command; raises
    ModelDomainError for a motion at rest throughout.
    """
    q, v, noise = recorded.q, recorded.v, recorded.noise
    commanded = np.broadcast_to(v, (*q.shape[:-1], v.shape[-1]))
    moving = np.any(commanded, axis=-1)
    if not np.any(moving):
        message = "the motion is at rest at every step: there is nothing to fit a matrix model to"
        raise ModelDomainError(message)
    return q[moving], commanded[moving], noise[moving]


def take_variances(recorded: Recorded) -> Callable[[ndarray], tuple[ndarray, float]]:
    """Function of the numbers of any takes, as often as each is named: traces (M,) of their sample
    covariance of ω at each step and the trace of the measurement noise, in rad².

    Raises ModelDomainError where the measurement noise is not known; the function for a single take
    and where no variance is left to the motion.
    """
    known, _ = recorded.known_measurement, recorded.measurement  # raises
    still = ~np.any(recorded.v, axis=-1)  # of which the measurement noise is taken if not known
    noise = (recorded.noise - recorded.noise.mean(axis=0)).reshape(len(recorded.noise), -1)

    def of_takes(takes: ndarray) -> tuple[ndarray, float]:
        counts = np.bincount(takes, minlength=len(noise)).astype(float)
        different = int(np.count_nonzero(counts))
        if different < 2:
            message = "a sample covariance needs at least two takes"
            raise ModelDomainError(message, takes=different)
        sums = counts @ noise**2 - (counts @ noise) ** 2 / len(takes)
        traces = (sums / (len(takes) - 1)).reshape(recorded.noise.shape[1], -1).sum(axis=-1)
        measured = float(traces[still].mean() if known is None else np.trace(known))
        mean = float(traces.mean())
        if not mean > measured:
            raise ModelDomainError(
                "the variance of the recorded process noise is not above that of the measurement "
                "noise (sums over the joints); record faster motions or more takes",
                recorded_trace_rad2=mean,
                measurement_trace_rad2=measured,
            )
        return traces, measured

    return of_takes


def at_recorded_level(model: MotionModel, recorded: Recorded) -> MotionModel:
    """The model whose level makes the mean trace of the covariance of a step plus the trace of the
    measurement noise equal to the recorded one. Raises SingularJacobianError, and ModelDomainError
    as :func:`take_variances` and where no level of the model has the trace.
    """
    traces, measured = take_variances(recorded)(np.arange(len(recorded.q)))
    level = float(traces.mean()) - measured
    return model.with_trace(recorded.chain, recorded.q, recorded.v, level)
