"""The recommended model for another motion: rule, answer and the tables of held-out motions."""

from __future__ import annotations

import pandas as pd

from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import TEXTS, number, plain_name, table

EACH = "each"  # the mean over all held-out motions
# what a standard deviation of the noise is, by the beginning of the model's name
STD = {"additive": "a_j", "scaled": "√(a_j² + b_j²·Δq_j²)", "distance": "√(a_j² + c_j·|Δq_j|)"}
# its gain: symbol, column, factor and unit
GAINS = {
    "scaled": ("b_j", "share_of_step", 100, "%"),
    "distance": ("c_j", "per_angle_rad", 1e6, "µrad"),
}
MANY, OFF = 0.5, 4.0  # share of held-out spreads that may be off by more than this factor
MOVING = 0.1  # of a joint's greatest recorded spread, above which a held-out spread counts
STILL = 0.1  # of the greatest joint speed, below which a joint counts as standing still
HEAVY = 4  # kurtosis above which tails are called heavier than normal


def recommended(
    scores: pd.DataFrame, spread: pd.DataFrame, motions: pd.DataFrame
) -> tuple[str | None, str]:
    """Return the name of the model for another motion by the card's rule, or None, and the reason.

    ``scores``, ``spread`` and ``motions`` are the tables other_motions, motion_spread and motions.
    """
    means = scores[scores["motion"] == EACH].set_index("model")["score"].dropna()
    if means.empty:
        return None, "no model has a score on every held-out motion"
    best = str(means.idxmax())
    score = f"{number(means[best])} nats a step"
    if len(motions) < 2:
        return None, (
            "the recordings hold one motion, so nothing is known of another; on held-out takes of "
            f"it {plain_name(best)} has the highest log score, {score}"
        )
    own = spread[(spread["model"] == best) & (spread["measured_rad"] > 0)]
    own = own[own["measured_rad"] >= MOVING * own.groupby("joint")["measured_rad"].transform("max")]
    ratio = own["predicted_rad"] / own["measured_rad"]
    off = ((ratio > OFF) | (ratio < 1 / OFF)).mean() if len(own) else 0.0
    if off > MANY:
        return None, (
            f"the best of them, {plain_name(best)}, predicts {100 * off:.0f} % of the held-out "
            f"spreads by more than a factor of {OFF:g} wrongly"
        )
    return best, f"highest mean log score over {len(motions)} held-out motions, {score}"


def answer(run: Run) -> str:
    """Return the card's first paragraphs: model, formula, takes and motions, unknowns and tails."""
    t, card = run.tables, TEXTS["card"]
    if "other_motions" not in t:
        return card["not_held_out"]
    model, why = recommended(t["other_motions"], t["motion_spread"], t["motions"])
    counted = f"{t['motions']['takes'].sum()} takes of {len(t['motions'])} motion(s)"
    if model is None:
        return f"**No model for another motion**: {why}.\n\nRecorded: {counted}."
    known, tails = (t[name][t[name]["model"] == model] for name in ("plain_parameters", "tails"))
    parts = [f"**Model for another motion: {plain_name(model)}** (`{model}`): {why}."]
    parts += [_formula(model, known)] if len(known) else []
    parts.append(f"Fitted to {counted}. {_untold(run, model)}")
    if len(tails):
        ends = [number(float(f"{tails['kurtosis'].agg(end):.3g}")) for end in ("min", "max")]
        size = "heavier tails than" if tails["kurtosis"].max() > HEAVY else "tails like"
        share = 100 * tails["three_sigma"].min()
        parts.append(card["kurtosis"].format(size=size, low=ends[0], high=ends[1], share=share))
    return "\n\n".join([*parts, f"To have it: `python -m pipeline export {model}`."])


def _formula(model: str, known: pd.DataFrame) -> str:
    (kind, tails), card = model.split("_"), TEXTS["card"]
    text = card["formula"].format(std=STD[kind], law=card["student" if tails == "t" else "normal"])
    cells = {"joint": known["joint"]}
    cells["a_j"] = [f"{1e6 * value:.3g} µrad" for value in known["at_rest_rad"]]
    if kind in GAINS:
        symbol, column, factor, unit = GAINS[kind]
        cells[symbol] = [
            f"{factor * each:.3g} {unit}" if pd.notna(each) else "not known"
            for each in known[column]
        ]
    if tails == "t":
        cells["ν_j"] = known["degrees"]
    return f"{text}\n\n{table([*cells], zip(*cells.values(), strict=True))}"


def fastest_speeds(ranges: pd.DataFrame) -> pd.Series:
    """Return the greatest recorded |q̇| of each joint in rad/s from a table of ranges."""
    speeds = ranges[ranges["quantity"] == "joint speed"].set_index("name")
    return speeds[["least", "greatest"]].abs().max(axis=1)


def _untold(run: Run, model: str) -> str:
    """The parameters of ``model`` without a number, and the poses and speeds that were not seen."""
    rows = run.tables["untold"].query("model == @model")
    text = "".join(
        f" No number for the {parameter} of {', '.join(own['joint'])} ({own['found'].iloc[0]})."
        for parameter, own in rows.groupby("parameter", sort=False)
    )
    fastest = fastest_speeds(run.tables["motion_ranges"])
    still = fastest.index[fastest < STILL * fastest.max()]
    text += f" These joints stood still: {', '.join(still)}." if len(still) else ""
    seen = ", ".join(f"{joint} {number(float(f'{speed:.3g}'))}" for joint, speed in fastest.items())
    text += f" Speeds above (rad/s): {seen}; poses outside the ranges below."
    return f"**What the recordings cannot tell:**{text}"


def held_out(run: Run) -> str:
    """Return log scores of every model on every held-out motion, the highest mean first; of a
    single motion the mean over its held-out takes alone.
    """
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
    """Return predicted and measured rms of a step in µrad by held-out motion and joint; of a single
    motion over all its held-out takes.
    """
    spread, place = run.tables["motion_spread"], ["motion", "joint"]
    if len(run.tables["motions"]) == 1:
        squares = spread.assign(motion=run.tables["motions"]["motion"].iloc[0])
        sizes = ["predicted_rad", "measured_rad"]
        squares[sizes] = squares[sizes] ** 2
        means = squares.groupby([*place, "model"], sort=False)[sizes].mean()
        spread = means.pow(0.5).reset_index()
    wide = spread.pivot(index=place, columns="model", values="predicted_rad")
    measured = spread.drop_duplicates(place).set_index(place)["measured_rad"]
    wide = wide.loc[measured.index, list(dict.fromkeys(spread["model"]))]
    wide.insert(0, "measured", measured)
    rows = ([*map(str, row[0]), *(f"{1e6 * v:.3g}" for v in row[1:])] for row in wide.itertuples())
    return f"Rms of a step in µrad.\n\n{table([*place, *map(plain_name, wide.columns)], rows)}"


def held_out_tails(run: Run) -> str:
    """Return kurtosis and coverage of the held-out noise by model and joint."""
    tails = run.tables["tails"]
    numbers = tails[["kurtosis", "one_sigma", "two_sigma", "three_sigma"]].map("{:.3g}".format)
    names = tails["model"].map(plain_name), tails["joint"]
    rows = zip(*names, *(numbers[column] for column in numbers), strict=True)
    return table(["model", "joint", "kurtosis", "1σ", "2σ", "3σ"], rows)
