"""How filters' bounds, sensors and models agree with the recordings, joint by joint; scores are
named by the joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pipeline.statistics.agreement import correlation, coverage, root_mean_square, variation
from pipeline.statistics.scores import relative_error


def bound_scores(error: np.ndarray, bound: np.ndarray) -> dict[str, float]:
    """Accuracy of a filter in one joint, width of its ±1σ bound, and whether the bound follows the
    error over time.

    ``error`` and ``bound`` (takes, K) in rad: posterior mean minus truth, and the posterior's
    standard deviation.
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


def filter_scores(
    error: Mapping[str, np.ndarray],
    bound: Mapping[str, np.ndarray],
    joints: Sequence[str],
    steady: np.ndarray,
) -> pd.DataFrame:
    """:func:`bound_scores` of every model's filter and joint, a row each, and how far the bound
    follows the error over the ``steady`` steps (K − 1,) at constant speed alone: what follows there
    follows the pose and not the speed.

    ``error`` and ``bound`` (takes, K, n) in rad by model, ``joints`` the n names.
    """
    rows = []
    for model in error:
        for j, joint in enumerate(joints):
            scores = bound_scores(error[model][..., j], bound[model][..., j])
            at_speed = [part[model][:, 1:, j][:, steady] for part in (error, bound)]
            follows = correlation(
                at_speed[1].mean(axis=0), np.sqrt(np.mean(at_speed[0] ** 2, axis=0))
            )
            scores["correlation_of_bound_with_error_at_constant_speed"] = follows
            rows.append({"model": model, "joint": joint} | scores)
    return pd.DataFrame(rows)


def filter_metrics(scores: pd.DataFrame) -> dict[str, float]:
    """The rows of :func:`filter_scores` by names that say model, joint, quantity and unit."""
    names = scores.columns.drop(["model", "joint"])
    return {
        f"{row.model}_{row.joint}_{name}": getattr(row, name)
        for row in scores.itertuples()
        for name in names
    }


def sensor_scores(
    bias: np.ndarray, variance: np.ndarray, takes: int, joints: Sequence[str]
) -> dict[str, float]:
    """The depth camera's noise in the joint angles: its bias, and how bias and standard deviation
    vary over time.

    ``bias`` (F, n) in rad and ``variance`` (F, n) in rad² of each frame, the bias being the mean
    over ``takes``; ``joints`` the n names. A bias that is zero, or constant, is about 1 in units of
    its standard error.
    """
    scores = {}
    for j, joint in enumerate(joints):
        mean, std = bias[:, j], np.sqrt(variance[:, j])
        rms = np.sqrt(variance[:, j].mean())
        standard_error = np.sqrt(variance[:, j].mean() / takes)
        scores |= {
            f"kinect_bias_{joint}_rms_rad": root_mean_square(mean),
            f"kinect_bias_{joint}_over_standard_error": root_mean_square(mean) / standard_error,
            f"kinect_bias_{joint}_variation_over_standard_error": mean.std() / standard_error,
            f"kinect_std_{joint}_rms_rad": rms,
            f"kinect_std_{joint}_variation": variation(std),
        }
    return scores


def spread_scores(
    std: Mapping[str, np.ndarray],
    error: Mapping[str, np.ndarray],
    joints: Sequence[str],
    steady: np.ndarray,
) -> dict[str, float]:
    """How each model's mean and standard deviation over time agree with the recorded ones, by names
    that say model, joint and unit.

    ``std`` (M, n) in rad by model, and under ``recorded`` what was recorded; ``error`` (M,) in rad
    by model, ‖mean − recorded mean‖; ``joints`` the n names. Of the ``steady`` steps (M,) at
    constant speed there is a correlation of their own: what follows there follows the pose and not
    the speed. A model whose standard deviation does not exist (not finite) has none here.
    """
    scores = {f"{model}_greatest_mean_error_rad": values.max() for model, values in error.items()}
    scores |= {
        f"{model}_std_of_mean_error_over_time_rad": values.std() for model, values in error.items()
    }
    for j, joint in enumerate(joints):
        recorded = std["recorded"][:, j]
        for model, values in std.items():
            modelled, name = values[:, j], f"{model}_std_{joint}"
            if not np.all(np.isfinite(modelled)):
                continue
            scores[f"{name}_rms_rad"] = root_mean_square(modelled)
            scores[f"{name}_variation"] = variation(modelled)
            if model != "recorded":
                scores[f"{name}_correlation_with_recorded"] = correlation(modelled, recorded)
                scores[f"{name}_correlation_with_recorded_at_constant_speed"] = correlation(
                    modelled[steady], recorded[steady]
                )
                scores[f"{name}_relative_error"] = relative_error(modelled, recorded)
    return scores
