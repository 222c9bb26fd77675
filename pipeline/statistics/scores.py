"""Proper scores of stated laws (Gneiting & Raftery 2007), calibration and sharpness.

A logarithmic score is a log density at the outcome and best when great, an energy score a distance
and best when small. The last axis holds the n components of an outcome, those before it are cases.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations

import numpy as np
import pandas as pd
from scipy.special import gammaincinv

from pipeline.core.errors import ModelDomainError
from pipeline.statistics.takes import Difference, paired_difference

NODES, WEIGHTS = np.polynomial.legendre.leggauss(64)
LEVEL = 0.95  # of the region and of the band of the NEES

Scores = dict[str, np.ndarray]  # score → (takes,) values, or one value of all takes together


def energy_score(samples: np.ndarray, outcome: np.ndarray) -> np.ndarray:
    """(...,) E‖X − y‖ − ½E‖X − X′‖ for independent X, X′ of the stated law, in the unit of
    ``outcome`` y (..., n).

    Gneiting & Raftery 2007, Eq. (22), with exponent 1, estimated from ``samples`` (S, ..., n). The
    second mean runs over pairs of different samples, so that the estimate is unbiased whatever S
    (Ferro 2014); it may be negative. Raises ModelDomainError for a single sample.
    """
    from scipy.spatial.distance import pdist

    if (count := len(samples)) < 2:
        raise ModelDomainError("an energy score needs at least two samples", samples=count)
    to_outcome = np.linalg.norm(samples - outcome, axis=-1).mean(axis=0)
    by_case = np.moveaxis(samples.reshape(count, -1, samples.shape[-1]), 0, 1)
    between = np.reshape([pdist(members).sum() for members in by_case], to_outcome.shape)
    return to_outcome - between / (count * (count - 1))


def normal_energy_score(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(...,) energy score of N(0, ``covariance``) (..., n, n) at ``error`` (..., n).

    E‖Z‖ of a normal Z = ∫(1 − E exp(−t²‖Z‖²))/t² dt/√π over t > 0, and with the variances λ of Z
    along their axes and its mean m that expectation is Π(1 + 2t²λ)^(−½)·exp(−t²m²/(1 + 2t²λ)).
    Raises ModelDomainError where a covariance is not positive definite.
    """
    variances, axes = np.linalg.eigh(covariance)
    if not np.all(variances > 0):
        message = "an energy score needs covariances that are positive definite"
        raise ModelDomainError(message, least=float(variances.min()))
    mean = np.squeeze(np.swapaxes(axes, -1, -2) @ error[..., None], -1)
    return _mean_norm(mean, variances) - _mean_norm(np.zeros_like(mean), 2 * variances) / 2


def _mean_norm(mean: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """(...,) E‖Z‖ of normal Z with independent components, ``mean`` and ``variances`` (..., n)."""
    size = np.sqrt(np.sum(variances + mean**2, axis=-1))
    total = np.zeros_like(size)
    for node, weight in zip((NODES + 1) / 2, WEIGHTS / 2, strict=True):
        # t from 0 to infinity as node/(1 − node), in units of 1/size
        square = (node / (1 - node) / size)[..., None] ** 2
        widened = 1 + 2 * square * variances
        exponent = np.sum(np.log(widened) / 2 + square * mean**2 / widened, axis=-1)
        total -= weight * np.expm1(-exponent) / node**2
    return total * size / np.sqrt(np.pi)


def nees(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(...,) normalised estimation error squared eᵀC⁻¹e of ``error`` (..., n) under ``covariance``
    (..., n, n): χ² with n degrees of freedom where the error is normal with that covariance
    (Bar-Shalom, Li & Kirubarajan 2001, Sec. 5.4.2).

    Raises ModelDomainError where a covariance is not positive definite.
    """
    try:
        root = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        message = "a squared error needs a covariance that is positive definite"
        raise ModelDomainError(message) from None
    white = np.linalg.solve(root, error[..., None])[..., 0]
    return np.vecdot(white, white)


def _chi_squared(probability: float, degrees: int) -> float:
    """Quantile of χ²."""
    return float(2 * gammaincinv(degrees / 2, probability))


def nees_band(cases: int, dimension: int, level: float = LEVEL) -> tuple[float, float]:
    """Ends of the band that the mean NEES of ``cases`` independent errors of ``dimension``
    components lies in with probability ``level``, tails alike.
    """
    low, high = (_chi_squared(p, cases * dimension) for p in ((1 - level) / 2, (1 + level) / 2))
    return low / cases, high / cases


def log_determinant(covariance: np.ndarray) -> np.ndarray:
    """(...,) ln det of ``covariance`` (..., n, n): sharpness, the less the sharper the law. Raises
    ModelDomainError where the determinant is not positive.
    """
    sign, logarithm = np.linalg.slogdet(covariance)
    if wrong := int(np.count_nonzero(sign <= 0)):
        raise ModelDomainError("the determinant of a covariance is not positive", cases=wrong)
    return logarithm


def normal_log_score(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(...,) log density of N(0, ``covariance``) (..., n, n) at ``error`` (..., n); raises
    ModelDomainError like :func:`nees`.
    """
    constant = error.shape[-1] * np.log(2 * np.pi)
    return -(nees(error, covariance) + log_determinant(covariance) + constant) / 2


def prediction_scores(
    steps: Mapping[str, np.ndarray], joints: Sequence[str], *, moving: bool
) -> Scores:
    """Return each score of the predictions of one step as its mean over the K steps of a take.

    ``steps``: the scores (takes, K) of :func:`pipeline.models.prediction.score_steps`, and under
    ``z`` (takes, K, n) the errors in standard deviations. ``moving``: no step is at rest, so that
    there is a score without measurement noise.
    """
    scores = {"log_score": steps["log_density"]}
    if moving:
        noiseless = steps["log_density_noiseless"]
        scores["log_score_without_measurement_noise"] = noiseless
        ruled_out = _where_known(noiseless, np.isneginf(noiseless))
        scores["ruled_out_without_measurement_noise"] = ruled_out
    scores["energy_score_rad"] = steps["energy"]
    for joint, z in zip(joints, np.moveaxis(steps["z"], -1, 0), strict=True):
        scores[f"coverage_of_one_sigma_{joint}"] = _where_known(z, np.abs(z) <= 1)
    consistency = _consistency(steps["nees"], steps["log_determinant"], len(joints))
    return {name: values.mean(axis=1) for name, values in scores.items()} | consistency


def posterior_scores(
    error: np.ndarray, covariance: np.ndarray, joints: Sequence[str]
) -> tuple[Scores, str | None]:
    """Return the scores of a filter's posterior as a normal law of the measured pose, over the K
    steps of each take, and why some are missing.

    ``error`` (takes, K, n) posterior mean minus measured pose in rad, ``covariance`` (takes, K, n,
    n) in rad² of the posterior and the measurement together.
    """
    refused, functions = None, (normal_log_score, nees, normal_energy_score)
    try:
        log, squared, energy = (score(error, covariance) for score in functions)
        sharpness = log_determinant(covariance)
    except ModelDomainError as missing:
        refused = str(missing)
        log = squared = sharpness = energy = np.full(error.shape[:2], np.nan)
    inside = np.abs(error) <= np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    rms, share = np.sqrt(np.mean(error**2, axis=1)).T, inside.mean(axis=1).T
    scores = {f"rms_error_{joint}_rad": own for joint, own in zip(joints, rms, strict=True)}
    scores |= {"log_score": log.mean(axis=1), "energy_score_rad": energy.mean(axis=1)}
    scores |= {f"coverage_of_one_sigma_{j}": own for j, own in zip(joints, share, strict=True)}
    return scores | _consistency(squared, sharpness, len(joints)), refused


def _consistency(squared: np.ndarray, sharpness: np.ndarray, dimension: int) -> Scores:
    """Calibration and sharpness from the NEES (takes, K) of errors in ``dimension`` joints and the
    log determinant (takes, K) of their law; the band of the NEES is for the mean over takes.
    """
    low, high = nees_band(len(squared), dimension)
    by_step = squared.mean(axis=0)
    region = _where_known(squared, squared <= _chi_squared(LEVEL, dimension))
    band = _where_known(by_step, (low <= by_step) & (by_step <= high))
    return {
        "coverage_of_the_95_percent_region": region.mean(axis=1),
        "nees": squared.mean(axis=1),
        "share_of_steps_with_nees_in_its_95_percent_band": band.mean(),
        "log_determinant": sharpness.mean(axis=1),
    }


def _where_known(values: np.ndarray, holds: np.ndarray) -> np.ndarray:
    """``holds`` as 1 or 0, and NaN where ``values`` is."""
    return np.where(np.isnan(values), np.nan, holds)


def compared(scores: Mapping[str, Scores], rival: str) -> pd.DataFrame:
    """Tabulate every score of every model and its paired difference to ``rival`` over the takes."""
    rows = []
    for model, own in scores.items():
        for name, values in own.items():
            row = {"model": model, "score": name, "mean": values.mean()}
            if model != rival and values.ndim:
                row |= paired_difference(values, scores[rival][name])._asdict()
            rows.append(row)
    return pd.DataFrame(rows, columns=["model", "score", "mean", *Difference._fields])


def log_score_differences(scores: Mapping[str, Scores]) -> pd.DataFrame:
    """Tabulate the paired difference in log score over the takes between any two models, ``model``
    minus ``rival``, in nats, with its 95 % interval.
    """
    log = {model: own["log_score"] for model, own in scores.items()}
    pairs = list(permutations(log, 2))
    rows = [(*pair, *paired_difference(*map(log.get, pair))) for pair in pairs]
    return pd.DataFrame(rows, columns=["model", "rival", *Difference._fields])
