"""Predictors and filters of the analysed motion beside the mean of the training takes."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pipeline.core.filters import CLOSED, MEMORY, NONE, models_of
from pipeline.verdicts.recommendation import plain_name
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import interval, listed, number, table

ALL = "all"  # the group of all steps
FILTERS = "filter_against_none"
BETWEEN, LIMIT = "recorded_share_of_variance_between_recordings", 0.5  # as in claims.yaml
NO_SPREAD = (
    "**Its recordings give no evidence on the standard deviation of the noise**: most of the "
    "variance lies between recordings, not between repetitions. "
)
LABELS = {NONE: "training mean", MEMORY: "autoregressive, linear filter"}
BEYOND = (
    "The training mean uses no depth camera. The linear filter has minimum variance under the "
    "takes' covariance and one autocorrelation. An open loop adds up the noise of all steps; a "
    "closed loop corrects a share of the deviation from the training takes' mean path. Coverage of "
    "±1σ; log scores in nats a step, in brackets the paired difference to the training mean."
)
HIGHER = "a higher log score than the mean and standard deviation of the training takes"


def log_scores(run: Run) -> pd.DataFrame:
    """Return the log score over all steps by model, of those that have one."""
    rows = run.tables["predictions"].query("steps == @ALL and score == 'log_score'")
    return rows[rows["mean"].notna()].set_index("model")


def scored_models(run: Run) -> list[str]:
    """Return the models and baselines that predict, in their order."""
    return list(dict.fromkeys(run.tables["predictions"]["model"]))


def choice(run: Run) -> str:
    """Return the matrix model whose log score for the analysed motion is above every baseline's by
    the 95 % interval of the paired difference, or none, and the predictor of highest score.
    """
    means = log_scores(run)["mean"]
    matrix = [name for name in run.matrix_models if name in means]
    plain = [name for name in means.index if name not in matrix]
    above = {name: _not_below(run, name, plain) for name in matrix}
    text = NO_SPREAD if run.metrics.get("motion", {}).get(BETWEEN, 0) > LIMIT else ""
    if passing := [name for name in matrix if not above[name]]:
        name = plain_name(means[passing].idxmax())
        text += f"**{name}**: its log score is above that of every baseline."
    else:
        text += f"On {run.dataset} **no matrix model** has a log score above every baseline:"
        text += ";".join(
            f" {plain_name(name)} not above {_listed(rivals)}" for name, rivals in above.items()
        )
        text += "."
    absent = [name for name in scored_models(run) if name not in means]
    text += "".join(f" {plain_name(name)} has no score." for name in absent)
    best = means.idxmax()
    text += f" The highest log score for this motion has {plain_name(best)}"
    if equal := _not_below(run, best, [*means.index]):
        text += f" (the difference to {_listed(equal)} is not significant)"
    return f"{text}."


def _not_below(run: Run, model: str, rivals: Sequence[str]) -> list[str]:
    """Those of ``rivals`` whose score the interval of the difference does not put below."""
    low = run.tables["prediction_pairs"].query("steps == @ALL and model == @model")
    low = low.set_index("rival")["low"]
    return [name for name in rivals if name != model and not low[name] > 0]


def _listed(names: Sequence[str]) -> str:
    return listed([plain_name(name) for name in names])


def predictors(run: Run) -> str:
    """Return a row for each model and baseline, the highest log score first."""
    if "predictions" not in run.tables:
        return ""
    log = log_scores(run)
    rows = run.tables["predictions"].query("score == 'log_score'")
    means = rows.pivot(index="model", columns="steps", values="mean")[list(rows["steps"].unique())]
    names = sorted(scored_models(run), key=lambda n: -log["mean"].get(n, float("-inf")))
    differences = {
        name: f"{number(row['difference'])} {interval(row['low'], row['high'])}"
        for name, row in log.iterrows()
        if name != NONE
    }
    header = ["log score (nats a step)", "difference to the training mean, all steps", *means]
    return table(header, [[plain_name(n), differences.get(n, "–"), *means.loc[n]] for n in names])


def coverage(run: Run) -> str:
    """Return the share of steps within ±1σ of the prediction by group of steps and joint."""
    means = run.tables["predictions"].set_index(["steps", "model", "score"])["mean"]
    models = scored_models(run)
    rows = [
        [steps, joint, *(means[steps, m, f"coverage_of_one_sigma_{joint}"] for m in models)]
        for steps in dict.fromkeys(means.index.get_level_values(0))
        for joint in run.joints
    ]
    return table(["steps", "joint", *map(plain_name, models)], rows)


def filters(run: Run) -> str:
    """Return a row for each filter, the training mean first, and the verdict; nothing if the
    dataset has no depth camera.
    """
    if FILTERS not in run.tables:
        return ""
    rows = run.tables[FILTERS].set_index(["model", "score"])
    names = list(dict.fromkeys(rows.index.get_level_values("model")))
    names = [NONE, MEMORY, *models_of(names), *(name for name in names if name.endswith(CLOSED))]
    scores = {f"rms error of {joint} (rad)": f"rms_error_{joint}_rad" for joint in run.joints}
    scores |= {f"coverage of {joint}": f"coverage_of_one_sigma_{joint}" for joint in run.joints}
    scores |= {"log score": "log_score"}
    cells = [
        [_label(name), *(_cell(rows, name, score) for score in scores.values())] for name in names
    ]
    return f"{filter_verdict(run)} {BEYOND}\n\n{table(['filter', *scores], cells)}"


def _cell(rows: pd.DataFrame, name: str, score: str) -> str:
    if (name, score) not in rows.index or pd.isna(rows.loc[(name, score), "mean"]):
        return "–"
    row = rows.loc[(name, score)]
    if score != "log_score" or pd.isna(row["low"]):
        return number(row["mean"])
    difference = f"{number(row['difference'])} {interval(row['low'], row['high'])}"
    return f"{number(row['mean'])} ({difference})"


def _label(name: str) -> str:
    model = name.removesuffix(CLOSED)
    return LABELS.get(name) or f"{model}, {'closed' if name != model else 'open'} loop"


def filter_verdict(run: Run) -> str:
    """Return the filters whose log score is above that of the training mean and those with a
    smaller rms error in every joint, both by their 95 % intervals; nothing without a depth camera.
    """
    if FILTERS not in run.tables:
        return ""
    rows = run.tables[FILTERS].set_index(["model", "score"])
    names = [name for name in dict.fromkeys(rows.index.get_level_values("model")) if name != NONE]
    errors = [f"rms_error_{joint}_rad" for joint in run.joints]
    higher = [name for name in names if rows.loc[(name, "log_score"), "low"] > 0]
    smaller = [n for n in names if all(rows.loc[(n, error), "high"] < 0 for error in errors)]
    particle = [name for name in higher if name != MEMORY]
    if particle:
        text = f"On {run.dataset} these particle filters have {HIGHER}: {_labels(particle)}."
    else:
        text = f"On {run.dataset} no particle filter has {HIGHER}."
    if smaller := [name for name in smaller if name not in (*particle, MEMORY)]:
        text += f" These have a smaller rms error in every joint: {_labels(smaller)}."
    if MEMORY in names:
        has = "has" if MEMORY in higher else "has not"
        text += f" The linear autoregressive filter {has} a higher log score."
    return text


def _labels(names: Sequence[str]) -> str:
    return "; ".join(map(_label, names))
