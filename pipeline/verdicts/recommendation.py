"""The recommended model for another motion: rule, answer and the tables of held-out motions."""

from __future__ import annotations

import pandas as pd

from pipeline.core.filters import MEMORY, NONE
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import number, table

EACH = "each"  # the mean over all held-out motions
NAMES = {
    NONE: "training mean",
    MEMORY: "autoregressive baseline",
    "additive": "additive (this motion)",
    "scaled": "speed-scaled (this motion)",
    "scaled_full": "speed-scaled with covariances (this motion)",
    "additive_all": "additive",
    "scaled_all": "speed-scaled",
    "additive_t": "additive, Student's t",
    "scaled_t": "speed-scaled, Student's t",
    "wishart": "Wishart matrix model",
    "wishart_qr_transposed": "Wishart matrix model, QR of Jᵀ",
    "gaussian": "Gaussian matrix model",
}
SCALED, STUDENT = ("scaled_all", "scaled_t"), ("additive_t", "scaled_t")
MANY, OFF = 0.5, 4.0  # share of held-out spreads that may be off by more than this factor
MOVING = 0.1  # of a joint's greatest recorded spread, above which a held-out spread counts
STILL = 0.1  # of the greatest joint speed, below which a joint counts as standing still
RULE = (
    "The model for another motion is the one of highest mean log score over held-out motions: "
    "every model is fitted to all motions but one and scored on that one, each in turn. A model "
    "that predicts nothing on one of them (a singular pose, a joint that moved nowhere else) is "
    "not recommended. No model is recommended from a single motion, nor where more than half of "
    f"the predicted spreads are off by more than a factor of {OFF:g}."
)
NOT_HELD_OUT = (
    "**No model for another motion**: no motion was held out; run the stage `predict` with these "
    "recordings."
)


def plain_name(model: str) -> str:
    """Return the name of ``model`` for a reader."""
    return NAMES.get(model, model)


def recommended(
    scores: pd.DataFrame, spread: pd.DataFrame, motions: pd.DataFrame
) -> tuple[str | None, str]:
    """Return the name of the model for another motion by :data:`RULE`, or None, and the reason.

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
    most = own.groupby("joint")["measured_rad"].transform("max")
    own = own[own["measured_rad"] >= MOVING * most]
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
    t = run.tables
    if "other_motions" not in t:
        return NOT_HELD_OUT
    model, why = recommended(t["other_motions"], t["motion_spread"], t["motions"])
    counted = f"{t['motions']['takes'].sum()} takes of {len(t['motions'])} motion(s)"
    if model is None:
        return f"**No model for another motion**: {why}.\n\nRecorded: {counted}."
    known, tails = (t[name][t[name]["model"] == model] for name in ("plain_parameters", "tails"))
    parts = [f"**Model for another motion: {plain_name(model)}** (`{model}`): {why}."]
    parts += [_formula(model, known)] if len(known) else []
    parts.append(f"Fitted to {counted}. {_untold(run, model)}")
    if len(tails):
        low, high = (f"{tails['kurtosis'].agg(end):.3g}" for end in ("min", "max"))
        heavy = tails["kurtosis"].max() > 4
        parts.append(
            f"**Tails:** held-out noise has "
            f"{'heavier tails than' if heavy else 'tails like'} normal noise (kurtosis "
            f"{number(float(low))} to {number(float(high))}, normal 3); within three predicted "
            f"standard deviations lie at least {100 * tails['three_sigma'].min():.1f} % of the "
            "steps of every joint (normal 99.7 %)."
        )
    parts.append(f"To have it: `python -m pipeline export {model}`.")
    return "\n\n".join(parts)


def _formula(model: str, known: pd.DataFrame) -> str:
    scaled, student = model in SCALED, model in STUDENT
    std = "√(a_j² + b_j²·Δq_j²)" if scaled else "a_j"
    law = "normal with the joints' correlation"
    law = "Student's t with ν_j degrees of freedom" if student else law
    text = (
        f"Measured step of joint j = commanded step Δq_j + {std}·e_j, e_j {law}; angles in rad, "
        "steps of one period of the recordings."
    )
    cells = {"joint": known["joint"]}
    cells["a_j"] = [f"{1e6 * value:.3g} µrad" for value in known["at_rest_rad"]]
    if scaled:
        share = known["share_of_step"]
        cells["b_j"] = [f"{100 * b:.3g} %" if pd.notna(b) else "not known" for b in share]
    if student:
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
    scores = run.tables["other_motions"]
    motions = [name for name in dict.fromkeys(scores["motion"]) if name != EACH]
    if len(run.tables["motions"]) == 1:  # parts of one motion's takes are held out in turn
        motions = []
    wide = scores.pivot(index="model", columns="motion", values="score")
    wide = wide.reindex(columns=[EACH, *motions]) if EACH in wide else wide
    wide = wide.sort_values(wide.columns[0], ascending=False, na_position="last")
    header = ["log score (nats a step)", "mean", *(f"motion {name}" for name in motions)]
    text = table(header, [[plain_name(str(row[0])), *row[1:]] for row in wide.itertuples()])
    missing = scores[scores["reason"].notna() & scores["reason"].ne("")].drop_duplicates("model")
    reasons = "".join(
        f"\n- {plain_name(row.model)}: no score on motion {row.motion}: {row.reason}"
        for row in missing.itertuples()
    )
    moves = run.tables["motions"][["motion", "takes", "steps", "moving"]].astype(str)
    header = ["motion", "takes", "steps", "joints that move"]
    return f"{text}\n{reasons}\n\n{table(header, moves.to_numpy())}"


def held_out_spread(run: Run) -> str:
    """Return predicted and measured rms of a step in µrad by held-out motion and joint; of a single
    motion over all its held-out takes.
    """
    spread = run.tables["motion_spread"]
    if len(run.tables["motions"]) == 1:
        squares = spread.assign(motion=run.tables["motions"]["motion"].iloc[0])
        sizes = ["predicted_rad", "measured_rad"]
        squares[sizes] = squares[sizes] ** 2
        keys = ["motion", "joint", "model"]
        spread = squares.groupby(keys, sort=False)[sizes].mean().pow(0.5).reset_index()
    place = ["motion", "joint"]
    wide = spread.pivot(index=place, columns="model", values="predicted_rad")
    measured = spread.drop_duplicates(place).set_index(place)["measured_rad"]
    wide = wide.loc[measured.index, list(dict.fromkeys(spread["model"]))]
    wide.insert(0, "measured", measured)
    rows = ([*map(str, row[0]), *(f"{1e6 * v:.3g}" for v in row[1:])] for row in wide.itertuples())
    header = [*place, *map(plain_name, wide.columns)]
    return f"Rms of a step in µrad.\n\n{table(header, rows)}"


def held_out_tails(run: Run) -> str:
    """Return kurtosis and coverage of the held-out noise by model and joint."""
    tails = run.tables["tails"]
    numbers = tails[["kurtosis", "one_sigma", "two_sigma", "three_sigma"]].map("{:.3g}".format)
    names = tails["model"].map(plain_name), tails["joint"]
    rows = zip(*names, *(numbers[column] for column in numbers), strict=True)
    return table(["model", "joint", "kurtosis", "1σ", "2σ", "3σ"], rows)
