"""Offset between the clocks of two instruments that follow the same motion."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from pipeline.core.errors import RecordingError

GRID = 0.005  # s, step of the coarse search, short relative to any motion of an arm
MIN_OVERLAP = 0.5  # least share of the first signal that is within the second
MIN_SAMPLES = 10  # least number of samples of a signal
MIN_CORRELATION = 0.9
WITHOUT_GAPS = 0.8  # quantile of the residual


class Offset(NamedTuple):
    """Clock offset in the middle of a take, multiple correlation, drift, and standard errors."""

    value: float  # s
    standard_error: float  # s
    correlation: float
    drift: float  # s/s
    drift_standard_error: float  # s/s
    # of ``a`` from the affine map of ``b``, 0.8 quantile, in the unit of a
    residual: float


class AffineFit(NamedTuple):
    """Least-squares fit of B·b(t + τ) + c to the rows of ``a`` at the times t within b."""

    a: np.ndarray  # (F, d) rows of a
    regressors: np.ndarray  # (F, e + 1) b(t + τ) without its mean, and 1
    affine: np.ndarray  # (e + 1, d) B and c
    residual: np.ndarray  # (F, d)


class SignalPair(NamedTuple):
    """Two signals, each with the times of one instrument's clock in s."""

    t_a: np.ndarray  # (F,)
    a: np.ndarray  # (F, d)
    t_b: np.ndarray  # (K,)
    centre: np.ndarray  # (e,) mean of b
    spline: Callable  # cubic spline of b (K, e)

    def inside(self, tau: float) -> np.ndarray:
        """Return the mask (F,) of the rows of ``a`` within the times of b at the offset ``tau``."""
        shifted = self.t_a + tau
        return (shifted >= self.t_b[0]) & (shifted <= self.t_b[-1])

    def fit(self, tau: float) -> AffineFit:
        """Return the fit at the offset ``tau`` in s."""
        inside = self.inside(tau)
        a = self.a[inside]
        time = self.t_a[inside]
        b = self.spline(time + tau) - self.centre
        constant = np.ones(len(a))
        regressors = np.column_stack([b, constant])
        affine, *_ = np.linalg.lstsq(regressors, a, rcond=None)
        residual = a - regressors @ affine
        return AffineFit(a, regressors, affine, residual)

    def unexplained(self, tau: float) -> float:
        """Return the unexplained share of the variance of ``a`` at the offset ``tau`` in s."""
        fit = self.fit(tau)
        deviation = fit.a - fit.a.mean(axis=0)
        return float((fit.residual**2).sum() / (deviation**2).sum())


def find_offset(
    t_a: np.ndarray,
    a: np.ndarray,
    t_b: np.ndarray,
    b: np.ndarray,
    search: tuple[float, float] = (-0.5, 0.5),
    take: str = "",
) -> Offset:
    """Return the offset τ that minimises ‖a(t) − B·b(t + τ) − c‖² over τ, matrix B and vector c. B
    and c allow for different measured points of the moving body and are eliminated for every τ
    (variable projection, Golub and Pereyra 1973).

    ``t_a`` (F,) and ``t_b`` (K,) s increase, each on one instrument's clock. ``a`` (F, d) and ``b``
    (K, e) are finite, in any units; a cubic spline interpolates b. Raises RecordingError (take) for
    signals that are too short, constant, uncorrelated or fit best at the edge of ``search`` (s).
    """
    from scipy.interpolate import CubicSpline

    refusal = partial(RecordingError, take=take)
    for t, signal in ((t_a, a), (t_b, b)):
        if len(t) < MIN_SAMPLES or np.any(np.diff(t) <= 0):
            fault = f"a signal has fewer than {MIN_SAMPLES} samples, or times that do not increase"
            raise refusal(f"no clock offset: {fault}")
        if not np.ptp(signal, axis=0).any():
            message = (
                "no motion to compare the clocks by: one of the signals is constant"
            )
            raise refusal(message)

    signals = SignalPair(t_a, a, t_b, b.mean(axis=0), CubicSpline(t_b, b))
    tau = _least_unexplained(signals, search, refusal)
    correlation = float(np.sqrt(max(0.0, 1.0 - signals.unexplained(tau))))
    if correlation < MIN_CORRELATION:
        raise refusal(
            "the signals of the two instruments are not alike at any clock offset: no motion, "
            "or not the same take",
            correlation=round(correlation, 3),
        )
    return _offset_of(signals, tau, correlation)


def _least_unexplained(
    signals: SignalPair,
    search: tuple[float, float],
    refusal: Callable,
) -> float:
    """Return the offset in s with the least unexplained share, by a grid over ``search`` and then
    between its neighbours on the grid; raise ``refusal`` for an offset at the edge.
    """
    from scipy.optimize import minimize_scalar

    low, high = search
    number = max(3, round((high - low) / GRID) + 1)
    grid = np.linspace(low, high, number)
    least = max(MIN_OVERLAP * len(signals.t_a), 2 * len(signals.centre) + 4)
    overlaps = [signals.inside(tau).sum() >= least for tau in grid]
    grid = grid[overlaps]
    best = 0
    if len(grid):
        best = int(np.argmin([signals.unexplained(tau) for tau in grid]))
    if best in (0, len(grid) - 1):
        message = "the clock offset lies at the edge of the search range or of the signals' overlap"
        offset = grid[best : best + 1].round(4).tolist()
        raise refusal(message, search=search, offset=offset)

    solution = minimize_scalar(
        signals.unexplained,
        bounds=(grid[best - 1], grid[best + 1]),
        method="bounded",
        options={"xatol": 1e-7},
    )
    return float(solution.x)


def _offset_of(signals: SignalPair, tau: float, correlation: float) -> Offset:
    """Return the offset ``tau`` in s with its drift, standard errors and residual."""
    fit = signals.fit(tau)
    residual = fit.residual
    regressors = fit.regressors
    time = signals.t_a[signals.inside(tau)]
    velocity = signals.spline.derivative()(time + tau)
    slope = velocity @ fit.affine[:-1]
    # derivatives by offset and drift, without their projection on B and c
    late = _without_projection(slope, regressors)
    since_middle = (time - time.mean())[:, None]
    drifting = _without_projection(since_middle * slope, regressors)
    drifting -= late * ((drifting * late).sum() / (late**2).sum())
    drift = (drifting * residual).sum() / (drifting**2).sum()

    inflation = _inflation_of_variance(residual)
    freedom = len(residual) - regressors.shape[1] - 1 / residual.shape[1]
    variance = (residual**2).sum(axis=0) / freedom
    standard_errors = []
    for derivative in (late, drifting):
        information = (derivative**2).sum(axis=0)
        deviation = np.sqrt(inflation * (variance * information).sum())
        standard_errors.append(float(deviation / information.sum()))
    # without the frames in a gap of b, which the spline bridges
    size = np.quantile(np.linalg.norm(residual, axis=1), WITHOUT_GAPS)
    return Offset(
        value=tau,
        standard_error=standard_errors[0],
        correlation=correlation,
        drift=float(drift),
        drift_standard_error=standard_errors[1],
        residual=float(size),
    )


def _inflation_of_variance(residual: np.ndarray) -> float:
    """Return the factor of the variance of a mean by the autocorrelation (AR(1)) of ``residual``
    (F, d); a negative autocorrelation is ignored.
    """
    square = (residual**2).sum()
    if not square:
        return 1.0
    autocorrelation = max((residual[1:] * residual[:-1]).sum() / square, 0.0)
    return (1 + autocorrelation) / (1 - autocorrelation)


def _without_projection(signal: np.ndarray, regressors: np.ndarray) -> np.ndarray:
    """Return ``signal`` minus its least-squares fit by the ``regressors``."""
    coefficients, *_ = np.linalg.lstsq(regressors, signal, rcond=None)
    return signal - regressors @ coefficients
