"""Comparison of the filters of the test takes, among them the training mean: mean and covariance of
the training takes at each step, known without a measurement.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.core.filters import NONE, models_of
from pipeline.statistics.curves import correlation, relative_error, root_mean_square, variation
from pipeline.statistics.scores import compared, posterior_scores
from pipeline.statistics.takes import resampled_differences, takes_moments

FOLLOWS = "correlation_of_bound_with_error"


@dataclass(frozen=True)
class Filtered:
    """A filter's posterior on the test takes."""

    error: ndarray  # (takes, K, n) rad, mean minus measured pose
    covariance: ndarray  # (takes, K, n, n) rad², of the pose
    measurement: ndarray  # (n, n) rad², with it the covariance of the pose as it is measured

    @property
    def bound(self) -> ndarray:
        """(takes, K, n) rad, standard deviation of the pose as it is measured."""
        return np.sqrt(np.diagonal(self.covariance + self.measurement, axis1=-2, axis2=-1))


def no_filter(training: ndarray, measured: ndarray) -> Filtered:
    """Mean and covariance of ``training`` (N, K, n) at each step, measurement noise included, for
    the test takes ``measured`` (takes, K, n), both in rad.
    """
    mean, covariance = takes_moments(training)
    covariances = np.broadcast_to(covariance, (len(measured), *covariance.shape))
    return Filtered(mean - measured, covariances, np.zeros(covariance.shape[1:]))


def filter_tables(
    filters: Mapping[str, Filtered], joints: Sequence[str], rng: np.random.Generator
) -> tuple[dict[str, pd.DataFrame], list[str]]:
    """Return the tables by name, and why posteriors are not scored as normal laws.

    ``bound_comparison`` of the models' filters, ``filter_comparison`` of all to the first model's,
    ``filter_against_none`` to the training mean. ``filters`` by the names of
    :mod:`pipeline.core.filters`, the training mean among them; ``rng`` resamples the takes.
    """
    models, laws, refusals = models_of(filters), {}, []
    bounds = {name: each.bound for name, each in filters.items()}
    for name, each in filters.items():
        covariance = each.covariance + each.measurement
        laws[name], refused = posterior_scores(each.error, covariance, joints)
        if refused:
            refusals.append(f"the posterior of {name} is not scored as a normal law: {refused}")

    def quantities(model: str, takes: ndarray) -> dict[str, float]:
        scores = bound_scores(filters[model].error[takes], bounds[model][takes], joints)
        return {f"{name}_{joint}": x for joint, own in scores.items() for name, x in own.items()}

    takes = len(filters[NONE].error)
    return {
        "bound_comparison": resampled_differences(quantities, models, takes, rng),
        "filter_comparison": compared(laws, models[0]),
        "filter_against_none": compared(laws, NONE),
    }, refusals


def bound_scores(
    error: ndarray, bound: ndarray, joints: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Return by joint the accuracy of a filter, the width of its ±1σ bound and the agreement of the
    bound with the error over time; ``error`` posterior mean minus truth and ``bound`` standard
    deviation (takes, K, n) in rad.
    """
    scores = {}
    for j, joint in enumerate(joints):
        off, wide = error[..., j], bound[..., j]
        running, width = np.sqrt(np.mean(off**2, axis=0)), wide.mean(axis=0)
        scores[joint] = {
            "rms_error_rad": root_mean_square(off),
            "mean_bound_rad": wide.mean(),
            "bound_variation": variation(width),
            "error_variation": variation(running),
            FOLLOWS: correlation(width, running),
            "relative_error_of_bound": relative_error(width, running),
        }
    return scores


def filter_metrics(
    filters: Mapping[str, Filtered], joints: Sequence[str], steady: ndarray
) -> dict[str, float]:
    """Return the :func:`bound_scores` of every filter by names with model, joint and unit, and the
    correlation of bound and error over the ``steady`` steps (K − 1,) alone, where they follow the
    pose and not the speed.
    """
    metrics = {}
    for name, each in filters.items():
        at_speed = (part[:, 1:][:, steady] for part in (each.error, each.bound))
        at_speed = bound_scores(*at_speed, joints)
        for joint, own in bound_scores(each.error, each.bound, joints).items():
            own[f"{FOLLOWS}_at_constant_speed"] = at_speed[joint][FOLLOWS]
            metrics |= {f"{name}_{joint}_{quantity}": value for quantity, value in own.items()}
    return metrics


def sensor_scores(
    bias: ndarray, variance: ndarray, takes: int, joints: Sequence[str]
) -> dict[str, float]:
    """Return bias and standard deviation of the depth camera's noise in the joint angles, and their
    variation over time, of ``bias`` (F, n) in rad, the mean over ``takes``, and ``variance`` (F, n)
    in rad² of each frame. A bias that is zero, or constant, is about 1 standard error.
    """
    scores = {}
    for joint, mean, own in zip(joints, bias.T, variance.T, strict=True):
        standard_error, name = np.sqrt(own.mean() / takes), f"kinect_bias_{joint}"
        scores |= {
            f"{name}_over_standard_error": root_mean_square(mean) / standard_error,
            f"{name}_variation_over_standard_error": mean.std() / standard_error,
            f"kinect_std_{joint}_variation": variation(np.sqrt(own)),
        }
    return scores
