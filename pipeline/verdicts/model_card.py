"""The model card: a motion model for the arm of a run and why, how sure its parameters are, where
it was fitted and where it must not be used.
"""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pipeline.core.filters import MEMORY, NONE
from pipeline.verdicts.filters import verdict
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import interval, number, table

ALL = "all"  # the group of all steps
FEW_TAKES = 10  # below it an interval from resampled takes is not printed
NAMES = {NONE: "training mean", MEMORY: "autoregressive baseline"}
RULE = (
    "A matrix model is recommended if the 95 % interval of its paired difference in log score "
    "(nats a step, held-out takes, each step from the measured pose before it) is above zero "
    "against every baseline: additive noise, noise that scales with the joint's speed (scaled, "
    "scaled_full), the training mean (mean and standard deviation of the training takes at each "
    "step) and the autoregressive baseline (these with one autocorrelation). The last two hold for "
    "this motion alone."
)
UNKNOWN = (
    "**No model is recommended**: the measurement noise is unknown, as the motion never rests, and "
    "no prediction was scored. State `motion.pose_noise` in the dataset's option file."
)
NO_ROBOT = "**No model is recommended**: the dataset has no robot."
NO_SPREAD = (
    "**Its recordings give no evidence on the standard deviation of the noise**: most of the "
    "variance lies between recordings, not between repetitions. "
)
BETWEEN, LIMIT = "recorded_share_of_variance_between_recordings", 0.5  # as in claims.yaml
NOT_FOR = (
    "poses and speeds outside these ranges; an exported model warns of each by name",
    "singular poses, where no model is defined; the greatest ‖J⁺‖ above was the nearest to one",
    "another period than the recordings': noise of a step is not noise of two half steps",
    "another arm, controller or payload than the recordings': "
    "`python -m pipeline assess FILE` compares a new take with these",
    "steps added up without a measurement between: only the autoregressive baseline has noise that "
    "lasts from step to step",
)


def model_card(run: Run, others: Sequence[Run]) -> str:
    """``model_card.md`` of ``run``, with the recommended models for the arms of
    ``others``.
    """
    title = f"# Motion model for dataset {run.dataset}, scale {run.scale}"
    if not run.joints:
        return f"{title}\n\n{NO_ROBOT}\n"
    scored = "predictions" in run.tables
    sections = [
        title,
        choice(run) if scored else UNKNOWN,
        "Written by the stage `report` from the results of `predict`, `fit` and `filter`.",
    ]
    if scored:
        sections += [
            f"## Why\n\n{RULE}\n\n{predictors(run)}",
            "## Coverage by joint and speed\n\nShare of the steps within ±1σ of the prediction; "
            f"0.683 for a normal one. Speeds are ‖q̇‖.\n\n{_coverage(run)}",
        ]
    if filters := verdict(run):
        sections.append(f"## In a filter\n\n{filters} [Scores](report.md).")
    sections += [
        f"## Parameters\n\nStandard errors by the bootstrap over takes.\n\n{_parameters(run)}",
        f"## Where it was fitted\n\n{_ranges(run)}",
        "## Where it must not be used\n\n" + "\n".join(f"- {what}" for what in NOT_FOR),
        f"## Takes left out\n\n{_left_out(run)}",
        "## Export\n\n`python -m pipeline export MODEL` writes a model of `models` in "
        "`params.yaml` to one file; [`pipeline.models.load`](../../pipeline/tools/export/README.md) "
        "reads it with NumPy alone.",
    ]
    if scored := [each for each in others if "predictions" in each.tables]:
        chosen = "\n".join(f"- {each.dataset}: {choice(each)}" for each in scored)
        sections.append(f"## Other datasets\n\n{chosen}")
    return "\n\n".join(sections) + "\n"


def choice(run: Run) -> str:
    """The model to use, by :data:`RULE`, for this motion and for another one of the arm."""
    means = _log_scores(run)["mean"]
    matrix = [name for name in run.matrix_models if name in means]
    plain = [name for name in means.index if name not in matrix]
    passing = [name for name in matrix if not _not_below(run, name, plain)]
    text = NO_SPREAD if run.metrics.get("motion", {}).get(BETWEEN, 0) > LIMIT else ""
    if passing:
        text += f"**{means[passing].idxmax()}**: its log score is above that of every baseline."
    else:
        text += f"On {run.dataset} **no matrix model** has a log score above every baseline:"
        reasons = [
            f" `{name}` not above {_listed(_not_below(run, name, plain))}" for name in matrix
        ]
        text += ";".join(reasons) + "."
    text += "".join(f" `{name}` has no score." for name in _models(run) if name not in means)
    best = means.idxmax()
    text += f" The highest log score for this motion has {_listed([best])}"
    text += _apart(run, best, [*means.index]) + "."
    steps = [name for name in means.index if name not in NAMES]
    other = means[steps].idxmax()
    text += f" For another motion of this arm use `{other}`{_apart(run, other, steps)}."
    if other not in run.models:
        text += " Name it in `models` of `params.yaml` to fit and export it."
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
        rows.append([NAMES.get(name, name), difference, *values])
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
    shown = [f"the {NAMES[name]}" if name in NAMES else f"`{name}`" for name in names]
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
    return table(["steps", "joint", *(NAMES.get(name, name) for name in models)], rows)


def _parameters(run: Run) -> str:
    """A row for each estimate that has a standard error; a bound at the end of its search is
    unbounded, and fewer than ten takes make no interval.
    """
    rows = []
    few = run.metrics.get("motion", {}).get("recorded_takes", FEW_TAKES) < FEW_TAKES
    for model in run.models:
        fitted = run.metrics[f"fit_{model}"]
        for name, value in fitted.items():
            if fitted.get(f"{name}_unbounded"):
                rows.append([model, name, "unbounded", "–", "–"])
            elif f"{name}_standard_error" in fitted:
                ends = [
                    fitted.get(f"{name}_interval_{end}", float("nan")) for end in ("low", "high")
                ]
                error = number(fitted[f"{name}_standard_error"])
                rows.append([model, name, number(value), error, "–" if few else interval(*ends)])
    return table(["model", "parameter", "value", "standard error", "95 % interval"], rows)


def _ranges(run: Run) -> str:
    rows = [
        [row.quantity, row.name_, row.unit, number(row.least), number(row.greatest)]
        for row in run.tables["ranges"].rename(columns={"name": "name_"}).itertuples()
    ]
    return table(["", "of", "unit", "least", "greatest"], rows)


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
