"""Run a study: load the options, evaluate the study, write tables, figure and page.

A study is a folder of ``pipeline/studies``, which ``python -m pipeline NAME`` runs, with

- ``stage.py``: the question as docstring; ``evaluate`` of settings and options returns the tables,
  ``facts`` of tables and options the fields of the page beside the options, ``draw`` the figure of
  the tables that its parameters name;
- ``params.yaml``: the options of each scale, with equal names and kinds in all scales;
- ``dvc.yaml``: dependencies, and the sections of the configuration that the study reads;
- ``tables.yaml``: the columns of the tables, in the notation of pipeline/tables.yaml;
- ``page.md``: the page with the figure's caption, a Jinja template of the options and facts.

The study NAME writes the checked tables to ``data/studies/NAME``, figure and tables as CSV to
``reports/studies/NAME``, and the page ``reports/studies/NAME.md``: all outputs or none. A trial
(scale ``smoke``) leaves an earlier page as it is and writes its own to ``reports/trials/studies``.
"""

from collections.abc import Callable, Iterable
from functools import partial, reduce
from importlib import import_module
from inspect import signature
from operator import getitem
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import PipelineError
from pipeline.core.results import SMOKE, TRIALS
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import validated
from pipeline.figures.style import save
from pipeline.verdicts import wording
from pipeline.verdicts.wording import MISSING, filled_in, plain_page

DATA = Path("data/studies")
REPORTS = Path("reports/studies")
CSV_DIGITS = "%.6g"
ROUNDING = 1e-12
Tables = dict[str, pd.DataFrame]
number = partial(wording.number, digits=3)
concatenate = partial(pd.concat, ignore_index=True)


class NoAnswerError(PipelineError):
    """Raised if the dataset lacks recordings that a study needs; the page prints the message."""


def run(name: str) -> None:
    """Evaluate the study ``name`` and write its tables, figure and page."""
    study = import_module(f"pipeline.studies.{name}.stage")
    folder = Path(__file__).parent / name
    settings = config.sections(name, folder / "dvc.yaml")
    options = SimpleNamespace(**config.study_options(folder, dict))
    page = (folder / "page.md").read_text(encoding="utf-8")
    try:
        tables = study.evaluate(settings, options)
    except NoAnswerError as reason:
        print(f"{name}: {reason}")
        title = page.partition("\n")[0]
        tables = {}
        page = f"{title}\n\nNo answer for this dataset: {reason}.\n"
    pages = _pages_folder(name, settings.scale.name)
    with (
        contracts.replacing(DATA / name) as data,
        contracts.replacing(pages / name) as report,
    ):
        for table, rows in tables.items():
            contracts.write(rows, table, data, folder / "tables.yaml")
            csv = rows.to_csv(index=False, float_format=CSV_DIGITS)
            contracts.write_text(csv, report / f"{table}.csv")
        if tables:
            shown = {table: tables[table] for table in signature(study.draw).parameters}
            save(study.draw(**shown), report, name)
            page = filled_in(page, **vars(options) | study.facts(tables, options))
    contracts.write_text(plain_page(page), pages / f"{name}.md")


def _pages_folder(name: str, scale: str) -> Path:
    """Return the folder of the page of a study: a trial does not replace an earlier page."""
    if scale == SMOKE and (REPORTS / f"{name}.md").exists():
        print(f"{name}: a trial: its page is in {TRIALS / REPORTS.name}")
        return TRIALS / REPORTS.name
    return REPORTS


def dataset_option(kind: type, dataset: str, *keys: str) -> Any:
    """Return the section ``keys`` of the option file of a ``dataset``, validated as ``kind``."""
    file = config.CONF / f"dataset/{dataset}.yaml"
    return validated(kind, reduce(getitem, keys, read_yaml(file)), ".".join(keys), file)


def trials(
    settings: SimpleNamespace,
    label: str,
    function: Callable,
    cases: Iterable,
    /,
    **common: object,
) -> list:
    """Return ``function(case, **common)`` for each of the ``cases``, evaluated in parallel."""
    trial = partial(function, **common)
    return list(run_trials(trial, cases, compute=settings.compute, label=label))


def interval(middle: float, low: float, high: float) -> str:
    """Return a signed difference as text, with its interval in brackets unless ``low`` is NaN."""
    if pd.isna(middle):
        return MISSING
    # an exact zero with a rounding error is written without a sign
    numbers = [0.0 if abs(x) < ROUNDING else x for x in (middle, low, high)]
    middle, low, high = (f"{x:+.3g}" for x in numbers)
    if pd.isna(numbers[1]):
        return middle
    return f"{middle} [{low}, {high}]"
