"""Model card: recommended model with formula, numbers, limits and evidence."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pipeline.models.joint_error.choice import (
    CONFIRMED,
    LAST_VALUE,
    chosen_law,
    confirmations,
    faults_of,
    left_out,
    margins,
    mean_scores,
    pooled,
    pooled_interval,
    ratio_with_interval,
    unconfirmed,
)
from pipeline.verdicts.deviations import LOST, RATIO, WITHIN, deviations, losses
from pipeline.verdicts.run import Run
from pipeline.verdicts.scores import (
    choice,
    coverage,
    filter_verdict,
    filters,
    predictors,
)
from pipeline.verdicts.wording import (
    MISSING,
    WORDS,
    interval,
    number,
    plain_name,
    render,
    table,
)

SLOW = 0.1  # share of the greatest joint speed below which a joint counts as slow
# number of takes below which no interval from resampled takes is printed
FEW_TAKES = 10
UNDETERMINED = 2.0  # factor between the fits without each motion of a number that is not determined
RANGES = ["quantity", "name", "unit", "least", "greatest"]
# kinds of samples of joint_scores that the card compares, and what they are
KINDS = {
    "commanded": "all commanded samples",
    "settled": "those not within 0.6 s of a jump of the commanded speed",
    "lag unknown": "all commanded samples, the run's lag not known",
}


def answer(run: Run) -> str:
    """Return the first paragraphs of the card: model, its predictions at three horizons, motions,
    recordings that were not used, parameters and limits.
    """
    t = run.tables
    if (scores := t.get("joint_scores")) is None:
        return render("answer.md", scores=False)
    model, _ = chosen_law(scores)
    words = {
        "first": first_line(run),
        "model": model,
        "motions": t["motions"],
        "scores": True,
    }
    if model is not None:
        parameters = t["joint_parameters"].query("model == @model")
        fastest, slow = _speeds(t["motion_ranges"])
        moving = set(", ".join(t["motions"]["moving"]).split(", "))
        words |= {
            "kinds": kinds_of_samples(scores, model),
            "fastest": fastest,
            "still": [joint for joint in fastest.index if joint not in moving],
            "slow": [joint for joint in slow.index if joint in moving],
            "required": f"{1 / CONFIRMED:.3g} to {CONFIRMED:.3g}",
            "horizons": list(dict.fromkeys(scores["horizon"])),
            "confirmed": confirmed_sigmas(scores, model),
            "unconfirmed": [
                entry
                for entry in unconfirmed(scores, model)
                if " at " not in entry["parameter"] or "rest" in entry["parameter"]
            ],
            "deviations": deviations(scores, model),
            "losses": losses(scores, model),
            "limits": {"ratio": RATIO, "within": WITHIN, "lost": LOST},
            "law": law_rows(parameters),
            "logs": int(parameters["logs"].max()),
        }
    words["unused"] = t["unused_recordings"][["recording", "reason"]].to_numpy()
    words["tested"] = "takes" in t and t["takes"]["part"].eq("test").any()
    return render("answer.md", **words)


def first_line(run: Run) -> str:
    """Return the first line of the card: the model for another motion, or none, and the reason."""
    if "joint_scores" not in run.tables:
        return answer(run).rstrip()
    model, why = chosen_law(run.tables["joint_scores"])
    if model is None:
        return f"**No model for another motion**: {why}."
    return f"**Model for another motion: {plain_name(model)}** (`{model}`): {why}."


def law_rows(parameters: pd.DataFrame) -> list[list[str]]:
    """Return a row for each joint of the law's numbers, each with its range in the fits without a
    held-out motion; a number whose range is wider than a factor UNDETERMINED is in brackets.
    """
    rows = []
    for _, joint in parameters.iterrows():
        row = [joint["joint"]]
        for name, column in WORDS["law"].items():
            unit = 1e6 if "µrad" in name else 1e3 if "ms" in name else 1.0
            value = unit * joint[column]
            if pd.isna(value):
                row.append(MISSING)
                continue
            text = f"{value:.3g}"
            ends = [joint.get(f"{end}:{column}") for end in ("least", "greatest")]
            if None not in ends and not np.isnan(ends).any():
                low, high = (unit * end for end in ends)
                text = f"{text} [{low:.3g}, {high:.3g}]"
                if high > UNDETERMINED * low:
                    text = f"({text})"
            row.append(text)
        rows.append(row)
    return rows


def kinds_of_samples(scores: pd.DataFrame, model: str) -> list[list[str]]:
    """Return for each of KINDS and each horizon the share of the commanded samples, predicted over
    measured σ, coverage and what is left of the autocorrelation over all joints, with the least and
    greatest joint and intervals over motions.
    """
    of_model = scores[scores["model"] == model]
    commanded = of_model[of_model["samples"] == "commanded"]
    totals = commanded.groupby("horizon")["count"].sum()
    rows = []
    for kind, words in KINDS.items():
        samples = of_model[of_model["samples"] == kind]
        joints = pooled(samples, ["horizon", "joint"]) if len(samples) else None
        for horizon, group in samples.groupby("horizon", sort=False):
            share = group["count"].sum() / totals[horizon]
            row = [words, horizon, f"{100 * min(share, 1):.0f} %"]
            parts = left_out(group)
            for name in ("ratio", "one_sigma", "two_sigma"):
                value, low, high = pooled_interval(parts, name)[:3]
                between = "" if pd.isna(low) else f" [{low:.2f}, {high:.2f}]"
                by_joint = joints.loc[horizon][name]
                ends = f"{by_joint.min():.2f} to {by_joint.max():.2f}"
                row.append(f"{value:.2f}{between}; joints {ends}")
            left = MISSING
            if horizon == "one sample":
                left = f"{parts['autocorrelation'].iloc[0]:.2f}"
            rows.append([*row, left])
    return rows


def confirmed_sigmas(scores: pd.DataFrame, model: str) -> list[list[str]]:
    """Return a row for each joint: by horizon predicted over measured σ with its interval, marked
    with "!" where the held-out motions do not confirm it.
    """
    table = confirmations(scores, model)
    table["cell"] = table.apply(ratio_with_interval, axis=1)
    table.loc[~table["confirmed"], "cell"] += " !"
    cells = table.pivot(index="joint", columns="horizon", values="cell")
    joints = list(dict.fromkeys(table["joint"]))
    horizons = list(dict.fromkeys(table["horizon"]))
    cells = cells.loc[joints, horizons].fillna(MISSING)
    return cells.reset_index().to_numpy().tolist()


def _speeds(ranges: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    """Return the greatest recorded |q̇| in rad/s by joint, for all joints and for slow joints."""
    speeds = ranges[ranges["quantity"] == "joint speed"].set_index("name")
    fastest = speeds[["least", "greatest"]].abs().max(axis=1)
    return fastest, fastest[fastest < SLOW * fastest.max()]


def compared_laws(scores: pd.DataFrame) -> str:
    """Return log scores by law and horizon over all commanded samples and over settled ones, the
    margin of the law of the card over each, and the number of faults. The last value is a
    yardstick, and no law.
    """
    moving = scores[scores["samples"] == "commanded"]
    totals = _scores_by_horizon(moving)
    settled = scores[scores["samples"] == "settled"]
    if settled.empty:  # no commanded speed jumps: all commanded samples are settled
        settled = moving
    settled = _scores_by_horizon(settled).mean(axis=1)
    best = chosen_law(scores)[0]
    rows = []
    for model, by_horizon in totals.iterrows():
        margin = MISSING
        faults = MISSING
        if best not in (None, model):
            mean, low, high = margins(moving, best, model)
            margin = f"{mean:.3g}"
            if np.isfinite(low):  # else one part is held out
                margin += f" {interval(low, high)}"
        if model != LAST_VALUE:
            faults = len(faults_of(moving, model))
        mean = mean_scores(moving)[model].mean()
        rows.append(
            [plain_name(model), *by_horizon, settled.get(model), mean, margin, faults],
        )
    header = [
        "law",
        *totals.columns,
        "settled, mean",
        "mean over motions",
        "law of the card above it",
        "unsound (joints, horizons)",
    ]
    return table(header, rows)


def _scores_by_horizon(scores: pd.DataFrame) -> pd.DataFrame:
    """Return log scores by model (rows) and horizon (columns), summed over joints."""
    totals = pooled(scores, ["model", "horizon", "joint"])["score"]
    return totals.groupby(["model", "horizon"], sort=False).sum().unstack(sort=False)


def has_model(run: Run) -> bool:
    """Return True if models are fitted, to an arm or to its joints without their geometry."""
    return bool(run.joints) or "joint_scores" in run.tables


def few_takes(run: Run) -> bool:
    """Return True if ``run`` has too few takes for an interval from resampled takes."""
    return run.recorded("takes", FEW_TAKES) < FEW_TAKES


def model_card(run: Run, others: Sequence[Run]) -> str:
    """Return the card of ``run`` with the first line of the card of each of the ``others``."""
    if not has_model(run):
        return render("model_card.md", run=run, modelled=False)
    t = run.tables
    parts = {
        "answer": answer(run),
        "filters": filter_verdict(run),
        "filter_scores": filters(run),
        "choice": _choice(run),
    }
    if (scores := t.get("joint_scores")) is not None:
        shown = chosen_law(scores)[0] or scores["model"].iloc[-1]
        rows = pooled(scores[scores["model"] == shown], ["samples", "joint", "horizon"])
        parts |= {"shown": shown, "rows": rows, "laws": compared_laws(scores)}
        parts["matrix"] = t.get("other_motions", ())
    if parts["choice"]:
        parts |= {"predictors": predictors(run), "coverage": coverage(run)}
    ranges = pd.concat([t[name] for name in ("motion_ranges", "ranges") if name in t])
    ranges = ranges.drop_duplicates(["quantity", "name"])
    parts["ranges"] = ranges[RANGES].itertuples(index=False)
    if "takes" in t:
        takes = t["takes"].drop_duplicates("take")
        parts["kept"] = takes[~takes["left_out"]].groupby("part").size()
        parts["gone"] = takes.loc[takes["left_out"], ["take", "reason"]].to_numpy()
    fitted = {model: run.metrics.get(f"fit_{model}", {}) for model in run.models}
    unknown = {}
    parameters = []
    for model, numbers in fitted.items():
        unknown[model] = _unknown_estimates(run, numbers)
        for row in _parameter_rows(run, numbers):
            if row[0] not in unknown[model]:
                parameters.append([model, *row])
    parts |= {"unknown": unknown, "parameters": parameters}
    parts["others"] = []
    for further in others:
        if has_model(further):
            line = (further.dataset, first_line(further), _choice(further))
            parts["others"].append(line)
    any_fit = any(fitted.values())
    return render(
        "model_card.md",
        run=run,
        modelled=True,
        tables=t,
        fitted=any_fit,
        **parts,
    )


def _parameter_rows(run: Run, fitted: Mapping[str, float]) -> list[list[object]]:
    """Return name, value, standard error and interval of the parameters in ``fitted`` that have a
    standard error; no interval from few takes.
    """
    rows = []
    for name, value in fitted.items():
        error = fitted.get(f"{name}_standard_error")
        if error is None:
            continue
        low = fitted.get(f"{name}_interval_low", np.nan)
        high = fitted.get(f"{name}_interval_high", np.nan)
        ends = MISSING if few_takes(run) else interval(low, high)
        rows.append([name, value, error, ends])
    return rows


def _choice(run: Run) -> str:
    return choice(run) if "predictions" in run.tables else ""


def _unknown_estimates(run: Run, fitted: Mapping[str, float]) -> dict[str, str]:
    """Return the estimates in ``fitted`` that the recordings do not determine, with reasons."""
    absent = {}
    for key, at_end in fitted.items():
        if at_end and key.endswith("_unbounded"):
            name = key.removesuffix("_unbounded")
            absent[name] = (
                "its search ended at a bound; only the noise level L is known"
            )
            absent[name.replace("u", "alpha", 1)] = "only the noise level L is known"
    limit = fitted.get("sigma_b_limit_of_the_covariance", float("inf"))
    if fitted.get("sigma_b", 0.0) >= limit:
        absent["sigma_b"] = "a step has no covariance at this estimate"
    if "ranges" in run.tables:
        _, slow = _speeds(run.tables["ranges"])
        for joint, speed in slow.items():
            name = f"std_share_of_the_step_{joint}"
            if name in fitted:
                absent[name] = f"{joint} hardly moved (at most {number(speed)} rad/s)"
    return absent
