"""The recorded level of noise, and motion models at it.

Spreads of two models over time or over joints can be compared at an equal level alone: whichever
has less noise in total has the smaller error where noise is missed. A model's level is its own
parameter (σ_B; α under a fixed u; a factor on a covariance), which each model's ``with_trace``
solves for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import ModelDomainError
from pipeline.models.model import MotionModel
from pipeline.models.steps import Recorded


@dataclass(frozen=True)
class TakeVariances:
    """Recorded variances of any of the takes of a motion, as an estimate from moments and its
    resamplings need them.
    """

    noise: np.ndarray  # (takes, M, n) ω in rad, about its mean over the takes
    still: np.ndarray  # (M,) steps that the measurement noise is taken from, where it is not known
    known: float | None  # rad², trace of the known measurement noise

    @classmethod
    def of(cls, recorded: Recorded) -> TakeVariances:
        """Of ``recorded``; raises ModelDomainError where the measurement noise is not known."""
        noise = recorded.noise - recorded.noise.mean(axis=0)
        if recorded.known_measurement is not None:
            known = float(np.trace(recorded.known_measurement))
            return cls(noise, np.zeros(noise.shape[1], dtype=bool), known)
        _ = recorded.measurement  # refuses a motion that never rests
        return cls(noise, ~np.any(recorded.v, axis=-1), None)

    def by_step(self, takes: np.ndarray | None = None) -> np.ndarray:
        """(M,) trace in rad² of the sample covariance at each step of the ``takes`` with these
        numbers, as often as each is named; of all where none are.

        Raises ModelDomainError for a single take.
        """
        total = len(self.noise)
        counts = np.ones(total) if takes is None else np.bincount(takes, minlength=total)
        count = counts.sum()
        if np.count_nonzero(counts) < 2:
            raise ModelDomainError(
                "a sample covariance needs at least two takes", takes=int(np.count_nonzero(counts))
            )
        flat = self.noise.reshape(total, -1)
        variances = (counts @ flat**2 - (counts @ flat) ** 2 / count) / (count - 1)
        return variances.reshape(self.noise.shape[1:]).sum(axis=-1)

    def of_motion(self, takes: np.ndarray | None = None) -> tuple[np.ndarray, float]:
        """The traces (M,) :meth:`by_step`, and the trace of the measurement noise, in rad².

        Raises ModelDomainError where the mean of the traces is not above the measurement's.
        """
        traces = self.by_step(takes)
        measured = float(traces[self.still].mean()) if self.known is None else self.known
        whole = float(traces.mean())
        if not whole > measured:
            raise ModelDomainError(
                "the variance of the recorded process noise is not above that of the measurement "
                "noise (sums over the joints): it tells nothing of the motion's own noise; record "
                "faster motions or more takes",
                recorded_trace_rad2=whole,
                measurement_trace_rad2=measured,
            )
        return traces, measured


def trace_of_motion(recorded: Recorded) -> float:
    """The recorded mean trace without that of the measurement noise, in rad².

    Raises ModelDomainError where it is not positive, and where the measurement noise is not known.
    """
    traces, measured = TakeVariances.of(recorded).of_motion()
    return float(traces.mean()) - measured


def at_recorded_level(model: MotionModel, recorded: Recorded) -> MotionModel:
    """The same model, its level solved again so that the mean trace of the covariance of a step
    and the trace of the measurement noise sum to the recorded mean trace.

    ``model`` need have no covariance itself: a Wishart model of σ_B beyond its limit has one at the
    recorded level. Raises SingularJacobianError, and ModelDomainError where the recorded trace is
    not above that of the measurement noise, where that noise is not known, where the model has no
    noise at any step, and where σ_B would be at the limit sqrt((m + 1)/(m + 3)).
    """
    return model.with_trace(recorded.chain, recorded.q, recorded.v, trace_of_motion(recorded))
