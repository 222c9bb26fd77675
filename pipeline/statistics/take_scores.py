"""Scores of predictions and posteriors, summed up over the steps of each take, and their paired
differences between models over the takes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import permutations

import numpy as np
import pandas as pd

from pipeline.core.errors import ModelDomainError
from pipeline.statistics.scores import (
    in_region,
    log_determinant,
    nees,
    nees_band,
    normal_energy_score,
    normal_log_score,
    paired_difference,
)

Scores = dict[str, np.ndarray]  # score → (takes,) values, or one value of all takes together


def prediction_scores(
    steps: Mapping[str, np.ndarray], joints: Sequence[str], *, moving: bool
) -> Scores:
    """Each score of the predictions of one step as its mean over the K steps of a take.

    ``steps``: the scores (takes, K) by the names of
    :func:`pipeline.models.prediction.score_steps`, and under ``z`` (takes, K, n) the
    errors in standard deviations; ``joints`` the n names. ``moving``: whether none of the steps is
    at rest, so that there is a score without measurement noise.
    """
    scores = {"log_score": steps["log_density"]}
    if moving:
        noiseless = steps["log_density_noiseless"]
        scores |= {
            "log_score_without_measurement_noise": noiseless,
            "ruled_out_without_measurement_noise": _share(np.isneginf, noiseless),
        }
    scores |= {"energy_score_rad": steps["energy"]}
    for j, joint in enumerate(joints):
        scores[f"coverage_of_one_sigma_{joint}"] = _share(
            lambda z: np.abs(z) <= 1, steps["z"][..., j]
        )
    consistency = _consistency(steps["nees"], steps["log_determinant"], len(joints))
    return {name: values.mean(axis=1) for name, values in scores.items()} | consistency


def posterior_scores(
    error: np.ndarray, covariance: np.ndarray, joints: Sequence[str]
) -> tuple[Scores, str | None]:
    """Scores of a filter's posterior as a normal law of the pose that was measured, over the K
    steps of each take; why some are missing.

    ``error`` (takes, K, n) posterior mean minus measured pose in rad, ``covariance`` (takes, K, n,
    n) in rad² of the posterior and the measurement together, ``joints`` the n names.
    """
    refused = None
    try:
        log, squared, sharpness = (
            normal_log_score(error, covariance),
            nees(error, covariance),
            log_determinant(covariance),
        )
        energy = normal_energy_score(error, covariance)
    except ModelDomainError as missing:
        refused = str(missing)
        log = squared = sharpness = energy = np.full(error.shape[:2], np.nan)
    inside = np.abs(error) <= np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    rms, covered = {}, {}
    for j, joint in enumerate(joints):
        rms[f"rms_error_{joint}_rad"] = np.sqrt(np.mean(error[..., j] ** 2, axis=1))
        covered[f"coverage_of_one_sigma_{joint}"] = inside[..., j].mean(axis=1)
    proper = {"log_score": log.mean(axis=1), "energy_score_rad": energy.mean(axis=1)}
    return rms | proper | covered | _consistency(squared, sharpness, len(joints)), refused


def compared(scores: Mapping[str, Scores], rival: str) -> pd.DataFrame:
    """Every score of every model, and its paired difference over the takes to the model ``rival``
    with the 95 % interval.
    """
    rows = []
    for model, own in scores.items():
        for name, values in own.items():
            row = {"model": model, "score": name, "mean": values.mean()}
            if model != rival and values.ndim:
                difference = paired_difference(values, scores[rival][name])
                row |= {
                    "difference": difference.mean,
                    "low": difference.low,
                    "high": difference.high,
                }
            rows.append(row)
    return pd.DataFrame(rows, columns=["model", "score", "mean", "difference", "low", "high"])


def log_score_differences(scores: Mapping[str, Scores]) -> pd.DataFrame:
    """The paired difference in log score over the takes between any two models, ``model`` minus
    ``rival``, in nats, with its interval.
    """
    rows = []
    for model, rival in permutations(scores, 2):
        difference = paired_difference(scores[model]["log_score"], scores[rival]["log_score"])
        rows.append(
            {
                "model": model,
                "rival": rival,
                "difference": difference.mean,
                "low": difference.low,
                "high": difference.high,
            }
        )
    return pd.DataFrame(rows, columns=["model", "rival", "difference", "low", "high"])


def _consistency(squared: np.ndarray, sharpness: np.ndarray, dimension: int) -> Scores:
    """Calibration and sharpness from the NEES (takes, K) of errors in ``dimension`` joints and the
    log determinant (takes, K) of their law.

    The band of the NEES is for the mean over takes at one step, for takes are independent and steps
    are not.
    """
    low, high = nees_band(len(squared), dimension)
    by_step = squared.mean(axis=0)
    return {
        "coverage_of_the_95_percent_region": _share(
            lambda x: in_region(x, dimension), squared
        ).mean(axis=1),
        "nees": squared.mean(axis=1),
        "share_of_steps_with_nees_in_its_95_percent_band": _share(
            lambda x: (low <= x) & (x <= high), by_step
        ).mean(),
        "log_determinant": sharpness.mean(axis=1),
    }


def _share(holds: Callable[[np.ndarray], np.ndarray], values: np.ndarray) -> np.ndarray:
    """1 where ``holds`` does, 0 where it does not, and a gap where there is no value."""
    return np.where(np.isnan(values), np.nan, holds(values))
