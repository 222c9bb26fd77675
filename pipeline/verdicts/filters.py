"""The filters on the report's page, each beside the training takes' mean and standard deviation."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pipeline.core.filters import CLOSED, MEMORY, NONE, models_of
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import interval, number, table

TABLE = "filter_against_none"
LABELS = {NONE: "training mean", MEMORY: "autoregressive, linear filter"}
BEYOND = (
    "The training mean is the mean and standard deviation of the training takes at each step, "
    "without the depth camera. The linear filter has minimum variance under the takes' covariance "
    "and one autocorrelation. An open loop adds up the noise of all steps; a closed loop corrects "
    "a share of the deviation from the training takes' mean path. Coverage of ±1σ; log scores in "
    "nats a step; in brackets the 95 % interval of the paired difference to the training mean."
)


def filters_part(run: Run) -> str:
    """A row for each filter of ``run``, the training mean first, and the verdict; nothing where the
    dataset has no depth camera.
    """
    if TABLE not in run.tables:
        return ""
    rows = run.tables[TABLE].set_index(["model", "score"])
    names = list(dict.fromkeys(rows.index.get_level_values("model")))
    closed = [name for name in names if name.endswith(CLOSED)]
    scores = {f"rms error of {joint} (rad)": f"rms_error_{joint}_rad" for joint in run.joints}
    scores |= {f"coverage of {joint}": f"coverage_of_one_sigma_{joint}" for joint in run.joints}
    scores |= {"log score": "log_score"}
    cells = [
        [label(name), *(_cell(rows, name, score) for score in scores.values())]
        for name in (NONE, MEMORY, *models_of(names), *closed)
    ]
    return f"{verdict(run)} {BEYOND}\n\n{table(['filter', *scores], cells)}"


def verdict(run: Run) -> str:
    """The filters of ``run`` whose log score is above that of the training mean and those with a
    smaller rms error in every joint, both by their 95 % intervals; nothing without a depth camera.
    """
    if TABLE not in run.tables:
        return ""
    rows = run.tables[TABLE].set_index(["model", "score"])
    names = [name for name in dict.fromkeys(rows.index.get_level_values("model")) if name != NONE]
    errors = [f"rms_error_{joint}_rad" for joint in run.joints]
    higher = [name for name in names if rows.loc[(name, "log_score"), "low"] > 0]
    smaller = [n for n in names if all(rows.loc[(n, error), "high"] < 0 for error in errors)]
    particle = [name for name in higher if name != MEMORY]
    what = "a higher log score than the mean and standard deviation of the training takes"
    if particle:
        text = f"On {run.dataset} these particle filters have {what}: {_listed(particle)}."
    else:
        text = f"On {run.dataset} no particle filter has {what}."
    if smaller := [name for name in smaller if name not in particle and name != MEMORY]:
        text += f" These have a smaller rms error in every joint: {_listed(smaller)}."
    if MEMORY in names:
        has = "has" if MEMORY in higher else "has not"
        text += f" The linear autoregressive filter {has} a higher log score."
    return text


def label(name: str) -> str:
    """Name for a reader of the filter ``name``, one of :mod:`pipeline.core.filters`."""
    if name in LABELS:
        return LABELS[name]
    model = name.removesuffix(CLOSED)
    return f"{model}, closed loop" if name != model else f"{model}, open loop"


def _listed(names: Sequence[str]) -> str:
    return "; ".join(map(label, names))


def _cell(rows: pd.DataFrame, name: str, score: str) -> str:
    if (name, score) not in rows.index or pd.isna(rows.loc[(name, score), "mean"]):
        return "–"
    row = rows.loc[(name, score)]
    text = number(row["mean"])
    if score != "log_score" or pd.isna(row["low"]):
        return text
    return f"{text} ({number(row['difference'])} {interval(row['low'], row['high'])})"
