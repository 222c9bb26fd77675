"""Modelled and recorded standard deviations over time: agreement, tests, differences of models.

The test of a joint compares the correlation of both standard deviations over time with a limit. The
limit is √½ (the model explains half of the variation) or, if lower, a quantile of the correlation
in draws of as many takes with the modelled standard deviation, which allows for the error of few
takes. The power is the share of draws of constant noise that the limit rejects, the power against a
rival the share of draws with the rival's standard deviation. All draws have the
tails of the recorded noise over its modelled standard deviation, and the recorded first-order
autoregression of its ranks (a Gaussian copula): heavy tails alone move a standard deviation of few
takes up and down.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy import ndarray
from numpy.random import Generator
from scipy.special import ndtr, ndtri

from pipeline.statistics.takes import REPLICATES, jackknife_counts, lag_one_correlation

RECOGNISED = 0.975  # share of draws of a true model that pass in all joints
# least share of draws of constant noise that a test must reject to be evidence
POWER = 0.8
HALF_EXPLAINED = 0.5**0.5
WINDOWS = 8  # of a motion, over which a running mean is taken
VARYING = 0.25  # variation over time of a curve that looks constant
CLOSE_TO_ONE = 0.9999  # greatest correlation of neighbouring steps in draws
MOST_POWER = 3.0  # greatest exponent of residuals that restores their tails
TAIL_VALUES = 80_000  # drawn residuals that determine the exponent
NO_NOISE = "no_noise"  # name in the tables of a prediction without noise


@dataclass(frozen=True)
class ModelledNoise:
    """Moments of a model's process noise ω at the recorded poses and level."""

    motion: ndarray  # (M, n) rad², mean over the takes of the variance of a step
    measurement: ndarray  # (n,) rad², variances of the measurement noise
    # (takes, M, n) rad, the model's mean next pose minus the measured one
    error: ndarray

    @property
    def std(self) -> ndarray:
        """Standard deviation (M, n) of ω with the measurement noise in rad."""
        return np.sqrt(self.motion + self.measurement)


def root_mean_square(values: ndarray) -> float:
    """Return the root mean square of all ``values``, in their unit."""
    return float(np.sqrt(np.mean(np.square(values))))


def correlation(a: ndarray, b: ndarray) -> float:
    """Return Pearson's correlation of ``a`` and ``b`` (K,); 0 if one of them is constant."""
    return float(np.corrcoef(a, b)[0, 1]) if np.ptp(a) and np.ptp(b) else 0.0


def variation(values: ndarray) -> float:
    """Return the standard deviation of ``values`` (K,) over their mean; 0 for constant values."""
    return float(values.std() / values.mean()) if np.ptp(values) else 0.0


def following_tests(
    std: ndarray,
    noise: ndarray,
    steady: ndarray,
    joints: Sequence[str],
    rng: Generator,
    centred: bool = True,
    rival: ndarray | None = None,
) -> pd.DataFrame:
    """Tabulate the ``correlation`` of the modelled standard deviation ``std`` (M, n) and the one of
    ``noise`` (takes ≥ 2, M, n) in rad, about its mean if ``centred``, else about zero; ``limit``
    and ``power`` for each joint, over all steps and over the ``steady`` steps (M,) at constant
    speed; ``rival_power`` against the standard deviation ``rival`` (M, n), NaN without it. A
    constant modelled curve has no row.

    A true model passes in all joints at once in at least RECOGNISED of the draws. Quantiles assume
    that Fisher's transform of the drawn correlations is normal.
    """
    rows = []
    recorded = _std(noise, 0, centred)
    quantile = ndtri(1 - RECOGNISED ** (1 / len(joints)))
    groups = {"all": np.full(len(steady), True), "constant_speed": steady}
    for j, joint in enumerate(joints):
        constant = _drawn_std(noise[..., j], std[:, j], rng, centred)
        drawn = constant * std[:, j, None]
        by_rival = None if rival is None else constant * rival[:, j, None]
        for name, steps in groups.items():
            curve = std[steps, j]
            if steps.sum() < 3 or np.ptp(curve) == 0:
                continue
            fisher = np.arctanh(_correlations(curve, drawn[steps]))
            reached = float(np.tanh(fisher.mean() + quantile * fisher.std(ddof=1)))
            limit = min(HALF_EXPLAINED, reached)
            power = _rejected(curve, constant[steps], limit)
            rival_power = np.nan
            if by_rival is not None:
                rival_power = _rejected(curve, by_rival[steps], limit)
            reaches = correlation(curve, recorded[steps, j])
            rows.append((joint, name, reaches, limit, power, rival_power))
    columns = ["joint", "steps", "correlation", "limit", "power", "rival_power"]
    return pd.DataFrame(rows, columns=columns)


def variation_limits(noise: ndarray, rng: Generator, centred: bool = True) -> ndarray:
    """Return limits (n, 2) of the variation over time of the standard deviation over the takes, if
    the true variation is VARYING: it is below the first, in any of the joints, and above the second
    in a joint, with a probability of 1 − RECOGNISED or less. ``noise`` (takes, M, n) is in rad; its
    standard deviation is about its mean if ``centred``, else about zero.

    Draws are a sine over the motion times the pooled noise of all steps, for the first limit over
    its running standard deviation. Variation over time makes the tails of the pool heavier: the
    second limit is too high with few takes. The logarithm of the variation is taken as normal.
    """
    from scipy.ndimage import uniform_filter1d

    _, steps, joints = noise.shape
    below, above = ndtri([1 - RECOGNISED ** (1 / joints), RECOGNISED])
    phases = 2 * np.pi * np.arange(steps) / steps
    course = 1 + 2**0.5 * VARYING * np.sin(phases)[:, None]

    def limit(of_joint: ndarray, scale: ndarray | float, end: float) -> float:
        drawn = _drawn_std(of_joint, scale, rng, centred) * course
        # no noise at all: no limits
        with np.errstate(divide="ignore", invalid="ignore"):
            variations = np.log(drawn.std(axis=0) / drawn.mean(axis=0))
        return np.exp(variations.mean() + end * variations.std(ddof=1))

    limits = []
    for of_joint in np.moveaxis(noise, -1, 0):
        squares = of_joint.var(axis=0) if centred else np.mean(of_joint**2, axis=0)
        running = uniform_filter1d(squares, max(steps // WINDOWS, 1))
        # a running sum rounds to less at rest
        running_std = np.sqrt(np.maximum(running, 0.0))
        low = limit(of_joint, running_std, below)
        limits.append((low, limit(of_joint, 1.0, above)))
    return np.array(limits)


def _std(noise: ndarray, axis: int, centred: bool = True) -> ndarray:
    """Return the standard deviation along ``axis``, about zero if not ``centred``."""
    if centred:
        return noise.std(axis=axis, ddof=1)
    return np.sqrt(np.mean(noise**2, axis=axis))


def _drawn_std(
    noise: ndarray,
    scale: ndarray | float,
    rng: Generator,
    centred: bool = True,
) -> ndarray:
    """Return standard deviations (M, REPLICATES) over as many takes of drawn noise with one law at
    all steps: the tails of ``noise`` (takes, M) over ``scale`` (M,), and its autocorrelation.
    """
    middle = noise.mean(axis=0) if centred else 0.0
    # without noise, as at rest by an encoder
    rests = np.broadcast_to(scale, noise.shape) == 0
    residuals = (noise - middle) / np.where(rests, 1.0, scale)
    pool = np.where(rests, 0.0, residuals).ravel()
    if centred:
        pool = _uncentred(pool, len(noise), rng)
    ordered = np.sort(pool)
    drawn = np.empty((noise.shape[1], REPLICATES))
    for of_step, variates in zip(drawn, _autoregression(noise, rng), strict=True):
        ranks = (ndtr(variates) * len(ordered)).astype(np.intp)
        of_step[:] = _std(ordered[ranks], -1, centred)
    return drawn


def _uncentred(pool: ndarray, takes: int, rng: Generator) -> ndarray:
    """Return the residuals ``pool`` about the mean of ``takes`` with the tails of the noise, whose
    heavy tails the mean of few takes makes lighter. A power of the absolute values makes the ratio
    E|x|/√E[x²] of draws about the mean of as many takes equal to the ratio of the residuals.
    """
    from scipy.optimize import brentq

    drawn = rng.integers(len(pool), size=(TAIL_VALUES // takes, takes))
    scaled = pool / max(np.abs(pool).max(), np.finfo(float).tiny)

    def raised(power: float) -> ndarray:
        return np.sign(scaled) * np.abs(scaled) ** power

    def excess(power: float) -> float:
        values = raised(power)[drawn]
        centred = values - values.mean(axis=1, keepdims=True)
        return float(_tail_ratio(centred) - _tail_ratio(pool))

    if not pool.any() or excess(1.0) <= 0:
        return pool
    if excess(MOST_POWER) > 0:
        return raised(MOST_POWER)
    return raised(brentq(excess, 1.0, MOST_POWER))


def _tail_ratio(values: ndarray) -> float:
    """Return E|x|/√E[x²] of ``values``, which is small for heavy tails."""
    return np.mean(np.abs(values)) / root_mean_square(values)


def _autoregression(noise: ndarray, rng: Generator) -> Iterator[ndarray]:
    """Yield standard normals (REPLICATES, takes) of each step with the autocorrelation of ``noise``
    (takes, M); those of one step stay in the processor's cache.
    """
    takes, steps = noise.shape
    correlated = lag_one_correlation(noise)
    share = np.clip(correlated, -CLOSE_TO_ONE, CLOSE_TO_ONE)
    rest = np.sqrt(1 - share**2)
    shape = (REPLICATES, takes)
    variates = rng.standard_normal(shape)
    yield variates
    for _ in range(steps - 1):
        fresh = rng.standard_normal(shape)
        variates = rest * fresh + share * variates
        yield variates


def _correlations(curve: ndarray, drawn: ndarray) -> ndarray:
    """Return Pearson's correlation (R,) of ``curve`` (K,) with each column of ``drawn`` (K, R)."""
    a = curve - curve.mean()
    b = drawn - drawn.mean(axis=0)
    return a @ b / (np.linalg.norm(a) * np.linalg.norm(b, axis=0))


def _rejected(curve: ndarray, drawn: ndarray, limit: float) -> float:
    """Return the share of ``drawn`` (K, R) whose correlation with ``curve`` is below ``limit``."""
    return float((_correlations(curve, drawn) < limit).mean())


def jackknifed_spreads(
    modelled: Mapping[str, ModelledNoise],
    noise: ndarray,
) -> tuple[dict[str, ndarray], dict[str, ndarray]]:
    """Return by model, for each row of :func:`jackknife_counts`, the relative error (1 + takes, n)
    of the standard deviation over time in each joint, and the modelled minus the recorded standard
    deviation (1 + takes, n) in rad, root mean square over time.

    All models have one level: in every set of takes of ``noise`` (takes, M, n) in rad, a factor on
    a model's variances makes modelled plus measurement variance equal to the takes' variance.
    """
    recorded = _variances(jackknife_counts(len(noise)), noise)
    recorded_std = np.sqrt(recorded)
    recorded_size = np.sqrt(recorded.mean(axis=1))
    measurement = next(iter(modelled.values())).measurement
    recorded_norm = np.sqrt(recorded.sum(axis=1))
    recorded_total = recorded.mean(axis=1).sum(axis=-1)
    total = np.maximum(recorded_total - measurement.sum(), 0)
    errors = {}
    sizes = {}
    for model, moments in modelled.items():
        modelled_total = moments.motion.mean(axis=0).sum()
        level = (total / modelled_total)[:, None, None]
        variances = level * moments.motion + measurement
        off = np.linalg.norm(np.sqrt(variances) - recorded_std, axis=1)
        errors[model] = off / recorded_norm
        sizes[model] = np.sqrt(variances.mean(axis=1)) - recorded_size
    return errors, sizes


def jackknifed_mean_error(error: ndarray) -> ndarray:
    """Return the standard deviation over time (1 + takes,) of the error of a model's mean, ‖mean −
    recorded mean‖ in rad, for each row of :func:`jackknife_counts`; ``error`` (takes, M, n) in rad
    is exact mean minus measured pose.
    """
    counts = jackknife_counts(len(error))
    weights = counts / counts.sum(axis=1, keepdims=True)
    means = (weights @ error.reshape(len(error), -1)).reshape(-1, *error.shape[1:])
    return np.linalg.norm(means, axis=-1).std(axis=1)


def _variances(counts: ndarray, noise: ndarray) -> ndarray:
    """Return sample variances (R, M, n) of ``noise`` (takes, M, n) with weights ``counts``."""
    count, *shape = noise.shape
    mean = noise.mean(axis=0)
    centred = (noise - mean).reshape(count, -1)
    takes = counts.sum(axis=1)[:, None]
    means = counts @ centred / takes
    mean_squares = counts @ centred**2 / takes
    squares = np.maximum(mean_squares - means**2, 0)
    with np.errstate(divide="ignore", invalid="ignore"):  # one take has no variance
        variances = squares * takes / (takes - 1)
    return variances.reshape(-1, *shape)
