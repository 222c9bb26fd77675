"""Evidence on filters: errors, bounds, and scores against the training mean."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pipeline.core.filters import NONE, models_of
from pipeline.evidence.table import difference_row, evidence_row, evidence_table
from pipeline.statistics.curves import following_tests
from pipeline.statistics.scores import FOLLOWS, Filtered, bound_scores, filter_tables


def filter_evidence(
    filters: Mapping[str, Filtered],
    joints: Sequence[str],
    steady: np.ndarray,
    rng: np.random.Generator,
) -> tuple[pd.DataFrame, pd.DataFrame, list[str]]:
    """Return the evidence, the table ``filter_against_none``, and messages on posteriors without a
    log score. ``filters`` have the names of :mod:`pipeline.core.filters`.

    The bounds also have the correlation with the error over the ``steady`` steps (K − 1,) alone.
    There the speed is constant and causes no correlation. ``rng`` resamples the takes, then draws
    for the limits of the correlation (:func:`following_tests`).
    """
    rows, (tables, refusals) = [], filter_tables(filters, joints, rng)
    for name in models_of(filters):
        error, bound = filters[name].error, filters[name].bound
        for joint, scores in bound_scores(error, bound, joints).items():
            keys = {"model": name, "joint": joint}
            rows += [evidence_row(quantity, value, **keys) for quantity, value in scores.items()]
        chosen = np.append(False, steady)
        tests = following_tests(bound.mean(axis=0), error, chosen, joints, rng, centred=False)
        for own in tests.itertuples():
            keys = {"model": name, "joint": own.joint, "steps": own.steps.removeprefix("all")}
            if keys["steps"]:
                rows.append(evidence_row(FOLLOWS, own.correlation, **keys))
            rows.append(evidence_row("correlation_of_bound_limit", own.limit, **keys))
            rows.append(evidence_row("correlation_of_bound_power", own.power, **keys))
    bounds, scores = {}, {"log_score": {"quantity": "filter_log_score"}}
    for joint in joints:
        for quantity in (FOLLOWS, "relative_error_of_bound"):
            bounds[f"{quantity}_{joint}"] = {"quantity": quantity, "joint": joint}
        scores[f"rms_error_{joint}_rad"] = {"quantity": "rms_error_of_a_take", "joint": joint}
        scores[f"coverage_of_one_sigma_{joint}"] = {"quantity": "coverage", "joint": joint}
    against, first = tables["filter_against_none"], models_of(filters)[0]
    for own in against[against["score"].isin(scores)].itertuples():
        rows.append(evidence_row(value=own.mean, **scores[own.score], model=own.model))
    compared = {name: place for name, place in scores.items() if place["quantity"] != "coverage"}
    for name, places, rival in (
        ("bound_comparison", bounds, first),
        ("filter_comparison", compared, first),
        ("filter_against_none", compared, NONE),
    ):
        table = tables[name].rename(columns={"quantity": "score"})
        for own in table[table["score"].isin(places) & (table["model"] != rival)].itertuples():
            rows.append(difference_row(own=own, model=own.model, rival=rival, **places[own.score]))
    return evidence_table(rows), against, refusals
