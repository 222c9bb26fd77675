"""Exact second moments of a step of the Wishart model, and σ_B by moments: the dispersion that
gives the steps a known mean variance.

With B⁻¹a = rR[z, zT]ᵀ the covariance of a step is that of z along a and E z²/(d − m) across it, so
that its trace is linear in two numbers of the step that no σ_B changes:

    tr Cov = c·‖a‖²‖J₂⁺‖_F² + (Var z − c)·‖J₂⁺a‖²,   c = E z²/(d − m).

The moment estimate is the root in σ_B of one equation: the mean of tr Cov over the takes and steps,
plus the trace of the measurement noise, is the recorded total variance. It has neither a weight nor
a floor, and is the smallest mend of the paper's criterion for (ũ, α), its absolute value outside
the sum, for σ_B.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.core.errors import ModelDomainError
from pipeline.models.steps import Recorded, TakeVariances
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.factors import factors
from pipeline.randommatrix.wishart import largest_dispersion

# of ln(d − m − 3): from dispersions at the limit of the covariance to a step without noise
LOG_EXCESS = (-12.0, 60.0)


class StepSquares(NamedTuple):
    """Squared lengths in rad² of one step or their means over many; :mod:`.moments` says which."""

    every: np.ndarray  # ‖a‖²‖J₂⁺‖_F², as if the noise had every direction of a
    nominal: np.ndarray  # ‖J₂⁺a‖², of the nominal step


@dataclass(frozen=True)
class MomentFit:
    """σ̂_B by moments, and the numbers of each take by which it is resampled."""

    sigma_b: float
    squares: StepSquares  # (takes,) means over the steps
    variances: TakeVariances
    m: int  # rows of the task

    def from_takes(self, takes: np.ndarray) -> dict[str, float]:
        """σ̂_B of the takes with these numbers, as often as each is named."""
        return {"sigma_b": _solved(self.squares, self.variances, self.m, takes)}


def fit_moments(recorded: Recorded, decomposition: Decomposition) -> MomentFit:
    """σ̂_B by moments.

    Raises SingularJacobianError, and ModelDomainError where the recorded variance is not above that
    of the measurement noise, where that noise is not known, and as :func:`dispersion_of_trace`.
    """
    a, back, _ = factors(recorded.chain, recorded.q, recorded.v, decomposition)
    squares = StepSquares(*(each.mean(axis=1) for each in step_squares(a, back)))
    variances, m = TakeVariances.of(recorded), a.shape[-1]
    return MomentFit(_solved(squares, variances, m), squares, variances, m)


def _solved(
    squares: StepSquares, variances: TakeVariances, m: int, takes: np.ndarray | None = None
) -> float:
    traces, measured = variances.of_motion(takes)
    own = StepSquares(*(each[... if takes is None else takes].mean() for each in squares))
    return dispersion_of_trace(own, float(traces.mean()) - measured, m)


def step_variances(d: float, m: int) -> tuple[float, float]:
    """Var z and c = E z²/(d − m), the variances of B⁻¹a along and across a unit a, B (m, m)."""
    square = d**2 / ((d - m - 1) * (d - m - 3))
    return 2 * d**2 / ((d - m - 1) ** 2 * (d - m - 3)), square / (d - m)


def step_squares(a: np.ndarray, back: np.ndarray) -> StepSquares:
    """Squared lengths (...,) in rad² of the steps of ``a`` J₁⁻¹v (..., m) and ``back`` J₂⁺
    (..., n, m).
    """
    mean = np.matvec(back, a)
    return StepSquares(
        np.vecdot(a, a) * np.einsum("...ij,...ij->...", back, back), np.vecdot(mean, mean)
    )


def trace_at(squares: StepSquares, d: float, m: int) -> np.ndarray:
    """(...,) trace in rad² of the covariance of steps with these ``squares`` (...,) for d > m + 3
    degrees of freedom of B (m, m).
    """
    along, across = step_variances(d, m)
    return across * squares.every + (along - across) * squares.nominal


def dispersion_of_trace(squares: StepSquares, trace: float, m: int) -> float:
    """σ_B at which steps of these mean ``squares`` have the mean ``trace`` in rad² of their
    covariance, B (m, m).

    The trace grows with σ_B, from zero to infinity at the limit sqrt((m + 1)/(m + 3)), so that each
    positive trace has one σ_B, found by bracketing. Raises ModelDomainError for a trace that is not
    positive, for steps at rest throughout, and where σ_B would be at its limit to rounding.
    """
    from scipy.optimize import brentq  # here, as what loads a model does without SciPy

    if not trace > 0:
        raise ModelDomainError(
            "a Wishart step needs a positive variance to have a sigma_B", trace_rad2=trace
        )
    if not squares.every > 0:
        raise ModelDomainError(
            "the motion is at rest at every step, where no sigma_B gives a Wishart step a variance"
        )

    def excess(x: float) -> float:
        return float(np.log(trace_at(squares, m + 3 + np.exp(x), m) / trace))

    low, high = LOG_EXCESS
    if not excess(low) > 0:
        raise ModelDomainError(
            "the variance of a Wishart step needs a sigma_B at the limit of its covariance, "
            f"{largest_dispersion(m, inverse_moments=2):.4g}",
            trace_rad2=trace,
        )
    d = m + 3 + np.exp(brentq(excess, low, high, xtol=1e-12, rtol=1e-14))
    return float(np.sqrt((m + 1) / d))
