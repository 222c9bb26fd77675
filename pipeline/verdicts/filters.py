"""The filters on the report's page: each beside no filter at all, and whether any beats it."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pipeline.core.filters import CLOSED, MEMORY, NONE, models_of
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import number, table

TABLE = "filter_against_none"
LABELS = {NONE: "no filter", MEMORY: "linear, takes' memory"}
BEYOND = (
    "The linear filter is that of minimum variance, with the takes' spread at each step and one "
    "correlation over time as its law ([the law](../pipeline/filtering/memory.py)). "
    "An open loop adds the noise of all steps up, a closed one corrects a share of what the arm is "
    "off the training takes' mean path ([the loop](../pipeline/models/closed_loop.py)). Coverage "
    "is that of ±1σ, log scores are in nats a step; brackets hold 95 % intervals of the paired "
    "differences to no filter."
)


def filters_part(run: Run) -> str:
    """A row for each filter of ``run``, no filter first, then the linear one, and whether any beats
    none; nothing where the dataset has no depth camera.
    """
    if TABLE not in run.tables:
        return ""
    rows = run.tables[TABLE].set_index(["model", "score"])
    names = list(dict.fromkeys(rows.index.get_level_values("model")))
    closed = [name for name in names if name.endswith(CLOSED)]
    scores = [
        *(f"rms_error_{joint}_rad" for joint in run.joints),
        *(f"coverage_of_one_sigma_{joint}" for joint in run.joints),
        "log_score",
    ]
    header = [
        "filter",
        *(f"rms error of {joint} (rad)" for joint in run.joints),
        *(f"coverage of {joint}" for joint in run.joints),
        "log score",
    ]
    cells = [
        [label(name), *(_cell(rows, name, score) for score in scores)]
        for name in (NONE, MEMORY, *models_of(names), *closed)
    ]
    return f"{verdict(run)} {BEYOND}\n\n{table(header, cells)}"


def verdict(run: Run) -> str:
    """Whether any model's filter of ``run`` beats no filter, and whether the linear one does: in
    the log score or in a joint's rms error, while it is worse in none of them, all by their 95 %
    intervals.
    """
    if TABLE not in run.tables:
        return ""
    rows = run.tables[TABLE]
    better, worse, nearer = {}, {}, {}
    for name in dict.fromkeys(rows["model"]):
        if name != NONE:
            gains = _gains(rows, name, run.joints)
            better[name] = any(low > 0 for low, _ in gains)
            worse[name] = any(high < 0 for _, high in gains)
            nearer[name] = all(low > 0 for low, _ in gains[1:])
    models = [name for name in better if name != MEMORY]
    beating = [name for name in models if better[name] and not worse[name]]
    equal = [name for name in models if not better[name] and not worse[name]]
    smaller = [name for name in models if nearer[name] and worse[name]]
    what = "what the training takes alone say, their mean and spread at each step"
    if beating:
        text = f"On {run.dataset} of the models' filters {_listed(beating)} beat {what}."
    else:
        each = "" if equal else ": each is worse in some score"
        text = f"**On {run.dataset} no model's filter beats {what}{each}.**"
    if smaller:
        text += f" A smaller rms error in every joint, but a worse log score: {_listed(smaller)}."
    if equal:
        text += f" As good as that: {_listed(equal)}."
    if MEMORY in better:
        fares = "beats it" if better[MEMORY] else "is as good"
        fares = "is worse in some score" if worse[MEMORY] else fares
        text += f" The linear filter of the takes' own spread and memory {fares}."
    return text


def _gains(rows: pd.DataFrame, name: str, joints: Sequence[str]) -> list[tuple[float, float]]:
    """The interval of what the filter ``name`` gains over none in the log score, then in the rms
    error of each joint.
    """
    own = rows[rows["model"] == name].set_index("score")
    errors = [own.loc[f"rms_error_{joint}_rad"] for joint in joints]
    log = own.loc["log_score"]
    return [(log["low"], log["high"]), *((-error["high"], -error["low"]) for error in errors)]


def first_lines(runs: Sequence[Run]) -> str:
    """The verdicts of those ``runs`` on which no model's filter beats none."""
    return "\n\n".join(text for text in map(verdict, runs) if text.startswith("**"))


def label(name: str) -> str:
    """Of the filter ``name``, one of :mod:`pipeline.core.filters`."""
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
    return f"{text} ({number(row['difference'])} [{number(row['low'])}, {number(row['high'])}])"
