"""Recorded steps of a motion with their process noise; options and result of an estimator.

Standard deviations of two models are compared at equal total variance; otherwise the model with
less total noise would have the smaller error. ``with_trace`` solves for the parameter that sets a
model's noise level (σ_B; α at a fixed u; a factor on a covariance).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.arm.chain import Chain
from pipeline.core import validation
from pipeline.core.errors import ModelDomainError
from pipeline.models.kinds import build_model
from pipeline.models.model import MotionModel
from pipeline.statistics.takes import takes_moments

UNBOUNDED_KEY = "u_unbounded"  # diagnostic: 1 where û is at the end of its search


@validation.options()
class Options:
    """Base of the options of a model; the ``fit.py`` of each kind has a subclass of this name."""

    kind: str  # the model's folder in pipeline/models
    closed_loop: bool = True  # whether the closed-loop form is fitted and filtered too


@dataclass(frozen=True)
class Recorded:
    """Recorded steps of one motion of n joints and m task rows, the data of every estimator."""

    chain: Chain
    q: ndarray  # (takes, M, n) rad, measured pose before each step
    # commands (pipeline.models.model), (M, m) or (M, m + n); in a closed loop (takes, M, …)
    v: ndarray
    noise: ndarray  # (takes, M, n) rad, ω of each step
    joints: tuple[str, ...]  # names of the joints, base to tip
    known_measurement: ndarray | None = None  # (n, n) rad², Σ_m if it is known
    rate: float | None = None  # steps per second, for laws with a memory

    @cached_property
    def measurement(self) -> ndarray:
        """(n, n) Σ_m in rad²: the known one, else the covariance of the noise at rest. Raises
        ModelDomainError if Σ_m is unknown and the motion never rests.
        """
        if self.known_measurement is not None:
            return self.known_measurement
        return measurement_covariance(self.noise, self.v)

    @property
    def q_next(self) -> ndarray:
        """(takes, M, n) rad, measured pose after each step."""
        return self.q + self.chain.nominal_step(self.q, self.v) + self.noise

    @property
    def poses(self) -> ndarray:
        """(takes, M+1, n) rad, measured poses before and after the steps."""
        return np.concatenate([self.q, self.q_next[:, -1:]], axis=1)

    def subset(self, takes: ndarray) -> "Recorded":
        """Return the takes with the indices ``takes``; a repeated index repeats the take."""
        v = self.v if self.v.ndim == 2 else self.v[takes]
        return replace(self, q=self.q[takes], v=v, noise=self.noise[takes])


@dataclass(frozen=True)
class Estimate:
    """Result of an estimator."""

    # plain values for :func:`pipeline.models.kinds.build_model`
    parameters: dict[str, Any]
    estimates: dict[str, float]  # parameters with a standard error, by name and unit
    diagnostics: dict[str, float]
    # the fit itself, for diagnostics that need more than its parameters
    details: Any = None
    # take indices → estimates of these takes, if that is faster than another fit
    from_takes: Callable[[ndarray], dict[str, float]] | None = None
    undetermined: tuple[str, ...] = ()  # estimates at an end of the search

    @property
    def determined(self) -> dict[str, float]:
        """Estimates without the undetermined ones, which have no number."""
        determined = dict(self.estimates)
        for name in self.undetermined:
            del determined[name]
        return determined

    def named(self, pattern: str, errors: Mapping[str, float]) -> dict[str, float]:
        """Return the determined estimates, their standard ``errors`` and the mark of an unbounded
        one, each parameter named by the estimator's ``pattern``: ``u_unbounded`` becomes
        ``u_paper_unbounded`` by ``{}_paper``.
        """
        numbers = self.determined | dict(errors)
        if UNBOUNDED_KEY in self.diagnostics:
            numbers[UNBOUNDED_KEY] = self.diagnostics[UNBOUNDED_KEY]
        named = {}
        for name, number in numbers.items():
            parameter = next(base for base in self.estimates if name.startswith(base))
            suffix = name.removeprefix(parameter)
            named[pattern.format(parameter) + suffix] = number
        return named

    @property
    def model(self) -> MotionModel:
        """Model with these parameters."""
        return build_model(self.parameters)


class Truth(NamedTuple):
    """Known parameters of a model, and their values by the names of an estimator's estimates."""

    label: str
    parameters: dict[str, Any]
    values: dict[str, float]


def process_noise(chain: Chain, q: ndarray, command: ndarray) -> ndarray:
    """(takes, M, n) noise ω_{k+1} = q̃_{k+1} − q̃_k − J(q̃_k)⁻¹ẋᵈ_kΔt in rad of measured joint
    angles ``q`` (takes, M+1, n) in rad under ``command`` (M, m) or (M, m + n).

    The sign is measured minus nominal, as in (InvDiffRndm) and (Omegk); (OmgReal) prints the
    opposite sign. Raises SingularJacobianError.
    """
    chain.require_regular(q[:, :-1], what="measured pose")
    return q[:, 1:] - (q[:, :-1] + chain.nominal_step(q[:, :-1], command))


def mean_covariance(noise: ndarray) -> ndarray:
    """(n, n) Σ̂_ω = (1/M) Σ_k Σ̂_k in rad², Σ̂_k the covariance of ``noise`` ω (takes, M, n)."""
    return takes_moments(noise)[1].mean(axis=0)


def measurement_covariance(noise: ndarray, v: ndarray) -> ndarray:
    """(n, n) Σ_m in rad²: mean sample covariance of ``noise`` ω (takes, M, n) at the steps without
    a command in ``v`` (M, m) or (M, m + n). At rest ω is the difference of the noise of two
    measured poses. Raises ModelDomainError for a motion without rest or a single take.
    """
    still = ~np.any(v, axis=-1)
    if not np.any(still):
        message = "the motion never rests: measurement noise cannot be separated from motion noise"
        raise ModelDomainError(message, steps=len(v))
    return mean_covariance(noise[:, still])


def recorded_deviation(q: ndarray, noise: ndarray, mode: str) -> ndarray:
    """(M+1, n) standard deviation over the takes in rad: in mode ``one_step`` of ``noise`` ω
    (takes, M, n), zero at k = 0; in ``free_running`` of the angles ``q`` (takes, M+1, n).
    """
    if mode == "one_step":
        return np.vstack([np.zeros((1, q.shape[-1])), noise.std(axis=0, ddof=1)])
    return q.std(axis=0, ddof=1)


def moving_steps(recorded: Recorded) -> tuple[ndarray, ndarray, ndarray]:
    """Poses (N, n), commands (N, m) or (N, m + n) and ω (N, n) of the steps with a command; raises
    ModelDomainError for a motion at rest at every step.
    """
    q = recorded.q
    v = recorded.v
    noise = recorded.noise
    commanded = np.broadcast_to(v, (*q.shape[:-1], v.shape[-1]))
    moving = np.any(commanded, axis=-1)
    if not np.any(moving):
        message = "the motion is at rest at every step: there is nothing to fit a matrix model to"
        raise ModelDomainError(message)
    return q[moving], commanded[moving], noise[moving]


def take_variances(recorded: Recorded) -> Callable[[ndarray], tuple[ndarray, float]]:
    """Return a function of take indices. It returns the traces (M,) of the takes' sample covariance
    of ω at each step, and the trace of the measurement covariance, in rad².

    Raises ModelDomainError if the measurement noise is unknown. The returned function raises it for
    a single take, and if the total variance is not above the measurement variance.
    """
    _ = recorded.measurement  # raises
    measurement = recorded.known_measurement
    still = ~np.any(recorded.v, axis=-1)
    centred = recorded.noise - recorded.noise.mean(axis=0)
    noise = centred.reshape(len(centred), -1)

    def of_takes(takes: ndarray) -> tuple[ndarray, float]:
        counts = np.bincount(takes, minlength=len(noise)).astype(float)
        different = int(np.count_nonzero(counts))
        if different < 2:
            message = "a sample covariance needs at least two takes"
            raise ModelDomainError(message, takes=different)
        sums = counts @ noise**2 - (counts @ noise) ** 2 / len(takes)
        variances = sums / (len(takes) - 1)
        traces = variances.reshape(centred.shape[1], -1).sum(axis=-1)
        if measurement is None:
            measured = float(traces[still].mean())
        else:
            measured = float(np.trace(measurement))
        mean = float(traces.mean())
        if not mean > measured:
            raise ModelDomainError(
                "the recorded process noise does not exceed the measurement noise in variance "
                "(sums over the joints); record faster motions or more takes",
                recorded_trace_rad2=mean,
                measurement_trace_rad2=measured,
            )
        return traces, measured

    return of_takes


def at_recorded_level(model: MotionModel, recorded: Recorded) -> MotionModel:
    """Return the model at the noise level where the mean trace of a step's covariance plus the
    trace of the measurement covariance equals the recorded trace. Raises SingularJacobianError, and
    ModelDomainError as :func:`take_variances` and for a trace that no level gives.
    """
    traces, measured = take_variances(recorded)(np.arange(len(recorded.q)))
    level = float(traces.mean()) - measured
    return model.with_trace(recorded.chain, recorded.q, recorded.v, level)
