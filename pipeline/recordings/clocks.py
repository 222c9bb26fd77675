"""Offset between the clocks of two instruments that saw the same motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import RecordingError

GRID = 0.005  # s, step of the coarse search: fine against any motion of an arm
MIN_OVERLAP = 0.5  # share of the first signal that has to fall inside the second


@dataclass(frozen=True)
class Offset:
    """``value`` s to add to the first clock to read the second; its standard error in s; multiple
    correlation at the optimum.

    ``drift`` s/s by which the second clock gains on the first, estimated beside the offset to first
    order, and its standard error; the value is that of the middle of the take.
    """

    value: float
    standard_error: float
    correlation: float
    drift: float
    drift_standard_error: float


def find_offset(
    t_a: np.ndarray,
    a: np.ndarray,
    t_b: np.ndarray,
    b: np.ndarray,
    *,
    search: tuple[float, float] = (-0.5, 0.5),
    min_correlation: float = 0.9,
    take: str = "",
) -> Offset:
    """Offset τ of the least squares ‖a(t) − B·b(t + τ) − c‖² over τ, the matrix B and the vector c.

    ``t_a`` (F,) and ``t_b`` (K,) are times in s on their own clocks, increasing; ``a`` (F, d) and
    ``b`` (K, e) the signals in any units, b the one sampled faster (it is interpolated by a cubic
    spline). B and c are free because two instruments see different points of the moving body; they
    are eliminated for every τ (variable projection, Golub and Pereyra 1973). The standard error is
    that of the linearised problem, with the residuals' own variance in each component and their
    lag-one correlation.

    Raises RecordingError (take) for signals that are too short, do not move, are not alike
    (correlation below ``min_correlation``) or fit best at the edge of ``search`` (s).
    """
    from scipy.interpolate import CubicSpline
    from scipy.optimize import minimize_scalar

    t_a, a = _clean(t_a, a, take)
    t_b, b = _clean(t_b, b, take)
    spline = CubicSpline(t_b, b)
    velocity = spline.derivative()

    def inside(tau: float) -> np.ndarray:
        return (t_a + tau >= t_b[0]) & (t_a + tau <= t_b[-1])

    def residuals(tau: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        use = inside(tau)
        regressors = np.column_stack([spline(t_a[use] + tau) - b.mean(axis=0), np.ones(use.sum())])
        affine = np.linalg.lstsq(regressors, a[use], rcond=None)[0]
        return a[use] - regressors @ affine, regressors, affine

    def unexplained(tau: float) -> float:
        """Share of the variance of ``a`` that is left; a share, since the number of samples inside
        changes with τ.
        """
        residual = residuals(tau)[0]
        return float(
            (residual**2).sum() / ((a[inside(tau)] - a[inside(tau)].mean(axis=0)) ** 2).sum()
        )

    if not (np.ptp(a, axis=0).any() and np.ptp(b, axis=0).any()):
        raise RecordingError(
            "no motion to compare the clocks by: one of the signals is constant", take=take
        )
    grid = np.linspace(*search, max(3, round((search[1] - search[0]) / GRID) + 1))
    grid = grid[
        [inside(tau).sum() >= max(MIN_OVERLAP * len(t_a), 2 * b.shape[1] + 4) for tau in grid]
    ]
    if len(grid) < 3:
        raise RecordingError(
            "the two signals do not overlap anywhere in the search range of the clock offset",
            take=take,
            search=search,
        )
    best = int(np.argmin([unexplained(tau) for tau in grid]))
    if best in (0, len(grid) - 1):
        raise RecordingError(
            "the clock offset lies at the edge of the search range, or beyond",
            take=take,
            offset=round(float(grid[best]), 4),
        )
    tau = float(
        minimize_scalar(
            unexplained,
            bounds=(grid[best - 1], grid[best + 1]),
            method="bounded",
            options={"xatol": 1e-7},
        ).x
    )
    correlation = float(np.sqrt(max(0.0, 1.0 - unexplained(tau))))
    if correlation < min_correlation:
        raise RecordingError(
            "the signals of the two instruments are not alike at any clock offset: no motion, or "
            "not the same take",
            take=take,
            correlation=round(correlation, 3),
        )
    residual, regressors, affine = residuals(tau)
    time = t_a[inside(tau)]
    slope = velocity(time + tau) @ affine[:-1]

    def beyond(sensitivity: np.ndarray) -> np.ndarray:
        """What of it B and c do not take up."""
        return sensitivity - regressors @ np.linalg.lstsq(regressors, sensitivity, rcond=None)[0]

    late = beyond(slope)
    drifting = beyond((time - time.mean())[:, None] * slope)
    drifting -= late * ((drifting * late).sum() / (late**2).sum())
    drift = float((drifting * residual).sum() / (drifting**2).sum())
    parameters = regressors.shape[1]
    errors = [
        _standard_error(residual, sensitivity, parameters) for sensitivity in (late, drifting)
    ]
    return Offset(tau, errors[0], correlation, drift, errors[1])


def _standard_error(residual: np.ndarray, slope: np.ndarray, parameters: int) -> float:
    """Standard error of a parameter from residuals (F, d) and their derivative by it (F, d), less
    what other parameters take up of it.
    """
    freedom = len(residual) - parameters - 1 / residual.shape[1]
    information = (slope**2).sum(axis=0)
    variance = (residual**2).sum(axis=0) / freedom
    square = (residual**2).sum()
    lag = (residual[1:] * residual[:-1]).sum() / square if square else 0.0
    # the variance of a mean of AR(1) noise is larger by this factor; a negative correlation is not
    # taken as a gain
    inflation = (1 + max(lag, 0.0)) / (1 - max(lag, 0.0))
    return float(np.sqrt(inflation * (variance * information).sum()) / information.sum())


def _clean(t: np.ndarray, signal: np.ndarray, take: str) -> tuple[np.ndarray, np.ndarray]:
    t, signal = np.asarray(t, dtype=float), np.asarray(signal, dtype=float)
    signal = signal.reshape(len(signal), -1)
    if len(t) != len(signal):
        raise RecordingError(f"{len(t)} times for {len(signal)} samples", take=take)
    finite = np.isfinite(t) & np.isfinite(signal).all(axis=1)
    t, signal = t[finite], signal[finite]
    if len(t) < 10 or np.any(np.diff(t) <= 0):
        raise RecordingError(
            "a signal with fewer than 10 samples, or whose times do not increase, gives no clock "
            "offset",
            take=take,
        )
    return t, signal
