"""Log scores (Gneiting & Raftery 2007), calibration and errors of predicted laws by take, and
paired differences of scores. The training mean counts as a filter of the test takes.

The last axis has the n components of an outcome; the axes before it are cases.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.core.errors import ModelDomainError
from pipeline.statistics.curves import correlation, root_mean_square, variation
from pipeline.statistics.takes import Difference, paired_difference, takes_moments

FOLLOWS = "correlation_of_bound_with_error"
Scores = dict[str, ndarray]  # score → (takes,) values


def nees(error: ndarray, covariance: ndarray) -> ndarray:
    """Return the normalised estimation error squared eᵀC⁻¹e (...,) of ``error`` (..., n) with
    ``covariance`` (..., n, n); under the predicted law it is χ² with n degrees of freedom (Bar-
    Shalom et al. 2001, Sec. 5.4.2). Raises ModelDomainError for C that is not positive definite.
    """
    try:
        root = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        message = "the normalised squared error needs a positive definite covariance"
        raise ModelDomainError(message) from None
    white = np.linalg.solve(root, error[..., None])[..., 0]
    return np.vecdot(white, white)


def normal_log_score(error: ndarray, covariance: ndarray) -> ndarray:
    """Return the log density (...,) of N(0, ``covariance``) at ``error`` (..., n); raises
    ModelDomainError like :func:`nees`.
    """
    constant = error.shape[-1] * np.log(2 * np.pi)
    log_determinant = np.linalg.slogdet(covariance)[1]
    return -(nees(error, covariance) + log_determinant + constant) / 2


def prediction_scores(steps: Mapping[str, ndarray], joints: Sequence[str]) -> Scores:
    """Return each score of the predictions of one step as its mean over the K steps of a take;
    ``steps`` are ``log_density`` and ``nees`` (takes, K) and the error ``z`` (takes, K, n) of
    :mod:`pipeline.models.prediction`, NaN if a model has no such value.
    """
    scores = {"log_score": steps["log_density"], "nees": steps["nees"]}
    for j, joint in enumerate(joints):
        z = steps["z"][..., j]
        missing = np.isnan(z)
        inside = np.abs(z) <= 1
        scores[f"coverage_of_one_sigma_{joint}"] = np.where(missing, np.nan, inside)

    means = {}
    for name, of_steps in scores.items():
        means[name] = of_steps.mean(axis=1)
    return means


def posterior_scores(
    error: ndarray,
    covariance: ndarray,
    joints: Sequence[str],
) -> tuple[Scores, str | None]:
    """Return the scores of a filter's posterior as a normal law of the measured pose, means over
    the K steps of a take, and the reason if log score and NEES are missing.

    ``error`` (takes, K, n) posterior mean minus measured pose in rad, ``covariance`` (takes, K, n,
    n) in rad² of the posterior and the measurement together.
    """
    refused = None
    log = squared = np.full(error.shape[:2], np.nan)
    try:
        log = normal_log_score(error, covariance)
        squared = nees(error, covariance)
    except ModelDomainError as missing:
        refused = str(missing)

    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    rms = np.sqrt(np.mean(error**2, axis=1))
    share = np.mean(np.abs(error) <= std, axis=1)
    scores = {}
    for joint, of_takes in zip(joints, rms.T, strict=True):
        scores[f"rms_error_{joint}_rad"] = of_takes
    scores |= {"log_score": log.mean(axis=1), "nees": squared.mean(axis=1)}
    for joint, of_takes in zip(joints, share.T, strict=True):
        scores[f"coverage_of_one_sigma_{joint}"] = of_takes
    return scores, refused


def score_comparison(scores: Mapping[str, Scores], rival: str) -> pd.DataFrame:
    """Tabulate every score of every model and its paired difference to ``rival`` over the takes."""
    rows = []
    for model, by_name in scores.items():
        for name, values in by_name.items():
            row = {"model": model, "score": name, "mean": values.mean()}
            if model != rival:
                of_rival = scores[rival][name]
                difference = paired_difference(values, of_rival)
                row |= difference._asdict()
            rows.append(row)
    columns = ["model", "score", "mean", *Difference._fields]
    return pd.DataFrame(rows, columns=columns)


def log_score_differences(scores: Mapping[str, Scores]) -> pd.DataFrame:
    """Tabulate the paired difference in log score over the takes between any two models, ``model``
    minus ``rival``, in nats, with its 95 % interval.
    """
    logs = {model: by_name["log_score"] for model, by_name in scores.items()}
    rows = []
    for model, rival in permutations(logs, 2):
        difference = paired_difference(logs[model], logs[rival])
        rows.append((model, rival, *difference))
    columns = ["model", "rival", *Difference._fields]
    return pd.DataFrame(rows, columns=columns)


@dataclass(frozen=True)
class Filtered:
    """A filter's posterior on the test takes."""

    error: ndarray  # (takes, K, n) rad, mean minus measured pose
    covariance: ndarray  # (takes, K, n, n) rad², of the pose
    measurement: ndarray  # (n, n) rad², of the noise of a measured pose

    @property
    def measured_covariance(self) -> ndarray:
        """Covariance of the measured pose (takes, K, n, n) in rad²."""
        return self.covariance + self.measurement

    @property
    def bound(self) -> ndarray:
        """Standard deviation of the measured pose (takes, K, n) in rad."""
        return np.sqrt(np.diagonal(self.measured_covariance, axis1=-2, axis2=-1))


def training_mean(training: ndarray, measured: ndarray) -> Filtered:
    """Return mean and covariance of the ``training`` takes (N, K, n) at each step, measurement
    noise included, as a filter of the test takes ``measured`` (takes, K, n); poses are in rad.
    """
    mean, covariance = takes_moments(training)
    shape = (len(measured), *covariance.shape)
    covariances = np.broadcast_to(covariance, shape)
    without_noise = np.zeros(covariance.shape[1:])
    return Filtered(mean - measured, covariances, without_noise)


def bound_scores(
    error: ndarray,
    bound: ndarray,
    joints: Sequence[str],
) -> dict[str, dict[str, float]]:
    """Return by joint the accuracy of a filter, the width of its ±1σ bound and the agreement of the
    bound with the error over time; ``error`` posterior mean minus truth and ``bound`` standard
    deviation (takes, K, n) in rad.
    """
    scores = {}
    for j, joint in enumerate(joints):
        off = error[..., j]
        wide = bound[..., j]
        rms = np.sqrt(np.mean(off**2, axis=0))
        width = wide.mean(axis=0)
        relative = np.linalg.norm(width - rms) / np.linalg.norm(rms)
        scores[joint] = {
            "rms_error_rad": root_mean_square(off),
            "mean_bound_rad": wide.mean(),
            "bound_variation": variation(width),
            "error_variation": variation(rms),
            FOLLOWS: correlation(width, rms),
            "relative_error_of_bound": relative,
        }
    return scores
