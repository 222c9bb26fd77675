"""Model card: recommended model with formula, numbers, limits and evidence."""

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.statistics.horizons import (
    chosen_law,
    faults_of,
    left_out,
    margins,
    pooled,
    pooled_interval,
)
from pipeline.verdicts.run import Run
from pipeline.verdicts.scores import choice, coverage, filter_verdict, predictors
from pipeline.verdicts.wording import TEXTS, interval, number, page, plain_name, table

CARD = TEXTS["card"]
STILL = 0.1  # share of the greatest joint speed below which a joint counts as standing still
FEW_TAKES = 10  # number of takes below which no interval from resampled takes is printed


def answer(run: Run) -> str:
    """Return the first paragraphs of the card: model, its predictions at three horizons, motions,
    recordings that were not used, parameters and limits.
    """
    t, first = run.tables, first_line(run)
    if "joint_scores" not in t:
        return first
    model, _ = chosen_law(t["joint_scores"])
    counted = f"{t['motions']['takes'].sum()} runs of {len(t['motions'])} motion(s)"
    unused = t["unused_recordings"][["recording", "reason"]].to_numpy()
    left = f"Not used: {'; '.join(f'{name} ({reason})' for name, reason in unused)}."
    recorded = f"Recorded: {counted}. {left if len(unused) else 'Every recording was used.'}"
    if model is None:
        return f"{first}\n\n{recorded}"
    known = t["joint_parameters"][t["joint_parameters"]["model"] == model]
    parts = [first, at_horizons(t["joint_scores"], model), recorded]
    parts += [CARD["one_motion"]] if len(t["motions"]) == 1 else []
    parts += [CARD["law"], _parameters_of_law(known), _limits(run)]
    return "\n\n".join([*parts, f"Export: `python -m pipeline export {model}`."])


def first_line(run: Run) -> str:
    """Return the first line of the card: the model for another motion, or none, and the reason."""
    if "joint_scores" not in run.tables:
        return CARD["not_held_out"]
    model, why = chosen_law(run.tables["joint_scores"])
    if model is None:
        return f"**No model for another motion**: {why}."
    return f"**Model for another motion: {plain_name(model)}** (`{model}`): {why}."


def at_horizons(scores: pd.DataFrame, model: str) -> str:
    """Return predicted over measured σ, coverage and what is left of the autocorrelation by
    horizon, over all joints, with the least and greatest joint and intervals over motions.
    """
    own, rows = scores[(scores["model"] == model) & (scores["samples"] == "commanded")], []
    joints = pooled(own, ["horizon", "joint"])
    for horizon, row in pooled(own, ["horizon"]).iterrows():
        cells, parts = [horizon], left_out(own[own["horizon"] == horizon])
        for name in ("ratio", "one_sigma", "two_sigma"):
            value, low, high, _ = pooled_interval(parts, name)
            ends = joints.loc[horizon][name].agg(["min", "max"])
            ends = f"joints {ends['min']:.2f} to {ends['max']:.2f}"
            between = "" if pd.isna(low) else f" [{low:.2f}, {high:.2f}]"
            cells.append(f"{value:.2f}{between}; {ends}")
        left = f"{row['autocorrelation']:.2f}" if horizon == "one sample" else "–"
        rows.append([*cells, left])
    header = ["ahead", "σ predicted/measured", "within ±1σ", "within ±2σ", "autocorrelation left"]
    return table(header, rows)


def _parameters_of_law(known: pd.DataFrame) -> str:
    cells = {"joint": known["joint"]}
    for name, column in CARD["parameters"].items():
        factor = 1e6 if "µrad" in name else 1.0
        values = (factor * known[column]).map("{:.3g}".format, na_action="ignore")
        cells[name] = values.astype(object).fillna("–")
    return table([*cells], zip(*cells.values(), strict=True))


def _speeds(ranges: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    """Return the greatest recorded |q̇| in rad/s by joint, for all joints and for still joints."""
    speeds = ranges[ranges["quantity"] == "joint speed"].set_index("name")
    fastest = speeds[["least", "greatest"]].abs().max(axis=1)
    return fastest, fastest[fastest < STILL * fastest.max()]


def _limits(run: Run) -> str:
    """Return the joints that stood still, and the poses and speeds that were not recorded."""
    fastest, still = _speeds(run.tables["motion_ranges"])
    text = f" These joints stood still: {', '.join(still.index)}." if len(still) else ""
    seen = ", ".join(f"{joint} {number(float(f'{speed:.3g}'))}" for joint, speed in fastest.items())
    text += f" No evidence on speeds above (rad/s) {seen}, or on poses outside the ranges below."
    return f"**Limits of the recordings:**{text}"


def held_out(run: Run) -> str:
    """Return log scores by law and horizon, the margin over the next simpler law, and the scores of
    the matrix models at one step.
    """
    scores, rows, before = run.tables["joint_scores"], [], None
    moving = scores[scores["samples"] == "commanded"]
    totals = pooled(moving, ["model", "horizon", "joint"])["score"]
    totals = totals.groupby(["model", "horizon"], sort=False).sum().unstack(sort=False)
    for model, by_horizon in totals.iterrows():
        margin = "–"
        if before is not None:
            mean, low, high = margins(moving, model, before)
            margin = f"{mean:.3g} {interval(low, high)}"
        faults = len(faults_of(moving, model))
        rows.append([plain_name(model), *by_horizon, margin, faults])
        before = model
    header = ["law", *totals.columns, "mean above the line before", "unsound (joints, horizons)"]
    text = table(header, rows)
    matrix = run.tables.get("other_motions", pd.DataFrame())
    if len(matrix):
        means = matrix.groupby("model", sort=False)["score"].mean()
        cells = [[plain_name(str(name)), value] for name, value in means.items()]
        reasons = matrix[matrix["reason"].astype(object).fillna("").ne("")].drop_duplicates("model")
        notes = "".join(
            f"\n- {plain_name(row.model)}: no score on motion {row.motion}: {row.reason}"
            for row in reasons.itertuples()
        )
        text += f"\n\n{CARD['matrix']}\n\n{table(['model', 'nats a step'], cells)}\n{notes}"
    moves = run.tables["motions"][["motion", "takes", "steps", "moving"]].astype(str).to_numpy()
    return f"{text}\n\n{table(['motion', 'runs', 'samples', 'joints that move'], moves)}"


def by_joint(run: Run, samples: str) -> str:
    """Return σ, coverage and score of the richest law by joint and horizon, of ``samples``."""
    scores = run.tables["joint_scores"]
    model = chosen_law(scores)[0] or scores["model"].iloc[-1]
    own = pooled(
        scores[(scores["model"] == model) & (scores["samples"] == samples)], ["joint", "horizon"]
    )
    rows = [
        [joint, horizon, *(f"{1e6 * row[name]:.3g}" for name in ("predicted_rad", "measured_rad"))]
        + [f"{row[name]:.2f}" for name in ("one_sigma", "two_sigma", "score")]
        for (joint, horizon), row in own.iterrows()
    ]
    header = ["joint", "ahead", "σ predicted, µrad", "measured", "±1σ", "±2σ", "log score (nats)"]
    return f"Law: {plain_name(model)}.\n\n{table(header, rows)}"


def few_takes(run: Run) -> bool:
    """Return True if ``run`` has too few takes for an interval from resampled takes."""
    return run.recorded("takes", FEW_TAKES) < FEW_TAKES


def model_card(run: Run, others: Sequence[Run]) -> str:
    """Return the card of ``run`` with the first line of the card of each of the ``others``."""
    scored = "predictions" in run.tables
    title = f"# Motion model for dataset {run.dataset}, scale {run.scale}"
    if not run.joints:
        return page([title, CARD["no_robot"]])
    parts: dict[str, str] = {}
    if "joint_scores" in run.tables:
        parts["Why"] = f"{CARD['rule']}\n\n{held_out(run)}"
        parts["Predicted and measured errors on held-out motions"] = by_joint(run, "commanded")
        parts["Joints at rest"] = by_joint(run, "at rest")
    if scored:
        parts["Analysed motion"] = f"{CARD['this_motion']}\n\n{predictors(run)}"
        parts["Coverage by joint and speed"] = f"{CARD['coverage']}\n\n{coverage(run)}"
    if filters := filter_verdict(run):
        parts["In a filter"] = f"{filters} [Scores](report.md)."
    if any(f"fit_{model}" in run.metrics for model in run.models):
        how = "Standard errors by the bootstrap over takes."
        parts["Parameters of the run's models"] = f"{how}\n\n{_parameters(run)}"
    tables = [run.tables[name] for name in ("motion_ranges", "ranges") if name in run.tables]
    seen = pd.concat(tables).drop_duplicates(["quantity", "name"])
    rows = seen[["quantity", "name", "unit", "least", "greatest"]].itertuples(index=False)
    parts["Where it was fitted"] = table(["", "of", "unit", "least", "greatest"], rows)
    parts["Where it must not be used"] = CARD["not_for"]
    if "takes" in run.tables:
        takes = run.tables["takes"].drop_duplicates("take")
        gone, kept = takes[takes["left_out"]], takes[~takes["left_out"]]
        parted = kept.groupby("part").size()
        counted = ", ".join(f"{count} {part}" for part, count in parted.items())
        text = f"Takes kept: {counted}; left out: {len(gone)}."
        rows = table(["take", "reason"], gone[["take", "reason"]].to_numpy())
        parts["Takes left out"] = f"{text}\n\n{rows}" if len(gone) else text
    parts["Export"] = CARD["export"]
    parts["Other datasets"] = "\n".join(
        f"- {one.dataset}: {first_line(one)}"
        + (f" {choice(one)}" if "predictions" in one.tables else "")
        for one in others
        if one.joints
    )
    text = f"**This motion.** {choice(run) if scored else CARD['unknown']}"
    return page([title, answer(run), text], parts)


def _parameters(run: Run) -> str:
    """Return a row for each known estimate with a standard error, and reasons for unknown ones."""
    rows, notes, few = [], [], few_takes(run)
    for model in run.models:
        fitted = run.metrics.get(f"fit_{model}", {})
        absent, plain = _unknown_estimates(run, fitted), plain_name(model)
        notes += [f"- {plain}: no number for {name}: {why}" for name, why in absent.items()]
        for name in fitted:
            error = fitted.get(f"{name}_standard_error")
            if name not in absent and error is not None:
                ends = (fitted.get(f"{name}_interval_{e}", float("nan")) for e in ("low", "high"))
                cell = "–" if few else interval(*ends)
                rows.append([model, name, fitted[name], error, cell])
    text = table(["model", "parameter", "value", "standard error", "95 % interval"], rows)
    return "\n\n".join(filter(None, [text, "\n".join(notes)]))


def _unknown_estimates(run: Run, fitted: Mapping[str, float]) -> dict[str, str]:
    """Return the estimates in ``fitted`` that the recordings do not determine, with reasons."""
    absent = {}
    for key, found in fitted.items():
        if found and key.endswith("_unbounded"):
            name = key.removesuffix("_unbounded")
            absent[name] = "its search ended at a bound; only the noise level L is known"
            absent[name.replace("u", "alpha", 1)] = "only the noise level L is known"
    if fitted.get("sigma_b", 0.0) >= fitted.get("sigma_b_limit_of_the_covariance", float("inf")):
        absent["sigma_b"] = "a step has no covariance at this estimate"
    if "ranges" in run.tables:
        for joint, speed in _speeds(run.tables["ranges"])[1].items():
            if (name := f"std_share_of_the_step_{joint}") in fitted:
                absent[name] = f"{joint} hardly moved (at most {number(speed)} rad/s)"
    return absent
