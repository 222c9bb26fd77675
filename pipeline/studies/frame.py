"""The frame that runs a study: load its options, evaluate it, write tables, figures and page.

A study is a folder of ``pipeline/studies`` with

- ``stage.py``: the question as docstring, ``Options`` (pipeline/core/validation.py), ``evaluate``
  and ``page``, and ``run = Study(…).run``, which ``python -m pipeline NAME`` calls;
- ``params.yaml``: the options of each scale;
- ``dvc.yaml``: dependencies, and the sections of the configuration that the study reads;
- ``tables.yaml``: the columns of its tables, in the notation of pipeline/core/tables.yaml;
- ``figures``: a module a figure. Its docstring is title and caption; its function ``draw`` has
  tables as arguments, by their names, and returns a matplotlib figure.

The study NAME writes ``data/studies/NAME`` (its tables, checked), ``reports/studies/NAME`` (the
figures, and each table as CSV) and the page ``reports/studies/NAME.md``: all of them or none.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.core import config, contracts
from pipeline.core.errors import PipelineError
from pipeline.figures.style import save

DATA, REPORTS = Path("data/studies"), Path("reports/studies")
CSV_DIGITS = "%.6g"
ROUNDING = 1e-12


class NoAnswerError(PipelineError):
    """The dataset lacks the recordings that a study evaluates; its page states the message."""


@dataclass(frozen=True)
class Results:
    """Everything that a page can state."""

    settings: SimpleNamespace  # sections of the configuration that the study's dvc.yaml declares
    options: Any  # of the scale
    tables: dict[str, pd.DataFrame]
    figures: dict[str, str]  # Markdown of picture and caption, by module


@dataclass(frozen=True)
class Study:
    """A study, in the folder of the module that defines its options."""

    title: str  # of its page
    options: type  # of a scale's section of params.yaml
    evaluate: Callable[[SimpleNamespace, Any], dict[str, pd.DataFrame]]  # settings, options
    page: Callable[[Results], Sequence[str]]  # paragraphs, tables and figures of Markdown

    def run(self) -> None:
        """Evaluate the study and write its tables, figures and page."""
        stage = sys.modules[self.options.__module__]
        folder, package = Path(stage.__file__).parent, stage.__package__
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
                figures = draw_figures(package, tables, report, name)
                parts = self.page(Results(settings, options, tables, figures))
            text = "\n\n".join([f"# {self.title}", *parts]) + "\n"
        contracts.write_text(text, REPORTS / f"{name}.md")


def draw_figures(
    package: str, tables: dict[str, pd.DataFrame], folder: Path, link: str
) -> dict[str, str]:
    """Draw every figure of ``package`` whose tables exist into ``folder``, as PNG and SVG; return
    the Markdown of each by its name, with addresses that begin with ``link``.
    """
    shown = {}
    places = sorted(Path(import_module(package).__path__[0]).glob("figures/[a-z]*.py"))
    for name in (file.stem for file in places):
        module = import_module(f"{package}.figures.{name}")
        arguments = signature(module.draw).parameters
        if set(arguments) <= set(tables):
            save(module.draw(**{table: tables[table] for table in arguments}), folder, name)
            title, _, caption = " ".join(module.__doc__.split()).partition(". ")
            shown[name] = f"![{title}]({link}/{name}.png)\n\n**{title}.** {caption}"
    return shown


def number(value: float) -> str:
    """``value`` with three significant digits; counts as they are; a dash if it is missing."""
    if pd.isna(value):
        return "–"
    if np.isinf(value):
        return "∞" if value > 0 else "−∞"
    whole = float(value).is_integer() and abs(value) < 1e9
    return f"{value:,.0f}" if whole else f"{value:.3g}"


def interval(middle: float, low: float, high: float) -> str:
    """A signed difference with the ends of its interval in brackets, if it has one."""
    if pd.isna(middle):
        return "–"
    # the rounding error of an exact zero has no sign
    middle, low, high = (0.0 if abs(x) < ROUNDING else x for x in (middle, low, high))
    return f"{middle:+.3g}" + ("" if pd.isna(low) else f" [{low:+.3g}, {high:+.3g}]")


def listed(names: Sequence[str]) -> str:
    """``names`` as a phrase: a, b and c."""
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)
