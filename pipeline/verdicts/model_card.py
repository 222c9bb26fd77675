"""The model card: which motion model to use for the arm of a run and why, how sure its parameters
are, where it was fitted and where it must not be used.
"""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pipeline.core.filters import MEMORY, NONE
from pipeline.verdicts.filters import verdict
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import number, table

ALL = "all"  # the group of all steps
ALONE = {
    NONE: "none: the takes' mean and spread",
    MEMORY: "memory: these and the takes' correlation over time",
}
RULE = (
    "A matrix model is named where the 95 % interval of its paired difference in log score (nats a "
    "step, over held-out takes, each step from the measured pose before it) is above zero against "
    "no model and against every plain baseline. Plain are additive noise, noise that scales with "
    "the joint's speed (scaled, scaled_full), and what the training takes say without a model of "
    "the step; the last two of these hold for this very motion alone."
)
UNKNOWN = (
    "**No model can be named**: the measurement noise is not known, as the motion never rests, and "
    "no prediction was scored. State `motion.pose_noise` in the dataset's option file."
)
NO_ROBOT = "**No motion model can be named**: the dataset has no robot."
NOT_FOR = (
    "poses and speeds outside these ranges, of which an exported model warns by name",
    "singular poses, where no model is defined; ‖J⁺‖ above was the nearest to one",
    "another period than the recordings': noise of a step is not noise of two half steps",
    "another arm, controller or payload than the recordings': "
    "`python -m pipeline assess FILE` says whether a new take behaves as these did",
    "steps added up without a measurement between: noise that lasts from step to step is in no "
    "model but memory",
)


def model_card(run: Run, others: Sequence[Run]) -> str:
    """``reports/model_card.md`` of ``run``, and which model to use for the arms of ``others``."""
    title = f"# Which motion model to use: dataset {run.dataset}, scale {run.scale}"
    if not run.joints:
        return f"{title}\n\n{NO_ROBOT}\n"
    scored = "predictions" in run.tables
    sections = [
        title,
        choice(run) if scored else UNKNOWN,
        "Written by the stage `report` from what `predict`, `fit` and `filter` measured.",
    ]
    if scored:
        sections += [
            f"## Why\n\n{RULE}\n\n{_scores(run)}",
            "## Coverage by joint and speed\n\nShare of the steps within ±1σ of the prediction, "
            f"0.683 of a normal one. Speeds are ‖q̇‖.\n\n{_coverage(run)}",
        ]
    if filters := verdict(run):
        sections.append(f"## In a filter\n\n{filters} [Its scores](report.md).")
    sections += [
        f"## Parameters\n\nStandard errors by the bootstrap over takes.\n\n{_parameters(run)}",
        f"## Where it was fitted\n\n{_ranges(run)}",
        "## Where it must not be used\n\n" + "\n".join(f"- {what}" for what in NOT_FOR),
        f"## What was left out\n\n{_left_out(run)}",
        "## Take it along\n\n`python -m pipeline export MODEL` writes one file, and "
        "[`pipeline.models.load`](../pipeline/tools/export/README.md) takes it up by NumPy alone.",
    ]
    if scored := [each for each in others if "predictions" in each.tables]:
        chosen = "\n".join(f"- {each.dataset}: {choice(each)}" for each in scored)
        sections.append(f"## Other datasets\n\n{chosen}")
    return "\n\n".join(sections) + "\n"


def choice(run: Run) -> str:
    """Which model to use, by :data:`RULE`, for this motion and for another one of the arm."""
    means = _log_scores(run)["mean"]
    matrix = [name for name in run.matrix_models if name in means]
    plain = [name for name in means.index if name not in matrix]
    named = [name for name in matrix if not _unbeaten(run, name, plain)]
    best = means.idxmax()
    if named:
        first = f"**{means[named].idxmax()}**, a matrix model, beats every plain baseline."
    else:
        first = "**None of the matrix models.**"
        first += "".join(
            f" {name} does not beat {_listed(_unbeaten(run, name, plain))}." for name in matrix
        )
    first += "".join(f" {name} has no score." for name in _models(run) if name not in means)
    first += f" Of all, {best} predicts the steps of this motion best"
    first += _apart(run, best, [*means.index]) + "."
    steps = [name for name in means.index if name not in ALONE]
    other = means[steps].idxmax()
    first += f" For another motion of this arm, of which no takes are at hand, take {other}"
    first += _apart(run, other, steps) + "."
    if other not in run.models:
        first += " Name it in `models` of `params.yaml` to fit and export it."
    return first


def _models(run: Run) -> list[str]:
    return list(dict.fromkeys(run.tables["predictions"]["model"]))


def _log_scores(run: Run) -> pd.DataFrame:
    """By model the log score over all steps, of those that have one."""
    rows = run.tables["predictions"]
    rows = rows[(rows["steps"] == ALL) & (rows["score"] == "log_score")].set_index("model")
    return rows[rows["mean"].notna()]


def _unbeaten(run: Run, model: str, rivals: Sequence[str]) -> list[str]:
    """Those of ``rivals`` that the interval of their difference does not put below ``model``."""
    pairs = run.tables["prediction_pairs"]
    own = pairs[(pairs["steps"] == ALL) & (pairs["model"] == model)].set_index("rival")["low"]
    return [name for name in rivals if name != model and not own[name] > 0]


def _apart(run: Run, model: str, others: Sequence[str]) -> str:
    equal = _unbeaten(run, model, others)
    return f" (not told apart from {_listed(equal)})" if equal else ""


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _scores(run: Run) -> str:
    """A row for each model and baseline, the best first."""
    log = _log_scores(run)
    means = run.tables["predictions"].set_index(["steps", "model", "score"])["mean"]
    rows = []
    for name in sorted(_models(run), key=lambda each: -log["mean"].get(each, float("-inf"))):
        groups = list(dict.fromkeys(means.index.get_level_values(0)))
        difference = "–"
        if name in log.index and name != NONE:
            row = log.loc[name]
            ends = f"[{number(row['low'])}, {number(row['high'])}]"
            difference = f"{number(row['difference'])} {ends}"
        values = [number(means.get((steps, name, "log_score"), float("nan"))) for steps in groups]
        rows.append([ALONE.get(name, name), difference, *values])
    return table(["model", "all, against none", *groups], rows)


def _coverage(run: Run) -> str:
    means = run.tables["predictions"].set_index(["steps", "model", "score"])["mean"]
    models = _models(run)
    rows = [
        [steps, joint]
        + [number(means[steps, name, f"coverage_of_one_sigma_{joint}"]) for name in models]
        for steps in dict.fromkeys(means.index.get_level_values(0))
        for joint in run.joints
    ]
    return table(["steps", "joint", *models], rows)


def _parameters(run: Run) -> str:
    """A row for each estimate that has a standard error."""
    rows = []
    for model in run.models:
        fitted = run.metrics[f"fit_{model}"]
        for name, value in fitted.items():
            if f"{name}_standard_error" in fitted:
                ends = (fitted[f"{name}_interval_{end}"] for end in ("low", "high"))
                interval = f"[{', '.join(map(number, ends))}]"
                error = number(fitted[f"{name}_standard_error"])
                rows.append([model, name, number(value), error, interval])
    return table(["model", "parameter", "value", "standard error", "95 % interval"], rows)


def _ranges(run: Run) -> str:
    rows = [
        [row.quantity, row.name_, row.unit, number(row.least), number(row.greatest)]
        for row in run.tables["ranges"].rename(columns={"name": "name_"}).itertuples()
    ]
    return table(["", "of", "unit", "least", "greatest"], rows)


def _left_out(run: Run) -> str:
    """How many takes there are, and those left out with their reasons."""
    takes = run.tables["takes"].drop_duplicates("take")
    gone, kept = takes[takes["left_out"]], takes[~takes["left_out"]]
    counted = ", ".join(f"{count} {part}" for part, count in kept.groupby("part").size().items())
    text = f"Takes kept: {counted}; left out: {len(gone)}. What was lost, clipped or repaired in "
    text += "them: [counts](report.md)."
    if gone.empty:
        return text
    reasons = gone[["take", "reason"]].astype(str).to_numpy().tolist()
    return f"{text}\n\n{table(['take', 'reason'], reasons)}"
