"""Evidence on filters: errors, bounds, and scores against the training mean."""

from collections.abc import Callable, Mapping, Sequence
from itertools import permutations

import numpy as np
import pandas as pd

from pipeline.core.filters import NONE, SPEED, models_of
from pipeline.evidence.table import (
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


def filter_evidence(
    filters: Mapping[str, Filtered],
    joints: Sequence[str],
    steady: np.ndarray,
    generator: Callable[[str], np.random.Generator],
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
    laws, refusals, rows, models = {}, [], [], models_of(filters)
    for name, each in filters.items():
        laws[name], refused = posterior_scores(
            each.error, each.measured_covariance, joints
        )
        if refused:
            refusals.append(
                f"the posterior of {name} is not scored as a normal law: {refused}"
            )
    bounds = {name: filters[name].bound for name in models}
    rival = bounds[SPEED].mean(axis=0) if SPEED in bounds else None

    def of_bound(model: str, takes: np.ndarray) -> np.ndarray:
        scores = bound_scores(filters[model].error[takes], bounds[model][takes], joints)
        return np.array([scores[joint][name] for joint in joints for name in COMPARED])

    takes = len(filters[NONE].error)
    stream = generator("score.takes")
    differences = resampled_differences(of_bound, models, takes, stream)
    for name in models:
        error, bound = filters[name].error, bounds[name]
        for joint, scores in bound_scores(error, bound, joints).items():
            keys = {"model": name, "joint": joint}
            rows += [
                evidence_row(quantity, value, **keys)
                for quantity, value in scores.items()
            ]
        chosen = np.append(False, steady)
        stream = generator(f"score.bound.{name}")
        tests = following_tests(
            bound.mean(axis=0),
            error,
            chosen,
            joints,
            stream,
            centred=False,
            rival=rival,
        )
        for row in following_rows(tests, FOLLOWS, "correlation_of_bound", name):
            row["steps"] = row["steps"].removeprefix("all")
            rows += [row] if row["steps"] or row["quantity"] != FOLLOWS else []
        stream = generator(f"score.error.{name}")
        limits = variation_limits(error, stream, centred=False)
        for joint, ends in zip(joints, limits, strict=True):
            keys = {"model": name, "joint": joint}
            rows.append(evidence_row("error_variation_limits", VARYING, *ends, **keys))
    scores = {"log_score": ("filter_log_score", "")}
    scores |= {
        f"rms_error_{joint}_rad": ("rms_error_of_a_take", joint) for joint in joints
    }
    every = scores | {
        f"coverage_of_one_sigma_{joint}": ("coverage", joint) for joint in joints
    }
    tables = {rival: score_comparison(laws, rival) for rival in (models[0], NONE)}
    for own in tables[NONE][tables[NONE]["score"].isin(every)].itertuples():
        (quantity, joint), of_takes = every[own.score], laws[own.model][own.score]
        mean = paired_difference(of_takes, np.zeros(len(of_takes)))
        rows.append(difference_row(quantity, mean, model=own.model, joint=joint))
    for name, other in permutations(models, 2):
        widths = [bounds[model].mean(axis=1).T for model in (name, other)]
        for joint, *pair in zip(joints, *widths, strict=True):
            wider = paired_difference(*pair)
            keys = {"model": name, "rival": other, "joint": joint}
            rows.append(difference_row("mean_bound_rad", wider, **keys))
    for name in models[1:]:
        places = [(joint, quantity) for joint in joints for quantity in COMPARED]
        for (joint, quantity), own in zip(places, differences[name], strict=True):
            rows.append(
                difference_row(quantity, own, model=name, rival=models[0], joint=joint)
            )
    for rival, table in tables.items():
        for own in table[
            table["score"].isin(scores) & (table["model"] != rival)
        ].itertuples():
            quantity, joint = scores[own.score]
            rows.append(
                difference_row(quantity, own, model=own.model, rival=rival, joint=joint)
            )
    return evidence_table(rows), tables[NONE], refusals
