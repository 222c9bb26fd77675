"""Tables that the filters of the test takes are compared by, among them the training mean: mean
and covariance of the training takes at each step, known without the depth camera.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.core.filters import NONE, models_of
from pipeline.statistics.curves import correlation, relative_error, root_mean_square, variation
from pipeline.statistics.scores import compared, posterior_scores
from pipeline.statistics.takes import Quantities, resampled_differences, takes_moments


@dataclass(frozen=True)
class Filtered:
    """A filter's posterior on the test takes."""

    error: np.ndarray  # (takes, K, n) rad, mean minus measured pose
    covariance: np.ndarray  # (takes, K, n, n) rad², of the pose
    measurement: np.ndarray  # (n, n) rad², with it the covariance of the pose as it is measured

    @property
    def bound(self) -> np.ndarray:
        """(takes, K, n) rad, standard deviation of the pose as it is measured."""
        return np.sqrt(np.diagonal(self.covariance + self.measurement, axis1=-2, axis2=-1))


def no_filter(training: np.ndarray, measured: np.ndarray) -> Filtered:
    """Mean and covariance of ``training`` (N, K, n) at each step, measurement noise included, for
    the test takes ``measured`` (takes, K, n), both in rad.
    """
    mean, covariance = takes_moments(training)
    return Filtered(
        mean - measured,
        np.broadcast_to(covariance, (len(measured), *covariance.shape)),
        np.zeros(covariance.shape[1:]),
    )


def filter_tables(
    filters: Mapping[str, Filtered],
    joints: Sequence[str],
    steady: np.ndarray,
    rng: np.random.Generator,
) -> tuple[dict[str, pd.DataFrame], list[str]]:
    """The tables by name, and the posteriors that are not scored as normal laws, with the reason.

    ``filter_scores`` of every filter and joint; ``bound_comparison`` of the models' filters, as the
    paper has them; ``filter_comparison`` of all to the first model's, ``filter_against_none`` of
    all to the training mean.

    Args:
        filters: by the names of :mod:`pipeline.core.filters`, the training mean among them.
        joints: names of the n joints.
        steady: (K − 1,) steps at constant speed.
        rng: resamples the takes.
    """
    error = {name: each.error for name, each in filters.items()}
    bound = {name: each.bound for name, each in filters.items()}
    models, laws, refusals = models_of(filters), {}, []
    for name, each in filters.items():
        covariance = each.covariance + each.measurement
        laws[name], refused = posterior_scores(each.error, covariance, joints)
        if refused:
            refusals.append(f"the posterior of {name} is not scored as a normal law: {refused}")
    quantities = bound_quantities(error, bound, joints)
    return {
        "filter_scores": filter_scores(error, bound, joints, steady),
        "bound_comparison": resampled_differences(quantities, models, len(error[NONE]), rng),
        "filter_comparison": compared(laws, models[0]),
        "filter_against_none": compared(laws, NONE),
    }, refusals


def bound_scores(error: np.ndarray, bound: np.ndarray) -> dict[str, float]:
    """Accuracy of a filter in one joint, width of its ±1σ bound, and agreement of the bound with
    the error over time.

    ``error`` and ``bound`` (takes, K) in rad: posterior mean minus truth, and the posterior's
    standard deviation.
    """
    running, width = np.sqrt(np.mean(error**2, axis=0)), bound.mean(axis=0)
    with np.errstate(divide="ignore"):  # infinite where all weight is on one particle in every take
        range_of_width = width.max() / width.min()
    return {
        "rms_error_rad": root_mean_square(error),
        "mean_bound_rad": bound.mean(),
        "coverage_of_the_bound": float(np.mean(np.abs(error) <= bound)),
        "bound_greatest_over_least": range_of_width,
        "bound_variation": variation(width),
        "error_variation": variation(running),
        "correlation_of_bound_with_error": correlation(width, running),
        "relative_error_of_bound": relative_error(width, running),
    }


def bound_quantities(
    error: Mapping[str, np.ndarray], bound: Mapping[str, np.ndarray], joints: Sequence[str]
) -> Quantities:
    """:func:`bound_scores` of any of the takes, by quantity and joint, of ``error`` and ``bound``
    (takes, K, n) in rad by model.
    """

    def quantities(model: str, takes: np.ndarray) -> dict[str, float]:
        scores = [
            bound_scores(error[model][takes, :, j], bound[model][takes, :, j])
            for j in range(len(joints))
        ]
        return {
            f"{name}_{joint}": value
            for joint, own in zip(joints, scores, strict=True)
            for name, value in own.items()
        }

    return quantities


def filter_scores(
    error: Mapping[str, np.ndarray],
    bound: Mapping[str, np.ndarray],
    joints: Sequence[str],
    steady: np.ndarray,
) -> pd.DataFrame:
    """:func:`bound_scores` of every model's filter and joint, a row each, and the correlation of
    bound and error over the ``steady`` steps (K − 1,) alone: what follows there follows the pose
    and not the speed.

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
    """The rows of :func:`filter_scores` by names with model, joint, quantity and unit."""
    names = scores.columns.drop(["model", "joint"])
    return {
        f"{row.model}_{row.joint}_{name}": getattr(row, name)
        for row in scores.itertuples()
        for name in names
    }


def sensor_scores(
    bias: np.ndarray, variance: np.ndarray, takes: int, joints: Sequence[str]
) -> dict[str, float]:
    """Bias and standard deviation of the depth camera's noise in the joint angles, and their
    variation over time.

    ``bias`` (F, n) in rad and ``variance`` (F, n) in rad² of each frame, the bias being the mean
    over ``takes``; ``joints`` the n names. A bias that is zero, or constant, is about 1 in units of
    its standard error.
    """
    scores = {}
    for j, joint in enumerate(joints):
        mean, std = bias[:, j], np.sqrt(variance[:, j])
        standard_error, name = np.sqrt(variance[:, j].mean() / takes), f"kinect_bias_{joint}"
        scores |= {
            f"{name}_rms_rad": root_mean_square(mean),
            f"{name}_over_standard_error": root_mean_square(mean) / standard_error,
            f"{name}_variation_over_standard_error": mean.std() / standard_error,
            f"kinect_std_{joint}_rms_rad": np.sqrt(variance[:, j].mean()),
            f"kinect_std_{joint}_variation": variation(std),
        }
    return scores
