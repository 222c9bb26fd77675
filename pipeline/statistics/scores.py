"""Log scores (Gneiting & Raftery 2007), calibration and errors of stated laws by take, and their
paired differences. The last axis holds the n components of an outcome, those before it are cases.
"""

from collections.abc import Mapping, Sequence
from itertools import permutations

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.core.errors import ModelDomainError
from pipeline.statistics.takes import Difference, paired_difference

Scores = dict[str, ndarray]  # score → (takes,) values


def nees(error: ndarray, covariance: ndarray) -> ndarray:
    """(...,) normalised estimation error squared eᵀC⁻¹e of ``error`` (..., n) under ``covariance``
    (..., n, n), χ² with n degrees of freedom under the stated law (Bar-Shalom, Li & Kirubarajan
    2001, Sec. 5.4.2). Raises ModelDomainError where a covariance is not positive definite.
    """
    try:
        root = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        message = "a squared error needs a covariance that is positive definite"
        raise ModelDomainError(message) from None
    white = np.linalg.solve(root, error[..., None])[..., 0]
    return np.vecdot(white, white)


def normal_log_score(error: ndarray, covariance: ndarray) -> ndarray:
    """(...,) log density of N(0, ``covariance``) (..., n, n) at ``error`` (..., n); raises
    ModelDomainError like :func:`nees`.
    """
    constant = error.shape[-1] * np.log(2 * np.pi)
    return -(nees(error, covariance) + np.linalg.slogdet(covariance)[1] + constant) / 2


def prediction_scores(steps: Mapping[str, ndarray], joints: Sequence[str]) -> Scores:
    """Return each score of the predictions of one step as its mean over the K steps of a take;
    ``steps`` are ``log_density`` and ``nees`` (takes, K) and the error ``z`` (takes, K, n) of
    :mod:`pipeline.models.prediction`, NaN where a model has none.
    """
    scores = {"log_score": steps["log_density"], "nees": steps["nees"]}
    for joint, z in zip(joints, np.moveaxis(steps["z"], -1, 0), strict=True):
        scores[f"coverage_of_one_sigma_{joint}"] = np.where(np.isnan(z), np.nan, np.abs(z) <= 1)
    return {name: values.mean(axis=1) for name, values in scores.items()}


def posterior_scores(
    error: ndarray, covariance: ndarray, joints: Sequence[str]
) -> tuple[Scores, str | None]:
    """Return the scores of a filter's posterior as a normal law of the measured pose, means over
    the K steps of a take, and why some are missing.

    ``error`` (takes, K, n) posterior mean minus measured pose in rad, ``covariance`` (takes, K, n,
    n) in rad² of the posterior and the measurement together.
    """
    refused, log, squared = None, *np.full((2, *error.shape[:2]), np.nan)
    try:
        log, squared = normal_log_score(error, covariance), nees(error, covariance)
    except ModelDomainError as missing:
        refused = str(missing)
    inside = np.abs(error) <= np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    rms, share = np.sqrt(np.mean(error**2, axis=1)).T, inside.mean(axis=1).T
    scores = {f"rms_error_{joint}_rad": own for joint, own in zip(joints, rms, strict=True)}
    scores |= {"log_score": log.mean(axis=1), "nees": squared.mean(axis=1)}
    scores |= {f"coverage_of_one_sigma_{j}": own for j, own in zip(joints, share, strict=True)}
    return scores, refused


def compared(scores: Mapping[str, Scores], rival: str) -> pd.DataFrame:
    """Tabulate every score of every model and its paired difference to ``rival`` over the takes."""
    rows = []
    for model, own in scores.items():
        for name, values in own.items():
            row = {"model": model, "score": name, "mean": values.mean()}
            if model != rival:
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
