"""pose: does the pose change the noise of a joint beyond the joint speed, on every dataset?"""

from pathlib import Path
from types import SimpleNamespace

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style
from pipeline.statistics.curves import POWER
from pipeline.studies.frame import NoAnswerError, Study, Tables, concatenate, interval, number
from pipeline.verdicts.run import read_run
from pipeline.verdicts.wording import join_names, table

DATASETS = Path("reports/datasets")
NORM = "norm of the inverse Jacobian"
YES, NO, UNKNOWN = "yes", "no", "cannot be told"
MARKERS = {NORM: "o", "wishart": "s", "gaussian": "D"}


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the table ``pose`` of the evidence of all datasets; NoAnswerError without one."""
    rows = []
    for run in map(read_run, sorted(DATASETS.glob("*.json"))):
        own = run.tables.get("pose_effect")
        if own is not None and len(own):
            kind = "synthetic" if run.synthetic else "real"
            rows.append(own.assign(dataset=run.dataset, recordings=kind))
    if not rows:
        raise NoAnswerError("no dataset has a task and enough steps of moving joints")
    found = concatenate(rows)
    return {"pose": found.assign(answer=[answer(row) for row in found.itertuples()])}


def answer(row) -> str:
    """Return whether the noise grows with the pose quantity: YES if the interval of the exponent is
    above zero; NO if it is below one, contains no value above one half and has the power to tell
    one from zero; else UNKNOWN.
    """
    if row.low > 0:
        return YES
    return NO if row.power >= POWER and row.high < 0.5 else UNKNOWN


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return a sentence on each real dataset, and the table."""
    found = tables["pose"]
    norm = found[found["quantity"] == NORM]
    sentences = []
    for row in norm[norm["recordings"] == "real"].itertuples():
        exponent = interval(row.exponent, row.low, row.high)
        text = f"On {row.dataset} the exponent of ‖J⁺‖ is {exponent} over {row.groups} motions or "
        text += f"blocks: {ANSWERS[row.answer]}"
        if row.answer == UNKNOWN and pd.notna(row.needed):
            text += (
                f"; ln ‖J⁺‖ has a standard deviation of {number(row.spread)} at equal speed, and a "
                f"motion with {number(row.needed)} would tell"
            )
        sentences.append(f"{text}.")
    cells = [
        [
            row.dataset,
            row.quantity,
            interval(row.exponent, row.low, row.high),
            number(row.power),
            number(row.spread),
            number(row.needed),
            row.answer,
        ]
        for row in found.itertuples()
    ]
    head = [
        "dataset",
        "quantity x",
        "exponent",
        "power",
        "spread of ln x",
        "needed",
        "pose matters",
    ]
    synthetic = norm.loc[norm["recordings"] == "synthetic", "dataset"]
    names = join_names(list(synthetic)) if len(synthetic) else "none"
    return {"sentences": "\n".join(sentences), "table": table(head, cells), "synthetic": names}


ANSWERS = {
    YES: "the noise grows with the pose quantity beyond the joint speed",
    NO: "the pose does not matter beyond the joint speed",
    UNKNOWN: "these recordings cannot tell",
}


def draw(pose: pd.DataFrame) -> Figure:
    """Draw the exponents with their intervals by dataset."""
    names = list(dict.fromkeys(pose["dataset"]))
    figure = Figure(figsize=(7.0, 1.2 + 0.45 * len(names)), layout="constrained")
    axes = figure.subplots()
    quantities = list(dict.fromkeys(pose["quantity"]))
    colours = (style.BLUE, style.VERMILLION, style.ORANGE)
    for number_of, (quantity, colour) in enumerate(zip(quantities, colours, strict=False)):
        own = pose[pose["quantity"] == quantity]
        place = [names.index(name) + 0.2 * (number_of - 1) for name in own["dataset"]]
        ends = [own["exponent"] - own["low"], own["high"] - own["exponent"]]
        marker = MARKERS.get(quantity, "^")
        look = {"fmt": marker, "color": colour, "label": quantity, "markersize": 4}
        axes.errorbar(own["exponent"], place, xerr=ends, **look)
    for value in (0.0, 1.0):
        axes.axvline(value, color="0.6", linewidth=0.8, zorder=0)
    axes.set_yticks(range(len(names)), names)
    axes.set_xlabel("exponent of the pose quantity (0: speed alone, 1: proportional)")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


run = Study(evaluate, facts, draw).run
