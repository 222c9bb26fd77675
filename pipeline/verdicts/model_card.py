"""Model card: recommended model with formula, numbers, limits and evidence."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pipeline.statistics.horizons import (
    chosen_law,
    faults_of,
    left_out,
    margins,
    pooled,
    pooled_interval,
    unconfirmed,
)
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

STILL = 0.1  # share of the greatest joint speed below which a joint counts as standing still
FEW_TAKES = (
    10  # number of takes below which no interval from resampled takes is printed
)
RANGES = ["quantity", "name", "unit", "least", "greatest"]


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
        law = {"joint": parameters["joint"]}
        for name, column in WORDS["law"].items():
            values = parameters[column] * (1e6 if "µrad" in name else 1.0)
            law[name] = values.map("{:.3g}".format, na_action="ignore").astype(object)
        fastest, still = _speeds(t["motion_ranges"])
        words |= {"horizons": at_horizons(scores, model), "fastest": fastest}
        words |= {"still": [*still.index], "unconfirmed": unconfirmed(scores, model)}
        words["law"] = pd.DataFrame(law).fillna(MISSING).to_numpy()
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


def at_horizons(scores: pd.DataFrame, model: str) -> list[list[str]]:
    """Return predicted over measured σ, coverage and what is left of the autocorrelation by
    horizon, over all joints, with the least and greatest joint and intervals over motions.
    """
    own, rows = (
        scores[(scores["model"] == model) & (scores["samples"] == "commanded")],
        [],
    )
    joints = pooled(own, ["horizon", "joint"])
    for horizon, row in pooled(own, ["horizon"]).iterrows():
        rows.append([horizon])
        for name in ("ratio", "one_sigma", "two_sigma"):
            value, low, high, *_ = pooled_interval(
                left_out(own[own["horizon"] == horizon]), name
            )
            between = "" if pd.isna(low) else f" [{low:.2f}, {high:.2f}]"
            each = joints.loc[horizon][name]
            rows[-1].append(
                f"{value:.2f}{between}; joints {each.min():.2f} to {each.max():.2f}"
            )
        left = f"{row['autocorrelation']:.2f}" if horizon == "one sample" else MISSING
        rows[-1].append(left)
    return rows


def _speeds(ranges: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    """Return the greatest recorded |q̇| in rad/s by joint, for all joints and for still joints."""
    speeds = ranges[ranges["quantity"] == "joint speed"].set_index("name")
    fastest = speeds[["least", "greatest"]].abs().max(axis=1)
    return fastest, fastest[fastest < STILL * fastest.max()]


def compared_laws(scores: pd.DataFrame) -> str:
    """Return log scores by law and horizon, and the margin over the next simpler law."""
    moving, rows, before = scores[scores["samples"] == "commanded"], [], None
    totals = pooled(moving, ["model", "horizon", "joint"])["score"]
    totals = totals.groupby(["model", "horizon"], sort=False).sum().unstack(sort=False)
    for model, by_horizon in totals.iterrows():
        margin = MISSING
        if before is not None:
            mean, low, high = margins(moving, model, before)
            margin = f"{mean:.3g} {interval(low, high)}"
        rows.append(
            [plain_name(model), *by_horizon, margin, len(faults_of(moving, model))]
        )
        before = model
    header = [
        "law",
        *totals.columns,
        "mean above the line before",
        "unsound (joints, horizons)",
    ]
    return table(header, rows)


def few_takes(run: Run) -> bool:
    """Return True if ``run`` has too few takes for an interval from resampled takes."""
    return run.recorded("takes", FEW_TAKES) < FEW_TAKES


def model_card(run: Run, others: Sequence[Run]) -> str:
    """Return the card of ``run`` with the first line of the card of each of the ``others``."""
    if not run.joints:
        return render("model_card.md", run=run)
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
    seen = pd.concat([t[name] for name in ("motion_ranges", "ranges") if name in t])
    parts["ranges"] = seen.drop_duplicates(["quantity", "name"])[RANGES].itertuples(
        index=False
    )
    if "takes" in t:
        takes = t["takes"].drop_duplicates("take")
        parts["kept"] = takes[~takes["left_out"]].groupby("part").size()
        parts["gone"] = takes.loc[takes["left_out"], ["take", "reason"]].to_numpy()
    fitted = {model: run.metrics.get(f"fit_{model}", {}) for model in run.models}
    parts["unknown"] = {
        name: _unknown_estimates(run, own) for name, own in fitted.items()
    }
    parts["parameters"] = [
        [model, name, value, error, MISSING if few_takes(run) else interval(*ends)]
        for model, own in fitted.items()
        for name, value in own.items()
        if (error := own.get(f"{name}_standard_error")) is not None
        if name not in parts["unknown"][model]
        for ends in [
            [own.get(f"{name}_interval_{end}", np.nan) for end in ("low", "high")]
        ]
    ]
    parts["others"] = [
        (o.dataset, first_line(o), _choice(o)) for o in others if o.joints
    ]
    return render(
        "model_card.md", run=run, tables=t, fitted=any(fitted.values()), **parts
    )


def _choice(run: Run) -> str:
    return choice(run) if "predictions" in run.tables else ""


def _unknown_estimates(run: Run, fitted: Mapping[str, float]) -> dict[str, str]:
    """Return the estimates in ``fitted`` that the recordings do not determine, with reasons."""
    absent = {}
    for key in (
        key for key, found in fitted.items() if found and key.endswith("_unbounded")
    ):
        name = key.removesuffix("_unbounded")
        absent[name] = "its search ended at a bound; only the noise level L is known"
        absent[name.replace("u", "alpha", 1)] = "only the noise level L is known"
    if fitted.get("sigma_b", 0.0) >= fitted.get(
        "sigma_b_limit_of_the_covariance", float("inf")
    ):
        absent["sigma_b"] = "a step has no covariance at this estimate"
    if "ranges" in run.tables:
        for joint, speed in _speeds(run.tables["ranges"])[1].items():
            if (name := f"std_share_of_the_step_{joint}") in fitted:
                absent[name] = f"{joint} hardly moved (at most {number(speed)} rad/s)"
    return absent
