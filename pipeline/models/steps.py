"""Recorded steps of a motion, and what an estimator makes of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.errors import ModelDomainError
from pipeline.models import kinds
from pipeline.models.model import MotionModel
from pipeline.models.noise import measurement_covariance


@dataclass(frozen=True)
class Recorded:
    """Recorded steps of one motion of n joints and m task rows: what every estimator is given."""

    chain: Chain
    q: np.ndarray  # (takes, M, n) rad, measured pose before each step
    # (M, m) or (M, m + n), commands (pipeline.models.commands); of a closed loop one for each take
    v: np.ndarray
    noise: np.ndarray  # (takes, M, n) rad, ω of each step
    joints: tuple[str, ...]  # names of the joints, base to tip
    known_measurement: np.ndarray | None = None  # (n, n) rad², where Σ_m is known

    @cached_property
    def measurement(self) -> np.ndarray:
        """(n, n) Σ_m in rad², the noise of a step at rest where it is not known; raises
        ModelDomainError where the motion never rests.
        """
        return (
            measurement_covariance(self.noise, self.v)
            if self.known_measurement is None
            else self.known_measurement
        )

    @property
    def q_next(self) -> np.ndarray:
        """(takes, M, n) rad, measured pose after each step."""
        return self.q + self.chain.nominal_step(self.q, self.v) + self.noise

    def subset(self, takes: np.ndarray) -> Recorded:
        """The takes with these numbers, as often as each is named."""
        return replace(self, q=self.q[takes], noise=self.noise[takes])


@dataclass(frozen=True)
class Estimate:
    """What an estimator returned."""

    # of the model, plain values, as :func:`pipeline.models.kinds.build_model` takes them
    parameters: dict[str, Any]
    estimates: dict[str, float]  # by name and unit: what a standard error can be given to
    diagnostics: dict[str, float]  # how the estimate came about
    details: Any = None  # the fit itself, where more than its parameters is needed
    # numbers of the takes → the estimates of these takes, where that is quicker than another fit
    from_takes: Callable[[np.ndarray], dict[str, float]] | None = None
    undetermined: tuple[str, ...] = ()  # estimates at an end of their search, without an interval

    @property
    def model(self) -> MotionModel:
        """The model with these parameters."""
        return kinds.build_model(self.parameters)


@dataclass(frozen=True)
class Truth:
    """Known parameters: of the model, and by the names that an estimator gives to its estimates of
    them.
    """

    label: str
    parameters: dict[str, Any]
    values: dict[str, float]


def mean_log_likelihood(recorded: Recorded, model: MotionModel) -> float:
    """Mean log density of the recorded steps in nats (rad⁻ⁿ) under ``model``, Σ_m added to every
    step, steps at rest included.
    """
    return float(
        model.log_density(
            recorded.chain, recorded.q, recorded.v, recorded.q_next, recorded.measurement
        ).mean()
    )


def moving_steps(
    q: np.ndarray, v: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses (N, n), commands (N, m) or longer and ω (N, n) of the steps with a command, the only
    ones that say anything of a matrix model.

    ``q`` and ``noise`` (takes, M, n) in rad, ``v`` (M, m) or (takes, M, m) or longer. Raises
    ModelDomainError for a motion at rest throughout.
    """
    commanded = np.broadcast_to(v, (*q.shape[:-1], v.shape[-1]))
    moving = np.any(commanded, axis=-1)
    if not np.any(moving):
        raise ModelDomainError(
            "the motion is at rest at every step: there is nothing to fit a matrix model to"
        )
    return q[moving], commanded[moving], noise[moving]
