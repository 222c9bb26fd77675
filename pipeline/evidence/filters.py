"""Evidence on filters: errors, bounds, and scores against the training mean."""

from collections.abc import Callable, Mapping, Sequence
from itertools import permutations

import numpy as np
import pandas as pd
from numpy.random import Generator

from pipeline.core.filters import NONE, SPEED, models_of
from pipeline.evidence.table import (
    Row,
    difference_row,
    evidence_row,
    evidence_table,
    following_rows,
)
from pipeline.statistics.curves import VARYING, following_tests, variation_limits
from pipeline.statistics.scores import (
    FOLLOWS,
    Filtered,
    bound_scores,
    posterior_scores,
    score_comparison,
)
from pipeline.statistics.takes import paired_difference, resampled_differences

COMPARED = (FOLLOWS, "relative_error_of_bound")  # quantities of the bound
Laws = Mapping[str, Mapping[str, np.ndarray]]  # filter → score → values (takes,)
Streams = Callable[[str], Generator]  # random stream of a name


def filter_evidence(
    filters: Mapping[str, Filtered],
    joints: Sequence[str],
    steady: np.ndarray,
    generator: Streams,
) -> tuple[pd.DataFrame, pd.DataFrame, list[str]]:
    """Return the evidence, the table ``filter_against_none``, and messages on posteriors without a
    log score. ``filters`` have the names of :mod:`pipeline.core.filters`; the models' filters are
    compared with the first model's, all filters with the training mean.

    The bounds also have the correlation with the error over the ``steady`` steps (K − 1,) alone.
    There the speed is constant and causes no correlation. ``generator`` returns the random stream
    of a name: "score.takes" resamples the takes, and each model has its own streams for the limits
    of the correlation (:func:`following_tests`) and of the variation over time of its error, so
    that no model changes the numbers of another.
    """
    laws = {}
    refusals = []
    for name, filtered in filters.items():
        laws[name], refused = posterior_scores(
            filtered.error,
            filtered.measured_covariance,
            joints,
        )
        if refused:
            message = (
                f"the posterior of {name} is not scored as a normal law: {refused}"
            )
            refusals.append(message)
    models = models_of(filters)
    bounds = {name: filters[name].bound for name in models}

    differences = bound_differences(filters, bounds, joints, generator("score.takes"))
    rows = bound_rows(filters, bounds, joints, steady, generator)
    by_rival = {rival: score_comparison(laws, rival) for rival in (models[0], NONE)}
    rows += score_rows(laws, by_rival[NONE], joints)
    rows += width_rows(bounds, joints)
    rows += differences
    rows += score_difference_rows(by_rival, joints)
    return evidence_table(rows), by_rival[NONE], refusals


def bound_rows(
    filters: Mapping[str, Filtered],
    bounds: Mapping[str, np.ndarray],
    joints: Sequence[str],
    steady: np.ndarray,
    generator: Streams,
) -> list[Row]:
    """Return the agreement of each model's bound with its error, with its limits and powers, and
    the limits of the variation of the error over time.
    """
    rival = bounds[SPEED].mean(axis=0) if SPEED in bounds else None
    at_constant_speed = np.append(False, steady)
    rows = []
    for name, bound in bounds.items():
        error = filters[name].error
        for joint, scores in bound_scores(error, bound, joints).items():
            for quantity, value in scores.items():
                rows.append(evidence_row(quantity, value, model=name, joint=joint))

        stream = generator(f"score.bound.{name}")
        tests = following_tests(
            bound.mean(axis=0),
            error,
            at_constant_speed,
            joints,
            stream,
            centred=False,
            rival=rival,
        )
        for row in following_rows(tests, FOLLOWS, "correlation_of_bound", name):
            row["steps"] = row["steps"].removeprefix("all")
            # over all steps it is among the scores of the bound
            if row["steps"] or row["quantity"] != FOLLOWS:
                rows.append(row)

        stream = generator(f"score.error.{name}")
        limits = variation_limits(error, stream, centred=False)
        for joint, ends in zip(joints, limits, strict=True):
            keys = {"model": name, "joint": joint}
            rows.append(evidence_row("error_variation_limits", VARYING, *ends, **keys))
    return rows


def bound_differences(
    filters: Mapping[str, Filtered],
    bounds: Mapping[str, np.ndarray],
    joints: Sequence[str],
    rng: Generator,
) -> list[Row]:
    """Return the quantities COMPARED of each model's bound minus the first model's."""
    places = [(joint, quantity) for joint in joints for quantity in COMPARED]

    def of_bound(model: str, takes: np.ndarray) -> np.ndarray:
        scores = bound_scores(filters[model].error[takes], bounds[model][takes], joints)
        return np.array([scores[joint][quantity] for joint, quantity in places])

    models = [*bounds]
    takes = len(filters[NONE].error)
    differences = resampled_differences(of_bound, models, takes, rng)
    rows = []
    for name in models[1:]:
        keys = {"model": name, "rival": models[0]}
        for (joint, quantity), row in zip(places, differences[name], strict=True):
            rows.append(difference_row(quantity, row, joint=joint, **keys))
    return rows


def width_rows(bounds: Mapping[str, np.ndarray], joints: Sequence[str]) -> list[Row]:
    """Return the differences of the mean bounds between any two models, paired over the takes."""
    rows = []
    for name, rival in permutations(bounds, 2):
        widths = bounds[name].mean(axis=1).T
        rival_widths = bounds[rival].mean(axis=1).T
        for joint, *pair in zip(joints, widths, rival_widths, strict=True):
            wider = paired_difference(*pair)
            keys = {"model": name, "rival": rival, "joint": joint}
            rows.append(difference_row("mean_bound_rad", wider, **keys))
    return rows


def compared_scores(joints: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return quantity and joint of the scores that are compared between filters."""
    scores = {"log_score": ("filter_log_score", "")}
    for joint in joints:
        scores[f"rms_error_{joint}_rad"] = ("rms_error_of_a_take", joint)
    return scores


def score_rows(
    laws: Laws,
    against_none: pd.DataFrame,
    joints: Sequence[str],
) -> list[Row]:
    """Return the mean scores of every filter in the table ``against_none``, and its coverages."""
    scores = compared_scores(joints)
    for joint in joints:
        scores[f"coverage_of_one_sigma_{joint}"] = ("coverage", joint)
    rows = []
    for row in against_none[against_none["score"].isin(scores)].itertuples():
        quantity, joint = scores[row.score]
        of_takes = laws[row.model][row.score]
        mean = paired_difference(of_takes, np.zeros(len(of_takes)))
        rows.append(difference_row(quantity, mean, model=row.model, joint=joint))
    return rows


def score_difference_rows(
    by_rival: Mapping[str, pd.DataFrame],
    joints: Sequence[str],
) -> list[Row]:
    """Return the differences in the compared scores from tables of :func:`score_comparison`."""
    scores = compared_scores(joints)
    rows = []
    for rival, table in by_rival.items():
        compared = table["score"].isin(scores) & (table["model"] != rival)
        for row in table[compared].itertuples():
            quantity, joint = scores[row.score]
            keys = {"model": row.model, "rival": rival, "joint": joint}
            rows.append(difference_row(quantity, row, **keys))
    return rows
