"""pose: does the pose change the noise of a joint beyond the joint speed, on every dataset?"""

from pathlib import Path
from types import SimpleNamespace

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style
from pipeline.statistics.curves import POWER
from pipeline.statistics.pose_effect import ALL, DIFFERING, NORM, REPEATED
from pipeline.studies.frame import NoAnswerError, Tables, concatenate, interval, number
from pipeline.verdicts.run import read_run

DATASETS = Path("reports/datasets")
YES = "yes"
NO = "no"
FALLS = "falls"
UNKNOWN = "cannot be told"
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
    tables = []
    for file in sorted(DATASETS.glob("*.json")):
        run = read_run(file)
        effects = run.tables.get("pose_effect")
        if effects is None or effects.empty:
            continue
        if "noise" not in effects:
            print(f"pose: the evidence of {run.dataset} is too old; run it again")
            continue
        recordings = "synthetic" if run.synthetic else "real"
        tables.append(effects.assign(dataset=run.dataset, recordings=recordings))
    if not tables:
        raise NoAnswerError("no dataset has a task and enough steps of moving joints")
    pose = concatenate(tables).assign(answer=UNKNOWN)
    pose.loc[(pose["power"] >= POWER) & (pose["high"] < 0.5), "answer"] = NO
    pose.loc[pose["high"] < 0, "answer"] = FALLS
    pose.loc[pose["low"] > 0, "answer"] = YES
    return {"pose": pose}


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the rows on the norm that answer the question, each with the exponent of the error
    that repeats if there is one; the answers in words; and the cells of the table.
    """
    pose = tables["pose"]
    texts = map(interval, pose["exponent"], pose["low"], pose["high"])
    numbers = ["power", "spread", "needed"]
    pose = pose.assign(exponent=list(texts), **pose[numbers].map(number))
    norm = pose[pose["quantity"] == NORM]
    of_repeated = norm[norm["noise"] == REPEATED].set_index("dataset")
    exponents = of_repeated["exponent"].to_dict()
    repeated = [exponents.get(dataset, "") for dataset in norm["dataset"]]
    decisive = norm.assign(repeated=repeated)[is_decisive(norm)]
    columns = ["dataset", "noise", "quantity", "exponent", *numbers, "answer"]
    return {
        "norm": list(decisive.itertuples()),
        "answers": ANSWERS,
        "cells": decisive[columns].to_numpy(),
    }


def is_decisive(rows: pd.DataFrame) -> pd.Series:
    """Return True for the part of the noise that answers the question for its dataset: what differs
    between repetitions, else all noise.
    """
    repeating = rows.loc[rows["noise"] == DIFFERING, "dataset"]
    decisive = rows["dataset"].isin(repeating).map({True: DIFFERING, False: ALL})
    return rows["noise"] == decisive


def draw(pose: pd.DataFrame) -> Figure:
    """Draw the exponents in the decisive part of the noise with their intervals by dataset."""
    pose = pose[is_decisive(pose)]
    names = list(pose["dataset"].unique())
    figure, ((axes,),) = style.panels(style.TWO_COLUMNS, 1.2 + 0.45 * len(names))
    for shift, quantity in zip((-0.2, 0.0, 0.2), LOOKS, strict=True):
        rows = pose[pose["quantity"] == quantity]
        heights = [names.index(name) + shift for name in rows["dataset"]]
        exponent = rows["exponent"]
        ends = [exponent - rows["low"], rows["high"] - exponent]
        look = LOOKS[quantity] | {"markersize": 4}
        axes.errorbar(exponent, heights, xerr=ends, **look)
    for value in (0.0, 1.0):
        axes.axvline(value, color=style.GREY, linewidth=0.8, zorder=0)
    axes.set_yticks(range(len(names)), names)
    axes.set_xlabel("exponent of the pose quantity (0: speed only, 1: proportional)")
    figure.legend(loc="outside lower center", ncols=3)
    return figure
