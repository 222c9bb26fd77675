"""The model card: the motion model to use for an arm, its formula and numbers, what the recordings
cannot tell, and the evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.verdicts import recommendation as other
from pipeline.verdicts import scores
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import TEXTS, interval, number, page, plain_name, table

FEW_TAKES = 10  # below it an interval from resampled takes is not printed


def few_takes(run: Run) -> bool:
    """Return True if the takes of ``run`` are too few for an interval from resampled takes."""
    return run.metrics.get("motion", {}).get("recorded_takes", FEW_TAKES) < FEW_TAKES


def model_card(run: Run, others: Sequence[Run]) -> str:
    """Return the card of ``run``, with the recommended models for the arms of ``others``."""
    card, scored = TEXTS["card"], "predictions" in run.tables
    title = f"# Motion model for dataset {run.dataset}, scale {run.scale}"
    if not run.joints:
        return page([title, card["no_robot"]])
    parts: dict[str, str] = {}
    if "other_motions" in run.tables:
        parts["Why"] = f"{card['rule']}\n\n{other.held_out(run)}"
        parts["Predicted and measured spread on held-out motions"] = other.held_out_spread(run)
        parts["Tails and coverage"] = f"{card['tails']}\n\n{other.held_out_tails(run)}"
    if scored:
        parts["Analysed motion"] = f"{card['this_motion']}\n\n{scores.predictors(run)}"
        parts["Coverage by joint and speed"] = f"{card['coverage']}\n\n{scores.coverage(run)}"
    if filters := scores.filter_verdict(run):
        parts["In a filter"] = f"{filters} [Scores](report.md)."
    if any(f"fit_{model}" in run.metrics for model in run.models):
        how = "Standard errors by the bootstrap over takes."
        parts["Parameters of the run's models"] = f"{how}\n\n{_parameters(run)}"
    parts["Where it was fitted"] = _ranges(run)
    parts["Where it must not be used"] = card["not_for"]
    if "takes" in run.tables:
        parts["Takes left out"] = _left_out(run)
    parts["Export"] = card["export"]
    parts["Other datasets"] = "\n".join(
        f"- {one.dataset}: {other.answer(one).splitlines()[0]}"
        + (f" {scores.choice(one)}" if "predictions" in one.tables else "")
        for one in others
        if one.joints
    )
    text = f"**This motion.** {scores.choice(run) if scored else card['unknown']}"
    return page([title, other.answer(run), text], parts)


def _parameters(run: Run) -> str:
    """A row for each estimate with a standard error that the recordings can tell."""
    rows, notes, few = [], [], few_takes(run)
    for model in run.models:
        fitted = run.metrics.get(f"fit_{model}", {})
        absent = _not_told(run, fitted)
        plain = plain_name(model)
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
    if fitted.get("sigma_b", 0.0) >= fitted.get("sigma_b_limit_of_the_covariance", float("inf")):
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
    rows = gone[["take", "reason"]].to_numpy()
    return f"{text}\n\n{table(['take', 'reason'], rows)}" if len(gone) else text
