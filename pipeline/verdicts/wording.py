"""Claims, verdicts and numbers in words, for the report and for the page of results."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.verdicts.claims import Claim
from pipeline.verdicts.decision import Case, Decided, Verdict

# what a claim is about → which recordings can decide it, and why others cannot
GROUPS = {
    "method": (
        "What any recordings can decide, synthetic ones too",
        "Claims about the method: that an estimator, a model or a bound does what is said of it. "
        "The synthetic laboratory knows the truth, "
        "and its physics is none of the models.",
    ),
    "robots": (
        "What only a real robot's recordings can decide",
        "Claims about what real robots and sensors do. Synthetic recordings do what their "
        "laboratory was told to: their numbers are shown, "
        "and no verdict is given.",
    ),
    "specimen": (
        "What only the paper's own recordings could decide",
        "Claims about the very robot of the paper. Nobody has published its recordings; the "
        "synthetic laboratory was tuned towards these "
        "numbers, so that nearness is no evidence.",
    ),
}
ARM_OF_THE_PAPER = "Only a planar chain of three joints is evidence."
WHOSE = {
    "synthetic": "synthetic recordings",
    "real": "recordings of a real robot, not the paper's",
    "paper": "the paper's own recordings",
}


def number(value: float) -> str:
    """Four significant digits; counts as they are; a dash for what does not exist."""
    if np.isnan(value):
        return "–"
    return f"{value:,.0f}" if float(value).is_integer() and abs(value) < 1e9 else f"{value:.4g}"


def table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    return "\n".join(
        "| " + " | ".join(cells) + " |" for cells in [header, ["---"] * len(header), *rows]
    )


def side_by_side(decided: Sequence[Decided], about: str) -> list[tuple[Claim, list[Verdict]]]:
    """Each claim about ``about`` with its verdicts in the order of the datasets."""
    rows = zip(*(whose.verdicts for whose in decided), strict=True)
    return [(row[0].claim, list(row)) for row in rows if row[0].claim.about == about]


def case_text(case: Case) -> str:
    """One case of a claim: its name, value, interval, what it is compared with, and whether the
    test fails.
    """
    if case.value is None:
        return f"{case.case} –".strip()
    text = f"{case.case}: {number(case.value)}" if case.case else number(case.value)
    if case.low is not None and case.high is not None:
        text += f" [{number(case.low)}, {number(case.high)}]"
    if case.than is not None:
        text += f" against {number(case.than)}"
    return f"{text} ✗" if case.holds is False else text
