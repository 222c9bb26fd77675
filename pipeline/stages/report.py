"""report: the numbers of the run on one page, reports/results.md."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from pipeline import config
from pipeline.audit.results import results_page

REPORTS = Path("reports")


def run() -> None:
    """Read every metric and small table of the run and write the page."""
    settings = config.sections("report")
    models = list(settings.models)
    stems = [
        "motion",
        "filter",
        "recordings",
        "wrench",
        *(f"{stage}_{model}" for stage in ("fit", "simulate", "filter") for model in models),
    ]
    metrics = {stem: json.loads(file.read_text()) for stem in stems if (file := REPORTS / "metrics" / f"{stem}.json").exists()}
    tables = {file.stem: pd.read_csv(file) for file in sorted((REPORTS / "tables").glob("*.csv"))}
    page = results_page(settings.dataset.name, settings.scale.name, models, metrics, tables)
    partial = REPORTS / ".results.md.partial"
    partial.write_text(page)
    partial.replace(REPORTS / "results.md")
