"""The model card: the motion model to use for an arm, its formula and numbers, what the recordings
cannot tell, and the evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.core.filters import MEMORY, NONE
from pipeline.verdicts.filters import verdict
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import interval, number, table

ALL = "all"  # the group of all steps
EACH = "each"  # the mean over all held-out motions
FEW_TAKES = 10  # below it an interval from resampled takes is not printed
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
    "every model is fitted to all motions but one and scored on that one, each in turn. A model that "
    "predicts nothing on one of them (a singular pose, a joint that moved nowhere else) is not "
    "recommended. No model is recommended from a single motion, nor where more than half of the "
    f"predicted spreads are off by more than a factor of {OFF:g}."
)
THIS_MOTION = (
    "For the analysed motion alone, a matrix model is recommended if the 95 % interval of its "
    "paired difference in log score (nats a step, held-out takes) is above zero against every baseline."
)
UNKNOWN = (
    "No prediction of the analysed motion was scored: the measurement noise is unknown, as the "
    "motion never rests. State `motion.pose_noise` in the dataset's option file."
)
NO_ROBOT = "**No model is recommended**: the dataset has no robot."
NO_SPREAD = (
    "**Its recordings give no evidence on the standard deviation of the noise**: most of the "
    "variance lies between recordings, not between repetitions. "
)
BETWEEN, LIMIT = "recorded_share_of_variance_between_recordings", 0.5  # as in claims.yaml
NOT_FOR = (
    "poses and speeds outside these ranges; an exported model warns of each by name",
    "singular poses, if the model needs the Jacobian",
    "another period than the recordings': noise of a step is not noise of two half steps",
    "another arm, controller or payload than the recordings': "
    "`python -m pipeline assess FILE` compares a new take with these",
    "steps added up without a measurement between: only the autoregressive baseline has noise that "
    "lasts from step to step",
)


def model_card(run: Run, others: Sequence[Run]) -> str:
    """Return the card of ``run``, with the recommended models for the arms of ``others``."""
    title = f"# Motion model for dataset {run.dataset}, scale {run.scale}"
    if not run.joints:
        return f"{title}\n\n{NO_ROBOT}\n"
    moved, scored = "other_motions" in run.tables, "predictions" in run.tables
    sections = [title, answer(run)]
    sections.append(f"**This motion.** {choice(run) if scored else UNKNOWN}")
    if moved:
        sections += [
            f"## Why\n\n{RULE}\n\n{held_out(run)}",
            f"## Predicted and measured spread on held-out motions\n\n{_spread(run)}",
            "## Tails and coverage\n\nHeld-out noise in predicted standard deviations: kurtosis (3 "
            "of normal noise) and the share within one, two and three (0.683, 0.954, 0.997 of "
            f"normal noise).\n\n{_tails(run)}",
        ]
    if scored:
        sections += [
            f"## Analysed motion\n\n{THIS_MOTION}\n\n{predictors(run)}",
            "## Coverage by joint and speed\n\nShare of the steps within ±1σ of the prediction; "
            f"0.683 for a normal one. Speeds are ‖q̇‖.\n\n{_coverage(run)}",
        ]
    if filters := verdict(run):
        sections.append(f"## In a filter\n\n{filters} [Scores](report.md).")
    if any(f"fit_{model}" in run.metrics for model in run.models):
        sections.append(
            "## Parameters of the run's models\n\nStandard errors by the bootstrap over takes.\n\n"
            f"{_parameters(run)}"
        )
    sections += [
        f"## Where it was fitted\n\n{_ranges(run)}",
        "## Where it must not be used\n\n" + "\n".join(f"- {what}" for what in NOT_FOR),
    ]
    if "takes" in run.tables:
        sections.append(f"## Takes left out\n\n{_left_out(run)}")
    sections.append(
        "## Export\n\n`python -m pipeline export MODEL` writes a model to one file and beside it "
        "`read_motion_model.py`, which reads it with NumPy alone: "
        "[methods and examples](../pipeline/tools/export/README.md)."
    )
    if chosen := [f"- {each.dataset}: {_one_line(each)}" for each in others if each.joints]:
        sections.append("## Other datasets\n\n" + "\n".join(chosen))
    return "\n\n".join(sections) + "\n"


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
        f"{number(float(f'{high:.3g}'))}, normal 3); within three predicted standard deviations lie "
        f"at least {100 * within:.1f} % of the steps of every joint (normal 99.7 %)."
    )


def _one_line(run: Run) -> str:
    text = answer(run).splitlines()[0]
    return f"{text} {choice(run)}" if "predictions" in run.tables else text


def held_out(run: Run) -> str:
    """Log scores of every model on every held-out motion, the highest mean first."""
    scores = run.tables["other_motions"]
    wide = scores.pivot(index="model", columns="motion", values="score")
    means = wide[EACH] if EACH in wide else wide.iloc[:, 0]
    motions = [name for name in dict.fromkeys(scores["motion"]) if name != EACH]
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
    missing = scores[scores["reason"].fillna("") != ""].drop_duplicates("model")
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


def _spread(run: Run) -> str:
    """Predicted and measured rms of a step in µrad by held-out motion and joint."""
    spread = run.tables["motion_spread"]
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


def _tails(run: Run) -> str:
    rows = [
        [plain_name(row.model), row.joint]
        + [
            f"{value:.3g}"
            for value in (row.kurtosis, row.one_sigma, row.two_sigma, row.three_sigma)
        ]
        for row in run.tables["tails"].itertuples()
    ]
    return table(["model", "joint", "kurtosis", "1σ", "2σ", "3σ"], rows)


def choice(run: Run) -> str:
    """The model of highest log score for the analysed motion, by :data:`THIS_MOTION`."""
    means = _log_scores(run)["mean"]
    matrix = [name for name in run.matrix_models if name in means]
    plain = [name for name in means.index if name not in matrix]
    passing = [name for name in matrix if not _not_below(run, name, plain)]
    text = NO_SPREAD if run.metrics.get("motion", {}).get(BETWEEN, 0) > LIMIT else ""
    if passing:
        name = plain_name(means[passing].idxmax())
        text += f"**{name}**: its log score is above that of every baseline."
    else:
        text += f"On {run.dataset} **no matrix model** has a log score above every baseline:"
        reasons = [
            f" {plain_name(name)} not above {_listed(_not_below(run, name, plain))}"
            for name in matrix
        ]
        text += ";".join(reasons) + "."
    text += "".join(
        f" {plain_name(name)} has no score." for name in _models(run) if name not in means
    )
    best = means.idxmax()
    text += f" The highest log score for this motion has {_listed([best])}"
    text += _apart(run, best, [*means.index]) + "."
    return text


def predictors(run: Run) -> str:
    """A row for each model and baseline, the highest log score first."""
    log = _log_scores(run)
    means = run.tables["predictions"].set_index(["steps", "model", "score"])["mean"]
    rows = []
    groups = list(dict.fromkeys(means.index.get_level_values(0)))
    for name in sorted(_models(run), key=lambda each: -log["mean"].get(each, float("-inf"))):
        difference = "–"
        if name in log.index and name != NONE:
            row = log.loc[name]
            difference = f"{number(row['difference'])} {interval(row['low'], row['high'])}"
        values = [number(means.get((steps, name, "log_score"), float("nan"))) for steps in groups]
        rows.append([plain_name(name), difference, *values])
    header = ["log score (nats a step)", "difference to the training mean, all steps", *groups]
    return table(header, rows)


def _models(run: Run) -> list[str]:
    return list(dict.fromkeys(run.tables["predictions"]["model"]))


def _log_scores(run: Run) -> pd.DataFrame:
    """Log score over all steps by model, of those that have one."""
    rows = run.tables["predictions"]
    rows = rows[(rows["steps"] == ALL) & (rows["score"] == "log_score")].set_index("model")
    return rows[rows["mean"].notna()]


def _not_below(run: Run, model: str, rivals: Sequence[str]) -> list[str]:
    """Those of ``rivals`` whose score the interval of the difference does not put below
    ``model``.
    """
    pairs = run.tables["prediction_pairs"]
    own = pairs[(pairs["steps"] == ALL) & (pairs["model"] == model)].set_index("rival")["low"]
    return [name for name in rivals if name != model and not own[name] > 0]


def _apart(run: Run, model: str, others: Sequence[str]) -> str:
    equal = _not_below(run, model, others)
    return f" (the difference to {_listed(equal)} is not significant)" if equal else ""


def _listed(names: Sequence[str]) -> str:
    shown = [plain_name(name) for name in names]
    return " and ".join(filter(None, [", ".join(shown[:-1]), shown[-1]]))


def _coverage(run: Run) -> str:
    means = run.tables["predictions"].set_index(["steps", "model", "score"])["mean"]
    models = _models(run)
    rows = [
        [steps, joint]
        + [number(means[steps, name, f"coverage_of_one_sigma_{joint}"]) for name in models]
        for steps in dict.fromkeys(means.index.get_level_values(0))
        for joint in run.joints
    ]
    return table(["steps", "joint", *(plain_name(name) for name in models)], rows)


def _parameters(run: Run) -> str:
    """A row for each estimate with a standard error that the recordings can tell; fewer than ten
    takes make no interval.
    """
    rows, notes = [], []
    few = run.metrics.get("motion", {}).get("recorded_takes", FEW_TAKES) < FEW_TAKES
    for model in run.models:
        fitted = run.metrics.get(f"fit_{model}", {})
        absent = _not_told(run, fitted)
        notes += [
            f"- {plain_name(model)}: no number for {name}: {why}" for name, why in absent.items()
        ]
        for name, value in fitted.items():
            if name in absent:
                continue
            if f"{name}_standard_error" in fitted:
                ends = [
                    fitted.get(f"{name}_interval_{end}", float("nan")) for end in ("low", "high")
                ]
                error = number(fitted[f"{name}_standard_error"])
                rows.append([model, name, number(value), error, "–" if few else interval(*ends)])
    text = table(["model", "parameter", "value", "standard error", "95 % interval"], rows)
    return "\n\n".join([text, *(["\n".join(notes)] if notes else [])])


def _not_told(run: Run, fitted: Mapping[str, float]) -> dict[str, str]:
    """The estimates among ``fitted`` without a number, and why."""
    absent = {}
    for name in fitted:
        if fitted.get(f"{name}_unbounded"):
            absent |= {name: "its search ended at a bound; the level α·u alone is known"}
            absent |= {other: "known with u alone" for other in ("alpha",) if other in fitted}
    m = len(run.task)
    if m and fitted.get("sigma_b", 0.0) >= ((m + 1) / (m + 3)) ** 0.5:
        absent["sigma_b"] = "a step has no covariance at the estimate"
    if "ranges" in run.tables:
        ranges = run.tables["ranges"]
        speeds = ranges[ranges["quantity"] == "joint speed"].set_index("name")
        fastest = speeds[["least", "greatest"]].abs().max(axis=1)
        for joint, speed in fastest.items():
            name = f"std_share_of_the_step_{joint}"
            if name in fitted and speed < STILL * fastest.max():
                absent[name] = f"{joint} hardly moved (at most {number(speed)} rad/s)"
    return absent


def _ranges(run: Run) -> str:
    rows = [
        [row.quantity, row.name_, row.unit, number(row.least), number(row.greatest)]
        for row in _seen(run).rename(columns={"name": "name_"}).itertuples()
    ]
    return table(["", "of", "unit", "least", "greatest"], rows)


def _seen(run: Run) -> pd.DataFrame:
    """The ranges of all motions, and those of the analysed one."""
    tables = [run.tables[name] for name in ("motion_ranges", "ranges") if name in run.tables]
    return pd.concat(tables).drop_duplicates(["quantity", "name"])


def _left_out(run: Run) -> str:
    """Number of takes, and those left out with their reasons."""
    takes = run.tables["takes"].drop_duplicates("take")
    gone, kept = takes[takes["left_out"]], takes[~takes["left_out"]]
    counted = ", ".join(f"{count} {part}" for part, count in kept.groupby("part").size().items())
    text = f"Takes kept: {counted}; left out: {len(gone)}."
    if gone.empty:
        return text
    reasons = gone[["take", "reason"]].astype(str).to_numpy().tolist()
    return f"{text}\n\n{table(['take', 'reason'], reasons)}"
