"""Claims, verdicts and numbers in words and signs, for the report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.verdicts.claims import CONSTRUCTION, LEVEL, PROJECT, Claim
from pipeline.verdicts.decision import (
    FORCED,
    NO_EVIDENCE,
    NO_RECORDING,
    NOT_REPRODUCED,
    REPRODUCED,
    SYNTHETIC_CANNOT,
    Case,
    Verdict,
)

MARKS = {
    REPRODUCED: "✓",
    NOT_REPRODUCED: "✗",
    SYNTHETIC_CANNOT: "?",
    NO_EVIDENCE: "–",
    FORCED: "=",
    NO_RECORDING: "",
}
KEY = (
    "✓ holds, ✗ fails, ? synthetic recordings cannot decide it, – no evidence, = forced by the "
    "construction of the models (no verdict). After the sign: the value of a claim with one case, "
    "else the number of cases in which the test holds of those it decides."
)
NOTES = {CONSTRUCTION: "by construction", LEVEL: "decided by the level"}


def number(value: float) -> str:
    """Four significant digits; counts as they are; a dash for a missing value."""
    if np.isnan(value):
        return "–"
    return f"{value:,.0f}" if float(value).is_integer() and abs(value) < 1e9 else f"{value:.4g}"


def interval(low: float, high: float) -> str:
    """An interval in brackets."""
    return f"[{number(low)}, {number(high)}]"


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    return "\n".join(
        "| " + " | ".join(cells) + " |" for cells in [header, ["---"] * len(header), *rows]
    )


def statement(claim: Claim) -> str:
    """The statement of ``claim`` with notes: forced or decided by the level, of the project and not
    of the paper, about an arm like the paper's alone.
    """
    notes = [NOTES[claim.by]] if claim.by else []
    notes += ["the project's own claim"] if claim.source == PROJECT else []
    notes += ["the paper's own arm"] if claim.about == "specimen" else []
    return f"{claim.statement} *({'; '.join(notes)})*" if notes else claim.statement


def verdict_cell(verdict: Verdict) -> str:
    """The sign of a verdict and one number: the value of a claim with one case, else in how many of
    the decided cases the test holds.
    """
    sign = MARKS[verdict.verdict]
    decided = [case for case in verdict.cases if case.holds is not None]
    if verdict.verdict in (NO_RECORDING, FORCED, NO_EVIDENCE) or not decided:
        return sign
    if len(verdict.cases) == 1:
        return f"{sign} {number(decided[0].value)}"
    return f"{sign} {sum(case.holds for case in decided)}/{len(decided)}"


def case_text(case: Case) -> str:
    """One case of a claim: its name, value, interval, the value or limit it is compared with, and a
    sign where the test fails or does not decide.
    """
    if case.value is None:
        return f"{case.case} –".strip()
    text = f"{case.case}: {number(case.value)}" if case.case else number(case.value)
    if case.than is not None:
        text += f" against {number(case.than)}"
    if case.low is not None and case.high is not None:
        what = "difference " if case.than is not None else ""
        text += f" ({what}{interval(case.low, case.high)})"
    if case.threshold is not None:
        text += f" (limit {number(case.threshold)})"
    if case.power is not None and case.holds is None:
        return f"{text}, power {number(case.power)}"
    return f"{text} ✗" if case.holds is False else text
