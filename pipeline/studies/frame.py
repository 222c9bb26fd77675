"""The frame that runs a study: load its options, evaluate it, write tables, figure and page.

A study is a folder of ``pipeline/studies`` with

- ``stage.py``: the question as docstring, ``Options`` (pipeline/core/validation.py), ``evaluate``,
  ``page`` and ``draw`` (or imports of them), and ``run = Study(…).run``, which
  ``python -m pipeline NAME`` calls;
- ``params.yaml``: the options of each scale;
- ``dvc.yaml``: dependencies, and the sections of the configuration that the study reads;
- ``tables.yaml``: the columns of its tables, in the notation of pipeline/core/tables.yaml.

The docstring of ``draw`` is title and caption of the figure; its arguments are tables, by their
names. The study NAME writes ``data/studies/NAME`` (its tables, checked), ``reports/studies/NAME``
(the figure, and each table as CSV) and the page ``reports/studies/NAME.md``: all of them or none.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.core import config, contracts
from pipeline.core.errors import PipelineError
from pipeline.figures.style import save

DATA, REPORTS = Path("data/studies"), Path("reports/studies")
CSV_DIGITS = "%.6g"
ROUNDING = 1e-12
MISSING = "–"


class NoAnswerError(PipelineError):
    """The dataset lacks the recordings that a study evaluates; its page states the message."""


@dataclass(frozen=True)
class Results:
    """Options, tables and the Markdown of picture and caption: everything that a page states."""

    options: Any  # of the scale
    tables: dict[str, pd.DataFrame]
    figure: str


@dataclass(frozen=True)
class Study:
    """A study, in the folder of the module that defines its options."""

    title: str  # of its page
    options: type  # of a scale's section of params.yaml
    evaluate: Callable[[SimpleNamespace, Any], dict[str, pd.DataFrame]]  # settings, options
    page: Callable[[Results], Sequence[str]]  # paragraphs, tables and figure of Markdown
    draw: Callable[..., Figure]

    def run(self) -> None:
        """Evaluate the study and write its tables, figure and page."""
        folder = Path(sys.modules[self.options.__module__].__file__).parent
        name = folder.name
        settings = config.sections(name, folder / "dvc.yaml")
        options = config.study_options(folder, self.options)
        try:
            tables = self.evaluate(settings, options)
        except NoAnswerError as reason:
            print(f"{name}: {reason}")
            tables, parts = {}, [f"No answer for this dataset: {reason}."]
        with (
            contracts.replacing(DATA / name) as data,
            contracts.replacing(REPORTS / name) as report,
        ):
            for table, rows in tables.items():
                contracts.write(rows, table, data, folder / "tables.yaml")
                text = rows.to_csv(index=False, float_format=CSV_DIGITS)
                contracts.write_text(text, report / f"{table}.csv")
            if tables:
                parts = self.page(Results(options, tables, self.figure(tables, report, name)))
            text = "\n\n".join([f"# {self.title}", *parts]) + "\n"
        contracts.write_text(text, REPORTS / f"{name}.md")

    def figure(self, tables: dict[str, pd.DataFrame], folder: Path, name: str) -> str:
        """Draw the figure ``name`` into ``folder``, as PNG and SVG; return its Markdown."""
        save(
            self.draw(**{one: tables[one] for one in signature(self.draw).parameters}), folder, name
        )
        title, _, caption = " ".join(self.draw.__doc__.split()).partition(". ")
        return f"![{title}]({name}/{name}.png)\n\n**{title}.** {caption}"


def number(value: float) -> str:
    """``value`` with three significant digits; counts as they are; a dash if it is missing."""
    if pd.isna(value):
        return MISSING
    if np.isinf(value):
        return "∞" if value > 0 else "−∞"
    whole = float(value).is_integer() and abs(value) < 1e9
    return f"{value:,.0f}" if whole else f"{value:.3g}"


def interval(middle: float, low: float, high: float) -> str:
    """A signed difference with the ends of its interval in brackets, if it has one."""
    if pd.isna(middle):
        return MISSING
    # the rounding error of an exact zero has no sign
    middle, low, high = (0.0 if abs(x) < ROUNDING else x for x in (middle, low, high))
    return f"{middle:+.3g}" + ("" if pd.isna(low) else f" [{low:+.3g}, {high:+.3g}]")


def listed(names: Sequence[str]) -> str:
    """``names`` as a phrase: a, b and c."""
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)
