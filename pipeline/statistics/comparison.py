"""Models side by side: scores summed up over the steps of a take, and their paired differences over the takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import permutations

import numpy as np
import pandas as pd

from pipeline.errors import ModelDomainError
from pipeline.statistics.agreement import correlation, coverage, root_mean_square, variation
from pipeline.statistics.scores import (
    in_region,
    log_determinant,
    nees,
    nees_band,
    normal_energy_score,
    normal_log_score,
    paired_difference,
    relative_error,
)

Scores = dict[str, np.ndarray]  # score → (takes,) values, or one value of all takes together


def prediction_scores(steps: Mapping[str, np.ndarray], *, moving: bool) -> Scores:
    """Each score of the predictions of one step as its mean over the K steps of a take.

    ``steps``: the scores (takes, K) by the names of :func:`pipeline.motion.prediction.score_steps`. ``moving``: whether none of them is
    at rest, so that there is a score without measurement noise.
    """
    scores = {"log_score": steps["log_density"]}
    if moving:
        noiseless = steps["log_density_noiseless"]
        scores |= {"log_score_without_measurement_noise": noiseless, "ruled_out_without_measurement_noise": _share(np.isneginf, noiseless)}
    scores |= {"energy_score_rad": steps["energy"]}
    scores |= {f"coverage_of_one_sigma_q{j}": _share(lambda z: np.abs(z) <= 1, steps[f"z{j}"]) for j in (1, 2, 3)}
    return {name: values.mean(axis=1) for name, values in scores.items()} | _consistency(steps["nees"], steps["log_determinant"])


def posterior_scores(error: np.ndarray, covariance: np.ndarray) -> tuple[Scores, str | None]:
    """Scores of a filter's posterior as a normal law of the pose that was measured, over the K steps of each take; why some are missing.

    ``error`` (takes, K, 3) posterior mean minus measured pose in rad, ``covariance`` (takes, K, 3, 3) in rad² of the posterior and the
    measurement together.
    """
    refused = None
    try:
        log, squared, sharpness = normal_log_score(error, covariance), nees(error, covariance), log_determinant(covariance)
        energy = normal_energy_score(error, covariance)
    except ModelDomainError as missing:
        refused = str(missing)
        log = squared = sharpness = energy = np.full(error.shape[:2], np.nan)
    inside = np.abs(error) <= np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    rms = {f"rms_error_q{j}_rad": np.sqrt(np.mean(error[..., j - 1] ** 2, axis=1)) for j in (1, 2, 3)}
    covered = {f"coverage_of_one_sigma_q{j}": inside[..., j - 1].mean(axis=1) for j in (1, 2, 3)}
    proper = {"log_score": log.mean(axis=1), "energy_score_rad": energy.mean(axis=1)}
    return rms | proper | covered | _consistency(squared, sharpness), refused


def bound_scores(error: np.ndarray, bound: np.ndarray) -> dict[str, float]:
    """Accuracy of a filter in one joint, width of its ±1σ bound, and whether the bound follows the error over time.

    ``error`` and ``bound`` (takes, K) in rad: posterior mean minus truth, and the posterior's standard deviation.
    """
    running, width = np.sqrt(np.mean(error**2, axis=0)), bound.mean(axis=0)
    with np.errstate(divide="ignore"):
        # infinite where without resampling all weight is on one particle in every take
        range_of_width = width.max() / width.min()
    return {
        "rms_error_rad": root_mean_square(error),
        "mean_bound_rad": bound.mean(),
        "coverage_of_the_bound": coverage(error, bound),
        "bound_greatest_over_least": range_of_width,
        "bound_variation": variation(width),
        "error_variation": variation(running),
        "correlation_of_bound_with_error": correlation(width, running),
        "relative_error_of_bound": relative_error(width, running),
    }


def filter_scores(error: Mapping[str, np.ndarray], bound: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """:func:`bound_scores` of every model's filter and joint, a row each; ``error`` and ``bound`` (takes, K, 3) in rad by model."""
    joints = [(model, j) for model in error for j in (1, 2, 3)]
    rows = [{"model": model, "joint": j} | bound_scores(error[model][..., j - 1], bound[model][..., j - 1]) for model, j in joints]
    return pd.DataFrame(rows)


def filter_metrics(scores: pd.DataFrame) -> dict[str, float]:
    """The same scores by names that say model, joint, quantity and unit."""
    names = scores.columns.drop(["model", "joint"])
    return {f"{row.model}_q{row.joint}_{name}": getattr(row, name) for row in scores.itertuples() for name in names}


def sensor_scores(bias: np.ndarray, variance: np.ndarray, takes: int) -> dict[str, float]:
    """The depth camera's noise in the joint angles: its bias, and how bias and standard deviation vary over time.

    ``bias`` (F, 3) in rad and ``variance`` (F, 3) in rad² of each frame, the bias being the mean over ``takes``. In units of the bias's
    standard error a bias that is nothing, or does not vary, is about 1.
    """
    scores = {}
    for j in range(3):
        of_joint, name = bias[:, j], f"q{j + 1}"
        standard_error = np.sqrt(variance[:, j].mean() / takes)
        scores[f"kinect_bias_{name}_rms_rad"] = root_mean_square(of_joint)
        scores[f"kinect_bias_{name}_over_standard_error"] = root_mean_square(of_joint) / standard_error
        scores[f"kinect_bias_{name}_variation_over_standard_error"] = of_joint.std() / standard_error
        scores[f"kinect_std_{name}_rms_rad"] = np.sqrt(variance[:, j].mean())
        scores[f"kinect_std_{name}_variation"] = variation(np.sqrt(variance[:, j]))
    return scores


def spread_scores(std: Mapping[str, np.ndarray], error: Mapping[str, np.ndarray]) -> dict[str, float]:
    """How each model's mean and standard deviation over time agree with the recorded ones, by names that say model, joint and unit.

    ``std`` (M, 3) in rad by model, and under ``recorded`` what was recorded; ``error`` (M,) in rad by model, ‖mean − recorded mean‖. A
    model whose standard deviation does not exist (not finite) has none here.
    """
    scores = {f"{model}_greatest_mean_error_rad": values.max() for model, values in error.items()}
    scores |= {f"{model}_std_of_mean_error_over_time_rad": values.std() for model, values in error.items()}
    for j in range(3):
        recorded = std["recorded"][:, j]
        for model, values in std.items():
            of_joint, name = values[:, j], f"{model}_std_q{j + 1}"
            if np.all(np.isfinite(of_joint)):
                scores |= {f"{name}_rms_rad": root_mean_square(of_joint), f"{name}_variation": variation(of_joint)}
                if model != "recorded":
                    scores[f"{name}_correlation_with_recorded"] = correlation(of_joint, recorded)
                    scores[f"{name}_relative_error"] = relative_error(of_joint, recorded)
    return scores


def compared(scores: Mapping[str, Scores]) -> pd.DataFrame:
    """Every score of every model, and its paired difference over the takes to the first model with the 95 % interval."""
    first, *_ = scores
    rows = []
    for model, of_model in scores.items():
        for name, values in of_model.items():
            row = {"model": model, "score": name, "mean": values.mean()}
            if model != first and values.ndim:
                difference = paired_difference(values, scores[first][name])
                row |= {"difference": difference.mean, "low": difference.low, "high": difference.high}
            rows.append(row)
    return pd.DataFrame(rows, columns=["model", "score", "mean", "difference", "low", "high"])


def log_score_differences(scores: Mapping[str, Scores]) -> pd.DataFrame:
    """The paired difference in log score over the takes between any two models, ``model`` minus ``rival``, in nats, with its interval."""
    rows = []
    for model, rival in permutations(scores, 2):
        difference = paired_difference(scores[model]["log_score"], scores[rival]["log_score"])
        rows.append({"model": model, "rival": rival, "difference": difference.mean, "low": difference.low, "high": difference.high})
    return pd.DataFrame(rows, columns=["model", "rival", "difference", "low", "high"])


def _consistency(squared: np.ndarray, sharpness: np.ndarray) -> Scores:
    """Calibration and sharpness from the NEES (takes, K) of errors of three joints and the log determinant (takes, K) of their law.

    The band of the NEES is for the mean over takes at one step, for takes are independent and steps are not.
    """
    low, high = nees_band(len(squared), 3)
    by_step = squared.mean(axis=0)
    return {
        "coverage_of_the_95_percent_region": _share(lambda x: in_region(x, 3), squared).mean(axis=1),
        "nees": squared.mean(axis=1),
        "share_of_steps_with_nees_in_its_95_percent_band": _share(lambda x: (low <= x) & (x <= high), by_step).mean(),
        "log_determinant": sharpness.mean(axis=1),
    }


def _share(holds: Callable[[np.ndarray], np.ndarray], values: np.ndarray) -> np.ndarray:
    """1 where ``holds`` does, 0 where it does not, and a gap where there is no value."""
    return np.where(np.isnan(values), np.nan, holds(values))
