"""How every model predicts, held against the first: paired differences of log scores, for every dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.audit.results import number, table
from pipeline.audit.run import Run

SCORE = "log_score"
FILTERED = "posterior of the particle filter"
NOTHING = "No prediction was scored: the dataset has no test takes, or its motion never rests."


@dataclass(frozen=True)
class Comparison:
    """The log scores of a run: groups of steps, and of each group a text per model, the first model's own score before differences.

    ``better`` says of every text whether the whole interval is above zero (True), below (False), or neither (None).
    """

    dataset: str
    models: list[str]
    steps: list[str]
    texts: list[list[str]]
    better: list[list[bool | None]]


def compare_models(run: Run) -> Comparison:
    """The log scores of the one-step predictions and of the filters' posteriors; no steps where nothing was scored."""
    tables = []
    if "one_step_scores" in run.tables:
        tables.append(run.tables["one_step_scores"])
    if "filter_comparison" in run.tables:
        tables.append(run.tables["filter_comparison"].assign(steps=FILTERED))
    rows = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=["steps", "model", "score"])
    rows = rows[rows["score"] == SCORE]
    models, steps = list(dict.fromkeys(rows["model"])), list(dict.fromkeys(rows["steps"]))
    cells = {(row["steps"], row["model"]): row for _, row in rows.iterrows()}
    found = [[cells.get((of, model)) for model in models] for of in steps]
    texts = [[_text(cell) for cell in row] for row in found]
    return Comparison(run.dataset, models, steps, texts, [[_better(cell) for cell in row] for row in found])


def _text(cell: pd.Series | None) -> str:
    if cell is None or np.isnan(cell["mean"]):
        return "–"
    if np.isnan(cell["difference"]):
        return number(cell["mean"])
    interval = "" if np.isnan(cell["low"]) else f" [{cell['low']:+.3g}, {cell['high']:+.3g}]"
    return f"{cell['difference']:+.3g}{interval}"


def _better(cell: pd.Series | None) -> bool | None:
    if cell is None or not (cell["low"] > 0 or cell["high"] < 0):
        return None
    return bool(cell["low"] > 0)


def comparison_section(comparisons: Sequence[Comparison]) -> str:
    """A Markdown table per dataset."""
    sections = [
        "## Models against each other",
        "Mean log score of the first model in nats a step, and the paired difference of every other to it with its 95 % interval over the "
        "takes; a greater score is better. ‖J⁻¹‖ is great near singular poses.",
    ]
    for of in comparisons:
        sections.append(f"### {of.dataset}")
        rows = [[steps, *texts] for steps, texts in zip(of.steps, of.texts, strict=True)]
        sections.append(table(["steps", *of.models], rows) if rows else NOTHING)
    return "\n\n".join(sections)
