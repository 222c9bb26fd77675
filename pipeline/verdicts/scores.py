"""Scores of the predictors and filters of the analysed motion against the training mean."""

from collections.abc import Iterable
from itertools import product

import pandas as pd

from pipeline.core.filters import CLOSED, MEMORY, NONE, models_of
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import (
    MISSING,
    difference,
    number,
    plain_name,
    say,
    table,
)

MATRIX_KINDS = ("wishart", "gaussian")
ADDITIVE = "additive"  # name of the paper's own rival
ALL = "all"  # name of the group of all steps
FILTERS = "filter_against_none"
# as in claims.yaml
BETWEEN = "share_of_variance_between_recordings"
LIMIT = 0.5
LABELS = {NONE: "training mean", MEMORY: "autoregressive, linear filter"}


def log_scores(run: Run) -> pd.DataFrame:
    """Return the rows of the log score over all steps by model, without models without a score."""
    rows = run.tables["predictions"].query("steps == @ALL and score == 'log_score'")
    return rows[rows["mean"].notna()].set_index("model")


def pairs_of(run: Run) -> pd.DataFrame:
    """Return the differences in log score over all steps by model and rival."""
    return (
        run.tables["prediction_pairs"]
        .query("steps == @ALL")
        .set_index(["model", "rival"])
    )


def result(run: Run) -> list[str]:
    """Return sentences on the predictors of ``run``, on the matrix models against the additive
    model, the paper's own comparison, and on the filters; none without their scores.
    """
    sentences = []
    if "predictions" in run.tables:
        means = log_scores(run)["mean"].sort_values(ascending=False, kind="stable")
        pairs = pairs_of(run)
        best = means.index[0]
        matrix = _is_matrix(run, best)
        rivals = [name for name in means.index if _is_matrix(run, name) != matrix]
        words = {
            "best": plain_name(best),
            "mean": means[best],
            "matrix": matrix,
            "rivals": [pairs.loc[best, name] for name in rivals[:1]],
        }
        sentences.append(say("best", run=run, **words))
        scored = pairs.index[pairs["difference"].notna()]
        additive = {}
        for model in ("gaussian", "wishart"):
            if (model, ADDITIVE) in scored:
                additive[plain_name(model)] = pairs.loc[model, ADDITIVE]
        sentences.append(say("against_additive", models=additive))
    if FILTERS in run.tables:
        rows = run.tables[FILTERS].query("score == 'log_score' and difference.notna()")
        rows = rows.set_index("model").sort_values("difference", ascending=False)
        linear = [row for name, row in rows.iterrows() if name == MEMORY]
        particle = [row for name, row in rows.iterrows() if name not in (NONE, MEMORY)]
        sentences.append(say("best_filter", particle=particle, linear=linear))
    return [*filter(None, sentences)]


def widths(run: Run) -> list[str]:
    """Return a sentence for each matrix model on the joints where its standard deviation is widest
    and narrowest beside the recordings, and where its error is above the error of no noise.
    """
    rows = run.evidence.query("quantity == 'std' and rival == ''")
    stds = rows.pivot(index="joint", columns="model", values="value")
    stds = stds.reindex([*run.joints])
    above_zero = "quantity == 'std_error' and rival == 'no_noise' and low > 0"
    errors = run.evidence.query(above_zero)
    sentences = []
    for model, kind in run.models.items():
        if kind not in MATRIX_KINDS or model not in stds:
            continue
        ratio = stds[model] / stds["recorded"]
        if ratio.notna().all():
            above = [*errors["joint"][errors["model"] == model]]
            sentences.append(say("widths", model=model, ratio=ratio, above=above))
    return sentences


def without_random_matrix(run: Run) -> list[str]:
    """Return a sentence on the mean errors of the wrench study without a random matrix, if any."""
    place = "quantity == 'mean_error_of_variances' and estimator == 'none'"
    rows = run.evidence.query(place)
    rows = rows.assign(cables=rows["configuration"].astype(int)).sort_values("cables")
    if not len(rows):
        return []
    ends = rows.iloc[[0, -1]]
    errors = [
        f"{number(100 * row.value, 2)} % with {row.cables}" for row in ends.itertuples()
    ]
    return [say("without_random_matrix", errors=errors)]


def _is_matrix(run: Run, name: str) -> bool:
    """Return True for a matrix model of the run, or a control named after one."""
    return run.models.get(name, name.partition("_")[0]) in MATRIX_KINDS


def spread_note(run: Run) -> str:
    """Return a note if the recordings give no evidence on the standard deviation, else ""."""
    return say("no_spread") if run.recorded(BETWEEN, 0.0) > LIMIT else ""


def choice(run: Run) -> str:
    """Return sentences: matrix model with a log score above all baselines; highest log score."""
    means = log_scores(run)["mean"]
    low = pairs_of(run)["low"]

    def not_below(model: str, rivals: Iterable[str]) -> list[str]:
        return [plain_name(n) for n in rivals if n != model and not low[model, n] > 0]

    best = means.idxmax()
    baselines = [name for name in means.index if not _is_matrix(run, name)]
    matrix = [name for name in run.models if name in means and name not in baselines]
    above = {name: not_below(name, baselines) for name in matrix}
    passing = [name for name in matrix if not above[name]]
    absent = [n for n in run.tables["predictions"]["model"].unique() if n not in means]
    words = {
        "above": above,
        "passing": passing and means[passing].idxmax(),
        "absent": absent,
    }
    equal = not_below(best, means.index)
    return say(
        "choice",
        run=run,
        note=spread_note(run),
        best=best,
        equal=equal,
        **words,
    )


def predictors(run: Run) -> str:
    """Return a row for each model and baseline, highest log score first; "" without scores."""
    if "predictions" not in run.tables:
        return ""
    log = log_scores(run)
    rows = run.tables["predictions"].query("score == 'log_score'")
    means = rows.pivot(index="model", columns="steps", values="mean")
    means = means.loc[rows["model"].unique(), rows["steps"].unique()]
    means = means.sort_values(ALL, ascending=False, kind="stable")
    rivals = log.drop(index=NONE, errors="ignore")
    differences = {name: difference(row) for name, row in rivals.iterrows()}
    header = [
        "log score (nats a step)",
        "difference to the training mean, all steps",
        *means,
    ]
    cells = []
    for model, by_steps in means.iterrows():
        against_mean = differences.get(model, MISSING)
        cells.append([plain_name(model), against_mean, *by_steps])
    return table(header, cells)


def coverage(run: Run) -> str:
    """Return the share of steps within ±1σ of the prediction by group of steps and joint."""
    rows = run.tables["predictions"]
    models = [*rows["model"].unique()]
    means = rows.pivot(index=["steps", "score"], columns="model", values="mean")
    groups = rows["steps"].unique()
    cells = []
    for steps, joint in product(groups, run.joints):
        by_model = means.loc[(steps, f"coverage_of_one_sigma_{joint}"), models]
        cells.append([steps, joint, *by_model])
    names = [plain_name(model) for model in models]
    return table(["steps", "joint", *names], cells)


def filters(run: Run) -> str:
    """Return a row for each filter, training mean first; "" without a depth camera."""
    if FILTERS not in run.tables:
        return ""
    rows = run.tables[FILTERS].set_index(["model", "score"])
    models = dict.fromkeys(rows.index.get_level_values("model"))
    closed_loop = [name for name in models if name.endswith(CLOSED)]
    names = [NONE, MEMORY, *models_of(models), *closed_loop]
    headings = ["filter"]
    scores = []
    for joint in run.joints:
        headings.append(f"rms error of {joint} (rad)")
        scores.append(f"rms_error_{joint}_rad")
    for joint in run.joints:
        headings.append(f"coverage of {joint}")
        scores.append(f"coverage_of_one_sigma_{joint}")
    headings.append("log score")
    cells = []
    for name in names:
        means = rows["mean"].reindex([(name, score) for score in scores])
        log_score = _log_score_text(rows, name)
        cells.append([_labels([name]), *means, log_score])
    return table(headings, cells)


def _log_score_text(rows: pd.DataFrame, name: str) -> str:
    """Return the log score of the filter ``name`` with its difference to the training mean."""
    if (name, "log_score") not in rows.index:
        return MISSING
    row = rows.loc[(name, "log_score")]
    text = number(row["mean"])
    if pd.isna(row["mean"]) or pd.isna(row["low"]):
        return text
    return f"{text} ({difference(row)})"


def filter_verdict(run: Run) -> str:
    """Return the filters with a higher log score or lower rms errors than the training mean, or ""
    without a depth camera.
    """
    if FILTERS not in run.tables:
        return ""
    rows = run.tables[FILTERS].query("model != @NONE")
    low = rows.pivot(index="model", columns="score", values="low")
    high = rows.pivot(index="model", columns="score", values="high")
    names = [*rows["model"].unique()]
    higher = [name for name in names if low.loc[name, "log_score"] > 0]
    particle = [name for name in higher if name != MEMORY]
    errors = [f"rms_error_{joint}_rad" for joint in run.joints]
    is_smaller = (high[errors] < 0).all(axis=1)
    smaller = []
    for name in names:
        if name not in (*higher, MEMORY) and is_smaller[name]:
            smaller.append(name)
    words = {"higher": _labels(particle), "smaller": _labels(smaller)}
    linear = [MEMORY in higher] if MEMORY in names else []
    return say("filters", run=run, linear=linear, **words)


def _labels(names: Iterable[str]) -> str:
    """Return the names of filters on the pages, with the loop of a model's filter."""
    labels = []
    for name in names:
        model = name.removesuffix(CLOSED)
        loop = "open" if name == model else "closed"
        labels.append(LABELS.get(name, f"{model}, {loop} loop"))
    return "; ".join(labels)
