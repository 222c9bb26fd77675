"""Model card: recommended model with formula, numbers, limits and evidence."""

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.verdicts.run import Run
from pipeline.verdicts.scores import choice, coverage, filter_verdict, predictors
from pipeline.verdicts.wording import TEXTS, interval, number, page, plain_name, table

CARD = TEXTS["card"]
EACH = "each"  # motion of the rows with the mean over all held-out motions
MANY, OFF = 0.5, 4.0  # greatest share of held-out std that may be wrong by more than this factor
MOVING = 0.1  # share of a joint's greatest recorded std above which a held-out std counts
STILL = 0.1  # share of the greatest joint speed below which a joint counts as standing still
HEAVY = 4  # kurtosis above which tails are called heavier than normal
FEW_TAKES = 10  # number of takes below which no interval from resampled takes is printed


def recommended(
    scores: pd.DataFrame, spread: pd.DataFrame, motions: pd.DataFrame
) -> tuple[str | None, str]:
    """Return the model for another motion, or None, and the reason, by the rule on the card."""
    means = scores[scores["motion"] == EACH].set_index("model")["score"].dropna()
    if means.empty:
        return None, "no model has a score on every held-out motion"
    best = str(means.idxmax())
    score, name = f"{number(means[best])} nats a step", plain_name(best)
    if len(motions) < 2:
        return None, CARD["one_motion"].format(name, score)
    own = spread[(spread["model"] == best) & (spread["measured_rad"] > 0)]
    own = own[own["measured_rad"] >= MOVING * own.groupby("joint")["measured_rad"].transform("max")]
    ratio = own["predicted_rad"] / own["measured_rad"]
    off = ((ratio > OFF) | (ratio < 1 / OFF)).mean() if len(own) else 0.0
    if off > MANY:
        return None, CARD["wrong_spread"].format(name, 100 * off, OFF)
    return best, f"highest mean log score over {len(motions)} held-out motions, {score}"


def answer(run: Run) -> str:
    """Return the first paragraphs of the card: model, formula, takes, motions, limits and tails."""
    t = run.tables
    if "other_motions" not in t:
        return CARD["not_held_out"]
    model, why = recommended(t["other_motions"], t["motion_spread"], t["motions"])
    counted = f"{t['motions']['takes'].sum()} takes of {len(t['motions'])} motion(s)"
    if model is None:
        return f"**No model for another motion**: {why}.\n\nRecorded: {counted}."
    known, tails = (t[name][t[name]["model"] == model] for name in ("plain_parameters", "tails"))
    parts = [f"**Model for another motion: {plain_name(model)}** (`{model}`): {why}."]
    parts += [_formula(model, known)] if len(known) else []
    parts.append(f"Fitted to {counted}. {_limits(run, model)}")
    if len(tails):
        ends = [number(float(f"{tails['kurtosis'].agg(end):.3g}")) for end in ("min", "max")]
        size = "heavier tails than" if tails["kurtosis"].max() > HEAVY else "tails like"
        share = 100 * tails["three_sigma"].min()
        parts.append(CARD["kurtosis"].format(size=size, low=ends[0], high=ends[1], share=share))
    return "\n\n".join([*parts, f"Export: `python -m pipeline export {model}`."])


def _formula(model: str, known: pd.DataFrame) -> str:
    kind, tails = model.split("_")
    law = CARD["student" if tails == "t" else "normal"]
    text = CARD["formula"].format(std=CARD["std"][kind], law=law)
    cells = {"joint": known["joint"]}
    cells["a_j"] = [f"{1e6 * value:.3g} µrad" for value in known["at_rest_rad"]]
    if kind in CARD["gains"]:
        symbol, column, factor, unit = CARD["gains"][kind]
        gains = known[column].map(lambda gain: f"{factor * gain:.3g} {unit}", na_action="ignore")
        cells[symbol] = gains.astype(object).fillna("not known")
    if tails == "t":
        cells["ν_j"] = known["degrees"]
    return f"{text}\n\n{table([*cells], zip(*cells.values(), strict=True))}"


def _speeds(ranges: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    """Return the greatest recorded |q̇| in rad/s by joint, for all joints and for still joints."""
    speeds = ranges[ranges["quantity"] == "joint speed"].set_index("name")
    fastest = speeds[["least", "greatest"]].abs().max(axis=1)
    return fastest, fastest[fastest < STILL * fastest.max()]


def _limits(run: Run, model: str) -> str:
    """Return the undetermined parameters of ``model``, and the poses and speeds not recorded."""
    rows = run.tables["untold"].query("model == @model")
    text = "".join(
        f" No number for the {parameter} of {', '.join(own['joint'])} ({own['found'].iloc[0]})."
        for parameter, own in rows.groupby("parameter", sort=False)
    )
    fastest, still = _speeds(run.tables["motion_ranges"])
    text += f" These joints stood still: {', '.join(still.index)}." if len(still) else ""
    seen = ", ".join(f"{joint} {number(float(f'{speed:.3g}'))}" for joint, speed in fastest.items())
    text += f" No evidence on speeds above (rad/s) {seen}, or on poses outside the ranges below."
    return f"**Limits of the recordings:**{text}"


def held_out(run: Run) -> str:
    """Return log scores by model and held-out motion; a single motion has the mean over takes."""
    scores, motions = run.tables["other_motions"], run.tables["motions"]
    wide = scores.pivot(index="model", columns="motion", values="score")
    # parts of a single motion's takes are held out in turn
    names = [n for n in dict.fromkeys(scores["motion"]) if n != EACH] if len(motions) > 1 else []
    wide = wide.reindex(columns=[EACH, *names]) if EACH in wide else wide
    wide = wide.sort_values(wide.columns[0], ascending=False, na_position="last")
    header = ["log score (nats a step)", "mean", *(f"motion {name}" for name in names)]
    text = table(header, [[plain_name(str(row[0])), *row[1:]] for row in wide.itertuples()])
    missing = scores[scores["reason"].astype(object).fillna("").ne("")].drop_duplicates("model")
    reasons = "".join(
        f"\n- {plain_name(row.model)}: no score on motion {row.motion}: {row.reason}"
        for row in missing.itertuples()
    )
    moves = motions[["motion", "takes", "steps", "moving"]].astype(str).to_numpy()
    return f"{text}\n{reasons}\n\n{table(['motion', 'takes', 'steps', 'joints that move'], moves)}"


def held_out_spread(run: Run) -> str:
    """Return predicted and measured rms noise of a step by held-out motion and joint."""
    spread, place = run.tables["motion_spread"], ["motion", "joint"]
    if len(run.tables["motions"]) == 1:
        sizes = ["predicted_rad", "measured_rad"]
        spread = spread.assign(motion=run.tables["motions"]["motion"].iloc[0])
        spread[sizes] = spread[sizes] ** 2
        means = spread.groupby([*place, "model"], sort=False)[sizes].mean()
        spread = means.pow(0.5).reset_index()
    wide = spread.pivot(index=place, columns="model", values="predicted_rad")
    measured = spread.drop_duplicates(place).set_index(place)["measured_rad"]
    wide = wide.loc[measured.index, list(dict.fromkeys(spread["model"]))]
    wide.insert(0, "measured", measured)
    rows = ([*map(str, row[0]), *(f"{1e6 * v:.3g}" for v in row[1:])] for row in wide.itertuples())
    return f"Rms noise of a step, µrad.\n\n{table([*place, *map(plain_name, wide.columns)], rows)}"


def held_out_tails(run: Run) -> str:
    """Return kurtosis and coverage of the held-out noise by model and joint."""
    tails = run.tables["tails"]
    columns = ["kurtosis", "one_sigma", "two_sigma", "three_sigma"]
    cells = tails[["model", "joint"]].join(tails[columns].map("{:.3g}".format))
    cells["model"] = cells["model"].map(plain_name)
    return table(["model", "joint", "kurtosis", "1σ", "2σ", "3σ"], cells.to_numpy())


def few_takes(run: Run) -> bool:
    """Return True if ``run`` has too few takes for an interval from resampled takes."""
    return run.metrics.get("motion", {}).get("recorded_takes", FEW_TAKES) < FEW_TAKES


def model_card(run: Run, others: Sequence[Run]) -> str:
    """Return the card of ``run`` with the first line of the card of each of the ``others``."""
    scored = "predictions" in run.tables
    title = f"# Motion model for dataset {run.dataset}, scale {run.scale}"
    if not run.joints:
        return page([title, CARD["no_robot"]])
    parts: dict[str, str] = {}
    if "other_motions" in run.tables:
        parts["Why"] = f"{CARD['rule']}\n\n{held_out(run)}"
        parts["Predicted and measured noise on held-out motions"] = held_out_spread(run)
        parts["Tails and coverage"] = f"{CARD['tails']}\n\n{held_out_tails(run)}"
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
        f"- {one.dataset}: {answer(one).splitlines()[0]}"
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
