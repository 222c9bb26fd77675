"""Filters of the test takes beside no filter at all: the tables that they are compared by.

No filter is what is known without the depth camera: the training takes' mean and covariance at each
step. A filter that loses against it takes more from its model than it gains from the camera.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.core.filters import NONE, models_of
from pipeline.statistics.joint_scores import filter_scores
from pipeline.statistics.resampling import bound_quantities, resampled_differences
from pipeline.statistics.take_scores import compared, posterior_scores
from pipeline.statistics.takes import takes_moments


@dataclass(frozen=True)
class Filtered:
    """What a filter says of the test takes; its ``covariance`` is that of the pose, and with
    ``measurement`` (n, n) in rad² that of the pose as it is measured.
    """

    error: np.ndarray  # (takes, K, n) rad, mean minus measured pose
    covariance: np.ndarray  # (takes, K, n, n) rad²
    measurement: np.ndarray

    @property
    def bound(self) -> np.ndarray:
        """(takes, K, n) rad, standard deviation of the pose as it is measured."""
        return np.sqrt(np.diagonal(self.covariance + self.measurement, axis1=-2, axis2=-1))


def no_filter(training: np.ndarray, measured: np.ndarray) -> Filtered:
    """The mean and covariance of ``training`` (N, K, n) at each step, for the test takes
    ``measured`` (takes, K, n), both in rad; it holds the noise of a measured pose already.
    """
    n = training.shape[-1]
    mean, covariance = takes_moments(training)
    return Filtered(
        mean - measured,
        np.broadcast_to(covariance, (len(measured), *covariance.shape)),
        np.zeros((n, n)),
    )


def filter_tables(
    filters: Mapping[str, Filtered],
    joints: Sequence[str],
    steady: np.ndarray,
    rng: np.random.Generator,
) -> tuple[dict[str, pd.DataFrame], list[str]]:
    """The tables by name, and which posteriors are not scored as normal laws, and why.

    ``filter_scores`` of every filter and joint; ``bound_comparison`` of the models' filters, as the
    paper has them; ``filter_comparison`` of all to the first model's, ``filter_against_none`` of
    all to no filter.

    Args:
        filters: by the names of :mod:`pipeline.core.filters`, no filter among them.
        joints: names of the n joints.
        steady: (K − 1,) which steps go at constant speed.
        rng: resamples the takes.
    """
    error = {name: each.error for name, each in filters.items()}
    bound = {name: each.bound for name, each in filters.items()}
    models, laws, refusals = models_of(filters), {}, []
    for name, each in filters.items():
        laws[name], refused = posterior_scores(
            each.error, each.covariance + each.measurement, joints
        )
        if refused:
            refusals.append(f"the posterior of {name} is not scored as a normal law: {refused}")
    quantities = bound_quantities(error, bound, joints)
    takes = len(error[NONE])
    return {
        "filter_scores": filter_scores(error, bound, joints, steady),
        "bound_comparison": resampled_differences(quantities, models, takes, rng),
        "filter_comparison": compared(laws, models[0]),
        "filter_against_none": compared(laws, NONE),
    }, refusals
