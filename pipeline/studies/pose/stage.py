"""pose: does the pose change the noise of a joint beyond the joint speed, on every dataset?"""

from pathlib import Path
from types import SimpleNamespace

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style
from pipeline.statistics.curves import POWER
from pipeline.statistics.pose_effect import ALL, DIFFERING, NORM
from pipeline.studies.frame import NoAnswerError, Tables, concatenate, interval, number
from pipeline.verdicts.run import read_run

DATASETS = Path("reports/datasets")
YES, NO, FALLS, UNKNOWN = "yes", "no", "falls", "cannot be told"
ANSWERS = {
    YES: "the noise grows with the pose quantity beyond the joint speed",
    NO: "no growth with the pose is found, and an exponent of one half is excluded",
    FALLS: "the noise falls with the pose quantity at equal joint speed",
    UNKNOWN: "these recordings cannot tell",
}
LOOKS = {
    NORM: {"fmt": "o", "color": style.BLUE, "label": NORM},
    "wishart": {
        "fmt": "s",
        "color": style.VERMILLION,
        "label": "std of the Wishart model",
    },
    "gaussian": {
        "fmt": "D",
        "color": style.ORANGE,
        "label": "std of the Gaussian matrix model",
    },
}


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the table ``pose`` of the evidence of all datasets; NoAnswerError without one.

    The answer is YES if the noise grows with the pose quantity: the interval of the exponent is
    above zero; FALLS if it is below zero; NO if it contains zero and no value above one half, and
    has the power to tell one from zero; else UNKNOWN.
    """
    rows = [
        run.tables["pose_effect"].assign(
            dataset=run.dataset, recordings="synthetic" if run.synthetic else "real"
        )
        for run in map(read_run, sorted(DATASETS.glob("*.json")))
        if len(run.tables.get("pose_effect", ()))
    ]
    if not rows:
        raise NoAnswerError("no dataset has a task and enough steps of moving joints")
    found = concatenate(rows).assign(answer=UNKNOWN)
    found.loc[(found["power"] >= POWER) & (found["high"] < 0.5), "answer"] = NO
    found.loc[found["high"] < 0, "answer"] = FALLS
    found.loc[found["low"] > 0, "answer"] = YES
    return {"pose": found}


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the rows on the norm, the answers in words, and the cells of the table."""
    found, shown = tables["pose"], ["power", "spread", "needed"]
    text = map(interval, found["exponent"], found["low"], found["high"])
    found = found.assign(exponent=[*text], **found[shown].map(number))
    of_norm = found[found["quantity"] == NORM]
    answered = of_norm[of_norm["noise"] == of_norm["dataset"].map(_decisive(of_norm))]
    columns = ["dataset", "noise", "quantity", "exponent", *shown, "answer"]
    return {
        "norm": [*answered.itertuples()],
        "answers": ANSWERS,
        "cells": found[columns].to_numpy(),
    }


def _decisive(rows: pd.DataFrame) -> dict[str, str]:
    """Return the part of the noise that answers the question by dataset: what differs between
    repetitions, else all noise.
    """
    parts = dict.fromkeys(rows["dataset"], ALL)
    differing = rows.loc[rows["noise"] == DIFFERING, "dataset"]
    return parts | dict.fromkeys(differing, DIFFERING)


def draw(pose: pd.DataFrame) -> Figure:
    """Draw the exponents in the decisive part of the noise with their intervals by dataset."""
    pose = pose[pose["noise"] == pose["dataset"].map(_decisive(pose))]
    names = list(dict.fromkeys(pose["dataset"]))
    figure, ((axes,),) = style.panels(style.TWO_COLUMNS, 1.2 + 0.45 * len(names))
    for shift, (quantity, look) in zip((-0.2, 0.0, 0.2), LOOKS.items(), strict=True):
        rows = pose[pose["quantity"] == quantity]
        heights = [names.index(name) + shift for name in rows["dataset"]]
        ends = [rows["exponent"] - rows["low"], rows["high"] - rows["exponent"]]
        axes.errorbar(rows["exponent"], heights, xerr=ends, markersize=4, **look)
    for value in (0.0, 1.0):
        axes.axvline(value, color=style.GREY, linewidth=0.8, zorder=0)
    axes.set_yticks(range(len(names)), names)
    axes.set_xlabel("exponent of the pose quantity (0: speed alone, 1: proportional)")
    figure.legend(loc="outside lower center", ncols=3)
    return figure
