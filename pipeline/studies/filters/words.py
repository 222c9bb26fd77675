"""The page of the study: does any filter beat none, and how near does it come to a filter
that knows the laboratory?
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.core.filters import CLOSED, MEMORY, NONE
from pipeline.studies import page
from pipeline.studies.filters.scores import (
    ALL,
    AT_REST,
    COVERAGE,
    FIRST_ORDER,
    INFORMED,
    LOG,
    RMS,
    YARDSTICK,
    over_none,
    verdicts,
)
from pipeline.verdicts import filters
from pipeline.verdicts.wording import table

TITLE = "Each filter between no filter and the best linear one that knows the laboratory"
LABELS = {
    FIRST_ORDER: "linear, first order",
    YARDSTICK: "yardstick",
    INFORMED: "yardstick that knows the camera",
}
OUTLASTS = float(np.exp(-1))  # correlation a frame later, from which a deviation outlasts it
CALIBRATED = (0.65, 0.71)  # coverage of one sigma


def missing() -> list[str]:
    """The page of a dataset without a laboratory or a depth camera."""
    return [
        "The dataset has no synthetic laboratory whose law a yardstick could know, or no depth "
        "camera."
    ]


def label(name: str) -> str:
    """Of the filter ``name``."""
    return LABELS.get(name) or filters.label(name)


def sections(
    placed: pd.DataFrame, lasting: pd.DataFrame, joints: Sequence[str], response: np.ndarray
) -> list[str]:
    """The page's sections, from the study's tables and the camera's ``response`` (n, n)."""
    return [
        _first(placed),
        "## The filters of the run",
        _levels(placed, joints),
        "Differences to no filter, paired over the test takes, with 95 % intervals; "
        "in percent, where there is a gain, its share of what the yardstick that knows the camera "
        "gains.",
        _differences(placed, joints),
        page.figure("filters", "filters"),
        "## What each row knows",
        _knowledge(joints, response),
        "## Over how long deviations last",
        _durations(lasting),
        _sweep(lasting, joints),
    ]


def _first(placed: pd.DataFrame) -> str:
    """Does any filter beat none, and does a closed loop lose to it?"""
    by_filter = dict(list(verdicts(placed).groupby("filter", sort=False)))
    beating = [
        name for name, rows in by_filter.items() if rows["better"].any() and not rows["worse"].any()
    ]
    models = [name for name in beating if name not in (*LABELS, MEMORY)]
    linear = [name for name in beating if name in (FIRST_ORDER, MEMORY)]
    loops = [
        f"- the closed loop of {name.removesuffix(CLOSED)} loses in {_scores(rows, 'worse')} and "
        f"gains in {_scores(rows, 'better')};"
        for name, rows in by_filter.items()
        if name.endswith(CLOSED)
    ]
    return "\n".join(
        [
            f"**Of the models' filters {_beat(models)} no filter**: better in the rms error of a "
            "joint or in the log score and worse in none, beyond the 95 % intervals. Against no "
            "filter",
            "",
            *loops,
            "",
            f"Of the two linear filters that know no more than the training takes {_beat(linear)} "
            "it.",
        ]
    )


def _beat(names: Sequence[str]) -> str:
    if not names:
        return "none beats"
    quoted = [f"“{label(name)}”" for name in names]
    return f"{page.listed(quoted)} {'beat' if len(names) > 1 else 'beats'}"


def _scores(rows: pd.DataFrame, column: str) -> str:
    named = [
        row.score if row.joint == ALL else f"{row.score} of {row.joint}"
        for row in rows[rows[column]].itertuples(index=False)
    ]
    return page.listed(named) if named else "nothing"


def _levels(rows: pd.DataFrame, joints: Sequence[str]) -> str:
    keys = [(RMS, joint) for joint in joints] + [(COVERAGE, joint) for joint in joints]
    keys.append((LOG, ALL))
    header = [f"{score} of {joint}" if joint != ALL else score for score, joint in keys]
    means = rows.set_index(["filter", "score", "joint"])["mean"]
    body = [
        [label(name), *(page.number(means[(name, *key)]) for key in keys)]
        for name in rows["filter"].unique()
    ]
    return table(["filter", *header], body)


def _differences(rows: pd.DataFrame, joints: Sequence[str]) -> str:
    keys = [*((RMS, joint) for joint in joints), (LOG, ALL)]
    header = [f"{score} of {joint}" if joint != ALL else score for score, joint in keys]
    by_key = rows.set_index(["filter", "score", "joint"])
    body = [
        [label(name), *(_difference(by_key.loc[(name, *key)]) for key in keys)]
        for name in rows["filter"].unique()
        if name != NONE
    ]
    return table(["filter", *header], body)


def _difference(row: pd.Series) -> str:
    text = page.interval(row["difference"], row["low"], row["high"])
    return f"{text} {row['gained']:.0%}" if row["gained"] > 0 else text


def _knowledge(joints: Sequence[str], response: np.ndarray) -> str:
    slopes = [f"{joint} {response[j, j] - 1:+.2f}" for j, joint in enumerate(joints)]
    return (
        "The yardstick is the best linear filter of the laboratory's deviations: it knows their "
        "covariance over time, to first order in the disturbances, and takes the camera as "
        "every filter does. It does not know that the play is bounded, "
        "and not that the camera's error depends on the pose: the slope of a "
        "joint's error on its own deviation from the mean path is "
        f"{page.listed(slopes)}. The yardstick that knows the camera has these slopes and those "
        "across joints, from all test takes, and the noise that is left. The two linear filters "
        "know the spread S_k of the training takes at each step, which is no filter, and one "
        "correlation over time: that of the takes, or the first-order one with the same value a "
        "frame later. The latter is a closed loop too, e_{k+1} = (1 − κ)S_{k+1}^½S_k^−½e_k + w, "
        "with the noise that keeps the takes' spread, Cov w = (1 − (1 − κ)²)S_{k+1}; κ follows "
        "from what is left a frame later. A model's closed loop has one κ and one law of the "
        "noise, and its spread is what these two make of each other."
    )


def _durations(rows: pd.DataFrame) -> str:
    """Whether the goal is met: never worse than no filter, better where a deviation outlasts a
    frame, calibrated.
    """
    decided, lines = verdicts(rows), []
    for name, own in decided.groupby("filter", sort=False):
        worse = own[own["worse"]].groupby("score")["factor"].unique()
        long = own[(own["left"] >= OUTLASTS) & (own["score"] == RMS)]
        covered = rows[(rows["filter"] == name) & (rows["score"] == COVERAGE)]["mean"]
        calibrated = CALIBRATED[0] <= covered.min() and covered.max() <= CALIBRATED[1]
        lost = [
            f"in {score} at the factors {', '.join(page.number(x) for x in factors)}"
            for score, factors in worse.items()
        ]
        rest = rows[(rows["filter"] == name) & (rows["score"] == AT_REST)]["difference"]
        lines.append(
            f"- **{label(name)}**: worse than no filter {page.listed(lost) or 'nowhere'}; where "
            f"a deviation outlasts a frame, better in {int(long['better'].sum())} of {len(long)} "
            f"rms errors; coverage {covered.min():.2f} to {covered.max():.2f}"
            f"{'' if calibrated else f', beyond {CALIBRATED[0]} to {CALIBRATED[1]}'}; log score "
            f"at rest {rest.min():+.2g} to {rest.max():+.2g} to no filter's."
        )
    return "\n".join(
        [
            "The arm alone, with white noise of both instruments as large as in the run; every lag "
            "of sway and play is a factor times the dataset's. A deviation outlasts a frame where "
            f"its correlation a frame later is at least {OUTLASTS:.2f}.",
            "",
            *lines,
        ]
    )


def _sweep(rows: pd.DataFrame, joints: Sequence[str]) -> str:
    """A row for each duration and filter: rms errors over those of no filter, coverage, log
    score.
    """
    header = ["factor", "lag of the sway (ms)", "left after a frame", "κ", "filter"]
    header += [f"rms of {joint} over no filter's" for joint in joints]
    header += [f"coverage of {joint}" for joint in joints]
    header += ["log score, to no filter's", "at rest"]
    body = []
    rows = rows.assign(ratio=over_none(rows))
    for (factor, name), own in rows.groupby(["factor", "filter"], sort=False):
        first, by_key = own.iloc[0], own.set_index(["score", "joint"])
        last = by_key.loc[(LOG, ALL)]
        cells = [page.number(factor), page.number(1e3 * first["sway_time"])]
        cells += [f"{last['left']:.2f}"]
        cells += [page.number(first["share"]) if name.endswith(CLOSED) else "–", label(name)]
        cells += [f"{by_key.loc[(RMS, joint), 'ratio']:.2f}" for joint in joints]
        cells += [f"{by_key.loc[(COVERAGE, joint), 'mean']:.2f}" for joint in joints]
        for score in (LOG, AT_REST):
            row = by_key.loc[(score, ALL)]
            cells.append(page.interval(row["difference"], row["low"], row["high"]))
        body.append(cells)
    return table(header, body)
