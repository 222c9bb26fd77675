"""Scores of the predictors and filters of the analysed motion against the training mean."""

from collections.abc import Iterable, Sequence
from itertools import product

import pandas as pd

from pipeline.core.filters import CLOSED, MEMORY, NONE, models_of
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import TEXTS, interval, join_names, number, plain_name, table

MATRIX_KINDS = ("wishart", "gaussian")
ADDITIVE = "additive"  # name of the paper's own rival
NO_NOISE = "no_noise"  # rival in the tables of standard deviations: zero
ALL = "all"  # name of the group of all steps
FILTERS = "filter_against_none"
BETWEEN, LIMIT = "share_of_variance_between_recordings", 0.5  # as in claims.yaml
LABELS = {NONE: "training mean", MEMORY: "autoregressive, linear filter"}
TEXT = TEXTS["scores"]


def log_scores(run: Run) -> pd.DataFrame:
    """Return the rows of the log score over all steps by model, without models without a score."""
    rows = run.tables["predictions"].query("steps == @ALL and score == 'log_score'")
    return rows[rows["mean"].notna()].set_index("model")


def result(run: Run) -> list[str]:
    """Return a sentence on the predictors of ``run`` and one on its filters, if it has them."""
    sentences = []
    if "predictions" in run.tables:
        means = log_scores(run)["mean"].sort_values(ascending=False, kind="stable")
        best, pairs = means.index[0], run.tables["prediction_pairs"].query("steps == @ALL")
        kinds = {name: _is_matrix(run, name) for name in means.index}
        others = [name for name in means.index if kinds[name] != kinds[best]]
        name = plain_name(best).removesuffix(" (this motion)")
        text = TEXT["best"].format(run.dataset, number(means[best]), name)
        if others:
            pair = pairs.set_index(["model", "rival"]).loc[(best, others[0])]
            text += f", {_offset(pair)} the highest of a "
            text += "baseline" if kinds[best] else "matrix model"
        sentences.append(f"{text}.")
        sentences += _against_additive(run, pairs)
    if FILTERS in run.tables:
        rows = run.tables[FILTERS].query("score == 'log_score' and difference.notna()")
        rows = rows.set_index("model").sort_values("difference", ascending=False)
        particle = rows.index.difference([NONE, MEMORY], sort=False)
        parts = [TEXT["particle"].format(_offset(rows.loc[particle[0]]))] if len(particle) else []
        parts += [TEXT["linear"].format(_offset(rows.loc[MEMORY]))] if MEMORY in rows.index else []
        sentences += [f"{'; '.join(parts)}."] if len(particle) else []
    return sentences


def _against_additive(run: Run, pairs: pd.DataFrame) -> list[str]:
    """Return a sentence on the matrix models' log scores against the additive model's (``pairs``),
    the paper's own comparison.
    """
    rows = pairs[pairs["rival"] == ADDITIVE].dropna(subset="difference").set_index("model")
    named = [name for name in ("gaussian", "wishart") if name in rows.index]
    parts = [f"{plain_name(name)} is {_offset(rows.loc[name])}" for name in named]
    return [f"{TEXT['additive']}{' and of the '.join(parts)}."] if parts else []


def widths(run: Run) -> list[str]:
    """Return a sentence for each matrix model on the joints where its standard deviation is widest
    and narrowest beside the recordings, and where its error is above the error of no noise.
    """
    stds, sentences = run.evidence.query("quantity == 'std' and rival == ''").set_index("model"), []
    errors = run.evidence.query("quantity == 'std_error' and rival == @NO_NOISE")
    for model in (name for name, kind in run.models.items() if kind in MATRIX_KINDS):
        own, recorded = (
            stds.loc[stds.index == source].set_index("joint")["value"].reindex(run.joints)
            for source in (model, "recorded")
        )
        if (own / recorded).isna().any() or own.empty:
            continue
        ratio = own / recorded
        ends = {"most": ratio.max(), "least": ratio.min()}
        words = {end: number(value, 3) for end, value in ends.items()}
        words |= {"widest": ratio.idxmax(), "narrowest": ratio.idxmin(), "name": plain_name(model)}
        above = errors[(errors["model"] == model) & (errors["low"] > 0)]["joint"]
        beyond = TEXT["no_noise"].format(join_names(above)) if len(above) else ""
        sentences.append(f"{TEXT['widths'].format(**words)}{beyond}.")
    return sentences


def _is_matrix(run: Run, name: str) -> bool:
    """Return True for a matrix model of the run, or a control named after one."""
    return run.models.get(name, name.partition("_")[0]) in MATRIX_KINDS


def _offset(row: pd.Series) -> str:
    """Return the size of a difference with its interval, and "above" or "below"."""
    if row["difference"] > 0:
        return f"{number(row['difference'])} {interval(row['low'], row['high'])} above"
    return f"{number(-row['difference'])} {interval(-row['high'], -row['low'])} below"


def spread_note(run: Run) -> str:
    """Return a note if the recordings give no evidence on the standard deviation, else ""."""
    return TEXT["no_spread"] if run.recorded(BETWEEN, 0.0) > LIMIT else ""


def choice(run: Run) -> str:
    """Return sentences: matrix model with a log score above all baselines; highest log score."""
    means = log_scores(run)["mean"]
    every = [name for name in means.index if _is_matrix(run, name)]  # the controls too
    matrix = [name for name in run.models if name in every]
    above = {name: _not_below(run, name, means.index.difference(every, False)) for name in matrix}
    if passing := [name for name in matrix if not above[name]]:
        name = plain_name(means[passing].idxmax())
        parts = [f"The log score of the **{name}** is above every baseline's."]
    else:
        plain = {plain_name(n): join_names(map(plain_name, names)) for n, names in above.items()}
        rivals = "; ".join(f"{name} not above {names}" for name, names in plain.items())
        text = f"On {run.dataset} **no matrix model** has a log score above every baseline"
        parts = [f"{text}: {rivals}." if rivals else f"{text}."]
    absent = dict.fromkeys(run.tables["predictions"]["model"])
    parts += [f"{plain_name(name)} has no score." for name in absent if name not in means]
    best = means.idxmax()
    text = f"Highest log score for this motion: {plain_name(best)}"
    if equal := _not_below(run, best, means.index):
        text += f" (the difference to {join_names(map(plain_name, equal))} is not significant)"
    return " ".join([*filter(None, [spread_note(run)]), *parts, f"{text}."])


def _not_below(run: Run, model: str, rivals: Sequence[str]) -> list[str]:
    """Return the ``rivals`` whose log score is not significantly below the score of ``model``."""
    low = run.tables["prediction_pairs"].query("steps == @ALL and model == @model")
    low = low.set_index("rival")["low"]
    return [name for name in rivals if name != model and not low[name] > 0]


def predictors(run: Run) -> str:
    """Return a row for each model and baseline, highest log score first."""
    if "predictions" not in run.tables:
        return ""
    log, rows = log_scores(run), run.tables["predictions"].query("score == 'log_score'")
    means = rows.pivot(index="model", columns="steps", values="mean")[list(rows["steps"].unique())]
    names = dict.fromkeys(run.tables["predictions"]["model"])
    names = sorted(names, key=lambda n: -log["mean"].get(n, float("-inf")))
    rivals = log.drop(index=NONE, errors="ignore")
    differences = {name: _difference(row) for name, row in rivals.iterrows()}
    header = ["log score (nats a step)", "difference to the training mean, all steps", *means]
    return table(header, [[plain_name(n), differences.get(n, "–"), *means.loc[n]] for n in names])


def _difference(row: pd.Series) -> str:
    return f"{number(row['difference'])} {interval(row['low'], row['high'])}"


def coverage(run: Run) -> str:
    """Return the share of steps within ±1σ of the prediction by group of steps and joint."""
    rows = run.tables["predictions"]
    means, models = rows.set_index(["steps", "model", "score"])["mean"], [*rows["model"].unique()]
    cells = [
        [steps, joint, *(means[steps, m, f"coverage_of_one_sigma_{joint}"] for m in models)]
        for steps, joint in product(rows["steps"].unique(), run.joints)
    ]
    return table(["steps", "joint", *map(plain_name, models)], cells)


def filters(run: Run) -> str:
    """Return a row for each filter, training mean first; "" without a depth camera."""
    if not (verdict := filter_verdict(run)):
        return ""
    rows = run.tables[FILTERS].set_index(["model", "score"])
    names = list(dict.fromkeys(rows.index.get_level_values("model")))
    names = [NONE, MEMORY, *models_of(names), *(name for name in names if name.endswith(CLOSED))]
    scores = {f"rms error of {joint} (rad)": f"rms_error_{joint}_rad" for joint in run.joints}
    scores |= {f"coverage of {joint}": f"coverage_of_one_sigma_{joint}" for joint in run.joints}
    scores |= {"log score": "log_score"}

    def cell(name: str, score: str) -> str:
        if (name, score) not in rows.index or pd.isna(rows.loc[(name, score), "mean"]):
            return "–"
        row = rows.loc[(name, score)]
        plain = score != "log_score" or pd.isna(row["low"])
        return number(row["mean"]) + ("" if plain else f" ({_difference(row)})")

    cells = [[_labels([name]), *(cell(name, s) for s in scores.values())] for name in names]
    return f"{verdict} {TEXT['beyond']}\n\n{table(['filter', *scores], cells)}"


def filter_verdict(run: Run) -> str:
    """Return the filters with a higher log score or lower rms errors than the training mean."""
    if FILTERS not in run.tables:
        return ""
    rows, above = run.tables[FILTERS].set_index(["model", "score"]), TEXT["higher"]
    names = [name for name in dict.fromkeys(rows.index.get_level_values("model")) if name != NONE]
    errors = [f"rms_error_{joint}_rad" for joint in run.joints]
    higher = [name for name in names if rows.loc[(name, "log_score"), "low"] > 0]
    smaller = [n for n in names if all(rows.loc[(n, error), "high"] < 0 for error in errors)]
    if particle := [name for name in higher if name != MEMORY]:
        text = f"On {run.dataset} these particle filters have {above}: {_labels(particle)}."
    else:
        text = f"On {run.dataset} no particle filter has {above}."
    if smaller := [name for name in smaller if name not in (*particle, MEMORY)]:
        text += " These have a smaller rms error than the training mean in every joint: "
        text += f"{_labels(smaller)}."
    if MEMORY in names:
        has = "has a" if MEMORY in higher else "has no"
        text += f" The linear autoregressive filter {has} higher log score than the training mean."
    return text


def _labels(names: Iterable[str]) -> str:
    models = {name: name.removesuffix(CLOSED) for name in names}
    loops = {n: f"{m}, {'open' if n == m else 'closed'} loop" for n, m in models.items()}
    return "; ".join(LABELS.get(name, loop) for name, loop in loops.items())
