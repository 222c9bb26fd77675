"""The model card: the motion model to use for an arm, its formula and numbers, what the recordings
cannot tell, and the evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.core.filters import NONE
from pipeline.verdicts.filters import verdict
from pipeline.verdicts.recommendation import (
    RULE,
    STILL,
    answer,
    held_out,
    held_out_spread,
    held_out_tails,
    plain_name,
)
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import interval, number, table

ALL = "all"  # the group of all steps
FEW_TAKES = 10  # below it an interval from resampled takes is not printed
THIS_MOTION = (
    "For the analysed motion alone, a matrix model is recommended if the 95 % interval of its "
    "paired difference in log score (nats a step, held-out takes) is above zero against every "
    "baseline."
)
UNKNOWN = (
    "No prediction of the analysed motion was scored: the measurement noise is unknown, as the "
    "motion never rests. State `motion.pose_noise` in the dataset's option file."
)
NO_ROBOT = "**No model is recommended**: the dataset has no robot."
NO_SPREAD = (
    "**Its recordings give no evidence on the standard deviation of the noise**: most of the "
    "variance lies between recordings, not between repetitions. "
)
BETWEEN, LIMIT = "recorded_share_of_variance_between_recordings", 0.5  # as in claims.yaml
NOT_FOR = (
    "poses and speeds outside these ranges; an exported model warns of each by name",
    "singular poses, if the model needs the Jacobian",
    "another period than the recordings': noise of a step is not noise of two half steps",
    "another arm, controller or payload than the recordings': "
    "`python -m pipeline assess FILE` compares a new take with these",
    "steps added up without a measurement between: only the autoregressive baseline has noise that "
    "lasts from step to step",
)


def model_card(run: Run, others: Sequence[Run]) -> str:
    """Return the card of ``run``, with the recommended models for the arms of ``others``."""
    title = f"# Motion model for dataset {run.dataset}, scale {run.scale}"
    if not run.joints:
        return f"{title}\n\n{NO_ROBOT}\n"
    moved, scored = "other_motions" in run.tables, "predictions" in run.tables
    sections = [title, answer(run)]
    sections.append(f"**This motion.** {choice(run) if scored else UNKNOWN}")
    if moved:
        sections += [
            f"## Why\n\n{RULE}\n\n{held_out(run)}",
            f"## Predicted and measured spread on held-out motions\n\n{held_out_spread(run)}",
            "## Tails and coverage\n\nHeld-out noise in predicted standard deviations: kurtosis (3 "
            "of normal noise) and the share within one, two and three (0.683, 0.954, 0.997 of "
            f"normal noise).\n\n{held_out_tails(run)}",
        ]
    if scored:
        sections += [
            f"## Analysed motion\n\n{THIS_MOTION}\n\n{predictors(run)}",
            "## Coverage by joint and speed\n\nShare of the steps within ±1σ of the prediction; "
            f"0.683 for a normal one. Speeds are ‖q̇‖.\n\n{_coverage(run)}",
        ]
    if filters := verdict(run):
        sections.append(f"## In a filter\n\n{filters} [Scores](report.md).")
    if any(f"fit_{model}" in run.metrics for model in run.models):
        sections.append(
            "## Parameters of the run's models\n\nStandard errors by the bootstrap over takes.\n\n"
            f"{_parameters(run)}"
        )
    sections += [
        f"## Where it was fitted\n\n{_ranges(run)}",
        "## Where it must not be used\n\n" + "\n".join(f"- {what}" for what in NOT_FOR),
    ]
    if "takes" in run.tables:
        sections.append(f"## Takes left out\n\n{_left_out(run)}")
    sections.append(
        "## Export\n\n`python -m pipeline export MODEL` writes a model to one file and beside it "
        "`read_motion_model.py`, which reads it with NumPy alone: "
        "[methods and examples](../../pipeline/tools/export/README.md)."
    )
    if chosen := [f"- {each.dataset}: {_one_line(each)}" for each in others if each.joints]:
        sections.append("## Other datasets\n\n" + "\n".join(chosen))
    return "\n\n".join(sections) + "\n"


def _one_line(run: Run) -> str:
    text = answer(run).splitlines()[0]
    return f"{text} {choice(run)}" if "predictions" in run.tables else text


def choice(run: Run) -> str:
    """The model of highest log score for the analysed motion, by :data:`THIS_MOTION`."""
    means = _log_scores(run)["mean"]
    matrix = [name for name in run.matrix_models if name in means]
    plain = [name for name in means.index if name not in matrix]
    passing = [name for name in matrix if not _not_below(run, name, plain)]
    text = NO_SPREAD if run.metrics.get("motion", {}).get(BETWEEN, 0) > LIMIT else ""
    if passing:
        name = plain_name(means[passing].idxmax())
        text += f"**{name}**: its log score is above that of every baseline."
    else:
        text += f"On {run.dataset} **no matrix model** has a log score above every baseline:"
        reasons = [
            f" {plain_name(name)} not above {_listed(_not_below(run, name, plain))}"
            for name in matrix
        ]
        text += ";".join(reasons) + "."
    text += "".join(
        f" {plain_name(name)} has no score." for name in _models(run) if name not in means
    )
    best = means.idxmax()
    text += f" The highest log score for this motion has {_listed([best])}"
    text += _apart(run, best, [*means.index]) + "."
    return text


def predictors(run: Run) -> str:
    """A row for each model and baseline, the highest log score first."""
    log = _log_scores(run)
    means = run.tables["predictions"].set_index(["steps", "model", "score"])["mean"]
    rows = []
    groups = list(dict.fromkeys(means.index.get_level_values(0)))
    for name in sorted(_models(run), key=lambda each: -log["mean"].get(each, float("-inf"))):
        difference = "–"
        if name in log.index and name != NONE:
            row = log.loc[name]
            difference = f"{number(row['difference'])} {interval(row['low'], row['high'])}"
        values = [number(means.get((steps, name, "log_score"), float("nan"))) for steps in groups]
        rows.append([plain_name(name), difference, *values])
    header = ["log score (nats a step)", "difference to the training mean, all steps", *groups]
    return table(header, rows)


def _models(run: Run) -> list[str]:
    return list(dict.fromkeys(run.tables["predictions"]["model"]))


def _log_scores(run: Run) -> pd.DataFrame:
    """Log score over all steps by model, of those that have one."""
    rows = run.tables["predictions"]
    rows = rows[(rows["steps"] == ALL) & (rows["score"] == "log_score")].set_index("model")
    return rows[rows["mean"].notna()]


def _not_below(run: Run, model: str, rivals: Sequence[str]) -> list[str]:
    """Those of ``rivals`` whose score the interval of the difference does not put below
    ``model``.
    """
    pairs = run.tables["prediction_pairs"]
    own = pairs[(pairs["steps"] == ALL) & (pairs["model"] == model)].set_index("rival")["low"]
    return [name for name in rivals if name != model and not own[name] > 0]


def _apart(run: Run, model: str, others: Sequence[str]) -> str:
    equal = _not_below(run, model, others)
    return f" (the difference to {_listed(equal)} is not significant)" if equal else ""


def _listed(names: Sequence[str]) -> str:
    shown = [plain_name(name) for name in names]
    return " and ".join(filter(None, [", ".join(shown[:-1]), shown[-1]]))


def _coverage(run: Run) -> str:
    means = run.tables["predictions"].set_index(["steps", "model", "score"])["mean"]
    models = _models(run)
    rows = [
        [steps, joint]
        + [number(means[steps, name, f"coverage_of_one_sigma_{joint}"]) for name in models]
        for steps in dict.fromkeys(means.index.get_level_values(0))
        for joint in run.joints
    ]
    return table(["steps", "joint", *(plain_name(name) for name in models)], rows)


def _parameters(run: Run) -> str:
    """A row for each estimate with a standard error that the recordings can tell; fewer than ten
    takes make no interval.
    """
    rows, notes = [], []
    few = run.metrics.get("motion", {}).get("recorded_takes", FEW_TAKES) < FEW_TAKES
    for model in run.models:
        fitted = run.metrics.get(f"fit_{model}", {})
        absent = _not_told(run, fitted)
        notes += [
            f"- {plain_name(model)}: no number for {name}: {why}" for name, why in absent.items()
        ]
        for name, value in fitted.items():
            if name in absent:
                continue
            if f"{name}_standard_error" in fitted:
                ends = [
                    fitted.get(f"{name}_interval_{end}", float("nan")) for end in ("low", "high")
                ]
                error = number(fitted[f"{name}_standard_error"])
                rows.append([model, name, number(value), error, "–" if few else interval(*ends)])
    text = table(["model", "parameter", "value", "standard error", "95 % interval"], rows)
    return "\n\n".join([text, *(["\n".join(notes)] if notes else [])])


def _not_told(run: Run, fitted: Mapping[str, float]) -> dict[str, str]:
    """The estimates among ``fitted`` without a number, and why."""
    absent = {}
    for name in fitted:
        if fitted.get(f"{name}_unbounded"):
            absent |= {name: "its search ended at a bound; the level α·u alone is known"}
            absent |= {other: "known with u alone" for other in ("alpha",) if other in fitted}
    m = len(run.task)
    if m and fitted.get("sigma_b", 0.0) >= ((m + 1) / (m + 3)) ** 0.5:
        absent["sigma_b"] = "a step has no covariance at the estimate"
    if "ranges" in run.tables:
        ranges = run.tables["ranges"]
        speeds = ranges[ranges["quantity"] == "joint speed"].set_index("name")
        fastest = speeds[["least", "greatest"]].abs().max(axis=1)
        for joint, speed in fastest.items():
            name = f"std_share_of_the_step_{joint}"
            if name in fitted and speed < STILL * fastest.max():
                absent[name] = f"{joint} hardly moved (at most {number(speed)} rad/s)"
    return absent


def _ranges(run: Run) -> str:
    rows = [
        [row.quantity, row.name_, row.unit, number(row.least), number(row.greatest)]
        for row in _seen(run).rename(columns={"name": "name_"}).itertuples()
    ]
    return table(["", "of", "unit", "least", "greatest"], rows)


def _seen(run: Run) -> pd.DataFrame:
    """The ranges of all motions, and those of the analysed one."""
    tables = [run.tables[name] for name in ("motion_ranges", "ranges") if name in run.tables]
    return pd.concat(tables).drop_duplicates(["quantity", "name"])


def _left_out(run: Run) -> str:
    """Number of takes, and those left out with their reasons."""
    takes = run.tables["takes"].drop_duplicates("take")
    gone, kept = takes[takes["left_out"]], takes[~takes["left_out"]]
    counted = ", ".join(f"{count} {part}" for part, count in kept.groupby("part").size().items())
    text = f"Takes kept: {counted}; left out: {len(gone)}."
    if gone.empty:
        return text
    reasons = gone[["take", "reason"]].astype(str).to_numpy().tolist()
    return f"{text}\n\n{table(['take', 'reason'], reasons)}"
