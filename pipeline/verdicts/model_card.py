"""The model card: the motion model to use for an arm, its formula and numbers, what the recordings
cannot tell, and the evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.verdicts import recommendation as other
from pipeline.verdicts import scores
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import interval, number, table

FEW_TAKES = 10  # below it an interval from resampled takes is not printed
THIS_MOTION = (
    "For the analysed motion alone, a matrix model is recommended if the 95 % interval of its "
    "paired difference in log score (nats a step, held-out takes) is above zero against every "
    "baseline."
)
UNKNOWN = (
    "No prediction of the analysed motion was scored: the measurement noise is unknown, as the "
    "motion never rests. State `motion.pose_noise` in the dataset's option file."
)
NO_ROBOT = "**No model is recommended**: the dataset has no robot."
NOT_FOR = (
    "poses and speeds outside these ranges; an exported model warns of each by name",
    "singular poses, if the model needs the Jacobian",
    "another period than the recordings': noise of a step is not noise of two half steps",
    "another arm, controller or payload than the recordings': "
    "`python -m pipeline assess FILE` compares a new take with these",
    "steps added up without a measurement between: only the autoregressive baseline has noise that "
    "lasts from step to step",
)
EXPORT = (
    "`python -m pipeline export MODEL` writes a model to one file and beside it "
    "`read_motion_model.py`, which reads it with NumPy alone: "
    "[methods and examples](../../pipeline/tools/export/README.md)."
)
TAILS = (
    "Held-out noise in predicted standard deviations: kurtosis (3 of normal noise) and the share "
    "within one, two and three (0.683, 0.954, 0.997 of normal noise)."
)
COVERAGE = (
    "Share of the steps within ±1σ of the prediction; 0.683 for a normal one. Speeds are ‖q̇‖."
)


def model_card(run: Run, others: Sequence[Run]) -> str:
    """Return the card of ``run``, with the recommended models for the arms of ``others``."""
    title = f"# Motion model for dataset {run.dataset}, scale {run.scale}"
    if not run.joints:
        return f"{title}\n\n{NO_ROBOT}\n"
    scored = "predictions" in run.tables
    text = f"**This motion.** {scores.choice(run) if scored else UNKNOWN}"
    parts: dict[str, str | None] = {}
    if "other_motions" in run.tables:
        parts["Why"] = f"{other.RULE}\n\n{other.held_out(run)}"
        parts["Predicted and measured spread on held-out motions"] = other.held_out_spread(run)
        parts["Tails and coverage"] = f"{TAILS}\n\n{other.held_out_tails(run)}"
    if scored:
        parts["Analysed motion"] = f"{THIS_MOTION}\n\n{scores.predictors(run)}"
        parts["Coverage by joint and speed"] = f"{COVERAGE}\n\n{scores.coverage(run)}"
    if filters := scores.filter_verdict(run):
        parts["In a filter"] = f"{filters} [Scores](report.md)."
    if any(f"fit_{model}" in run.metrics for model in run.models):
        how = "Standard errors by the bootstrap over takes."
        parts["Parameters of the run's models"] = f"{how}\n\n{_parameters(run)}"
    parts["Where it was fitted"] = _ranges(run)
    parts["Where it must not be used"] = "\n".join(f"- {what}" for what in NOT_FOR)
    if "takes" in run.tables:
        parts["Takes left out"] = _left_out(run)
    parts["Export"] = EXPORT
    parts["Other datasets"] = "\n".join(
        " ".join(
            [f"- {one.dataset}: {other.answer(one).splitlines()[0]}"]
            + ([scores.choice(one)] if "predictions" in one.tables else [])
        )
        for one in others
        if one.joints
    )
    sections = [f"## {heading}\n\n{part}" for heading, part in parts.items() if part]
    return "\n\n".join([title, other.answer(run), text, *sections]) + "\n"


def _parameters(run: Run) -> str:
    """A row for each estimate with a standard error that the recordings can tell; fewer than ten
    takes make no interval.
    """
    rows, notes = [], []
    few = run.metrics.get("motion", {}).get("recorded_takes", FEW_TAKES) < FEW_TAKES
    for model in run.models:
        fitted = run.metrics.get(f"fit_{model}", {})
        absent = _not_told(run, fitted)
        plain = other.plain_name(model)
        notes += [f"- {plain}: no number for {name}: {why}" for name, why in absent.items()]
        for name in fitted:
            if name in absent or f"{name}_standard_error" not in fitted:
                continue
            ends = [fitted.get(f"{name}_interval_{end}", float("nan")) for end in ("low", "high")]
            error, within = fitted[f"{name}_standard_error"], "–" if few else interval(*ends)
            rows.append([model, name, fitted[name], error, within])
    text = table(["model", "parameter", "value", "standard error", "95 % interval"], rows)
    return "\n\n".join(filter(None, [text, "\n".join(notes)]))


def _not_told(run: Run, fitted: Mapping[str, float]) -> dict[str, str]:
    """The estimates among ``fitted`` without a number, and why."""
    absent = {}
    for name in fitted:
        if fitted.get(f"{name}_unbounded"):
            absent |= {name: "its search ended at a bound; the level α·u alone is known"}
            absent |= {"alpha": "known with u alone"} if "alpha" in fitted else {}
    m = len(run.task)
    if m and fitted.get("sigma_b", 0.0) >= ((m + 1) / (m + 3)) ** 0.5:
        absent["sigma_b"] = "a step has no covariance at the estimate"
    if "ranges" in run.tables:
        fastest = other.fastest_speeds(run.tables["ranges"])
        for joint, speed in fastest[fastest < other.STILL * fastest.max()].items():
            if (name := f"std_share_of_the_step_{joint}") in fitted:
                absent[name] = f"{joint} hardly moved (at most {number(speed)} rad/s)"
    return absent


def _ranges(run: Run) -> str:
    """The ranges of all motions, and those of the analysed one."""
    tables = [run.tables[name] for name in ("motion_ranges", "ranges") if name in run.tables]
    seen = pd.concat(tables).drop_duplicates(["quantity", "name"])
    rows = seen[["quantity", "name", "unit", "least", "greatest"]].itertuples(index=False)
    return table(["", "of", "unit", "least", "greatest"], rows)


def _left_out(run: Run) -> str:
    """Number of takes, and those left out with their reasons."""
    takes = run.tables["takes"].drop_duplicates("take")
    gone, kept = takes[takes["left_out"]], takes[~takes["left_out"]]
    counted = ", ".join(f"{count} {part}" for part, count in kept.groupby("part").size().items())
    text = f"Takes kept: {counted}; left out: {len(gone)}."
    if gone.empty:
        return text
    return f"{text}\n\n{table(['take', 'reason'], gone[['take', 'reason']].to_numpy())}"
