"""Numbers, intervals, tables and cases of claims as text, and the prose of the pages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pipeline.core.typed_yaml import read_yaml

if TYPE_CHECKING:
    from pipeline.verdicts.decision import Case

MISSING = "–"
TEXTS = read_yaml(Path(__file__).with_name("texts.yaml"))


def plain_name(model: str) -> str:
    """Return the name of ``model`` for a reader."""
    return TEXTS["names"].get(model, model)


def number(value: float, digits: int = 4) -> str:
    """Return significant ``digits``; counts as they are; a dash for a missing value."""
    if pd.isna(value):
        return MISSING
    if np.isinf(value):
        return "∞" if value > 0 else "−∞"
    whole = float(value).is_integer() and abs(value) < 1e9
    return f"{value:,.0f}" if whole else f"{value:.{digits}g}"


def interval(low: float, high: float) -> str:
    """Return an interval in brackets."""
    return f"[{number(low)}, {number(high)}]"


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table; cells that are numbers are written by :func:`number`."""
    lines = [[str(cell) for cell in header], ["---"] * len(header)]
    for row in rows:
        real = [isinstance(cell, int | float | np.number) for cell in row]
        lines.append([number(c) if r else str(c) for c, r in zip(row, real, strict=True)])
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def listed(names: Sequence[str]) -> str:
    """Return names with commas and an "and" before the last."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def page(parts: Iterable[str], sections: dict[str, str] | None = None) -> str:
    """Return paragraphs and then sections, by heading, as Markdown; empty ones are left out."""
    headed = [f"## {heading}\n\n{text}" for heading, text in (sections or {}).items() if text]
    return "\n\n".join([*filter(None, parts), *headed]) + "\n"


def case_text(case: Case) -> str:
    """Return a case: name, value, interval, value or limit compared with, a sign if it fails."""
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
