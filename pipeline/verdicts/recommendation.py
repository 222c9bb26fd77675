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


def recommended(
    scores: pd.DataFrame, spread: pd.DataFrame, motions: pd.DataFrame
) -> tuple[str | None, str]:
    """Name of the model for another motion by :data:`RULE`, or None, and the reason.

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


def plain_name(model: str) -> str:
    """Name of ``model`` for a reader."""
    return NAMES.get(model, model)


def answer(run: Run) -> str:
    """The first paragraphs of the card: model, formula, takes and motions, unknowns and tails."""
    if "other_motions" not in run.tables:
        return (
            "**No model for another motion**: no motion was held out; run the stage `predict` with "
            "these recordings."
        )
    tables = run.tables
    model, why = recommended(tables["other_motions"], tables["motion_spread"], tables["motions"])
    motions = tables["motions"]
    counted = f"{motions['takes'].sum()} takes of {len(motions)} motion(s)"
    if model is None:
        return f"**No model for another motion**: {why}.\n\nRecorded: {counted}."
    parts = [f"**Model for another motion: {plain_name(model)}** (`{model}`): {why}."]
    known = tables["plain_parameters"]
    if model in set(known["model"]):
        parts.append(_formula(model, known[known["model"] == model]))
    parts.append(f"Fitted to {counted}. {_untold(run, model)}")
    if model in set(tables["tails"]["model"]):
        parts.append(_tail_sentence(tables["tails"], model))
    parts.append(f"To have it: `python -m pipeline export {model}`.")
    return "\n\n".join(parts)


def _formula(model: str, known: pd.DataFrame) -> str:
    scaled, student = model in SCALED, model in STUDENT
    std = "√(a_j² + b_j²·Δq_j²)" if scaled else "a_j"
    law = (
        "Student's t with ν_j degrees of freedom"
        if student
        else "normal with the joints' correlation"
    )
    text = (
        f"Measured step of joint j = commanded step Δq_j + {std}·e_j, e_j {law}; angles in rad, "
        "steps of one period of the recordings."
    )
    rows = []
    for row in known.itertuples():
        cells = [row.joint, f"{1e6 * row.at_rest_rad:.3g} µrad"]
        cells += [
            f"{100 * row.share_of_step:.3g} %" if pd.notna(row.share_of_step) else "not known"
        ] * scaled
        cells += [number(row.degrees) if pd.notna(row.degrees) else "–"] * student
        rows.append(cells)
    header = ["joint", "a_j", *["b_j"] * scaled, *["ν_j"] * student]
    return f"{text}\n\n{table(header, rows)}"


def _untold(run: Run, model: str) -> str:
    """The parameters of ``model`` without a number, and the poses and speeds that were not seen."""
    rows = run.tables["untold"]
    rows = rows[rows["model"] == model]
    text = "".join(
        f" No number for the {parameter} of {', '.join(own['joint'])} ({own['found'].iloc[0]})."
        for parameter, own in rows.groupby("parameter", sort=False)
    )
    ranges = run.tables["motion_ranges"]
    speeds = ranges[ranges["quantity"] == "joint speed"].set_index("name")
    fastest = speeds[["least", "greatest"]].abs().max(axis=1)
    still = [joint for joint, speed in fastest.items() if speed < STILL * fastest.max()]
    text += f" These joints stood still: {', '.join(still)}." if still else ""
    seen = ", ".join(f"{joint} {number(float(f'{speed:.3g}'))}" for joint, speed in fastest.items())
    text += f" Speeds above (rad/s): {seen}; poses outside the ranges below."
    return f"**What the recordings cannot tell:**{text}"


def _tail_sentence(tails: pd.DataFrame, model: str) -> str:
    own = tails[tails["model"] == model]
    low, high = own["kurtosis"].min(), own["kurtosis"].max()
    within = own["three_sigma"].min()
    kind = "heavier tails than normal noise" if high > 4 else "tails like normal noise"
    return (
        f"**Tails:** held-out noise has {kind} (kurtosis {number(float(f'{low:.3g}'))} to "
        f"{number(float(f'{high:.3g}'))}, normal 3); within three predicted standard deviations "
        f"lie at least {100 * within:.1f} % of the steps of every joint (normal 99.7 %)."
    )


def held_out(run: Run) -> str:
    """Log scores of every model on every held-out motion, the highest mean first; of a single
    motion the mean over its held-out takes alone.
    """
    scores = run.tables["other_motions"]
    wide = scores.pivot(index="model", columns="motion", values="score")
    means = wide[EACH] if EACH in wide else wide.iloc[:, 0]
    motions = [name for name in dict.fromkeys(scores["motion"]) if name != EACH]
    if len(run.tables["motions"]) == 1:  # parts of one motion's takes are held out in turn
        motions = []
    order = means.sort_values(ascending=False, na_position="last").index
    rows = [
        [
            plain_name(str(name)),
            number(means[name]),
            *(number(wide.loc[name].get(m)) for m in motions),
        ]
        for name in order
    ]
    text = table(["log score (nats a step)", "mean", *(f"motion {name}" for name in motions)], rows)
    missing = scores[scores["reason"].notna() & scores["reason"].ne("")].drop_duplicates("model")
    reasons = "".join(
        f"\n- {plain_name(row.model)}: no score on motion {row.motion}: {row.reason}"
        for row in missing.itertuples()
    )
    moves = table(
        ["motion", "takes", "steps", "joints that move"],
        [
            [str(r.motion), str(r.takes), str(r.steps), r.moving]
            for r in run.tables["motions"].itertuples()
        ],
    )
    return f"{text}\n{reasons}\n\n{moves}"


def held_out_spread(run: Run) -> str:
    """Predicted and measured rms of a step in µrad by held-out motion and joint; of a single motion
    over all its held-out takes.
    """
    spread = run.tables["motion_spread"]
    if len(run.tables["motions"]) == 1:
        squares = spread.assign(motion=run.tables["motions"]["motion"].iloc[0])
        sizes = ["predicted_rad", "measured_rad"]
        squares[sizes] = squares[sizes] ** 2
        keys = ["motion", "joint", "model"]
        spread = squares.groupby(keys, sort=False)[sizes].mean().pow(0.5).reset_index()
    models = list(dict.fromkeys(spread["model"]))
    wide = spread.pivot(index=["motion", "joint"], columns="model", values="predicted_rad")
    measured = spread.drop_duplicates(["motion", "joint"]).set_index(["motion", "joint"])
    rows = [
        [str(motion), joint, f"{1e6 * measured.loc[(motion, joint), 'measured_rad']:.3g}"]
        + [f"{1e6 * wide.loc[(motion, joint), name]:.3g}" for name in models]
        for motion, joint in measured.index
    ]
    return "Rms of a step in µrad.\n\n" + table(
        ["motion", "joint", "measured", *map(plain_name, models)], rows
    )


def held_out_tails(run: Run) -> str:
    """Kurtosis and coverage of the held-out noise by model and joint."""
    rows = [
        [plain_name(row.model), row.joint]
        + [
            f"{value:.3g}"
            for value in (row.kurtosis, row.one_sigma, row.two_sigma, row.three_sigma)
        ]
        for row in run.tables["tails"].itertuples()
    ]
    return table(["model", "joint", "kurtosis", "1σ", "2σ", "3σ"], rows)
