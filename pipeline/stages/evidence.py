"""evidence: the numbers of the run in one committed file, so that runs with several datasets can be held side by side."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from pipeline import config
from pipeline.audit.run import Run

METRICS, TABLES, OUT = Path("reports/metrics"), Path("reports/tables"), Path("reports/datasets")
# long ones that no verdict and no comparison is read from
LEFT_OUT = ("deviation", "sensitivity")


def run() -> None:
    """Collect every metric and every short table of the run."""
    settings = config.sections("evidence")
    models = {name: options.kind for name, options in settings.models.items()}
    of_models = [f"{stage}_{model}" for stage in ("fit", "simulate", "filter") for model in models]
    files = {stem: METRICS / f"{stem}.json" for stem in ("motion", "filter", "recordings", "wrench", *of_models)}
    metrics = {stem: json.loads(file.read_text(encoding="utf-8")) for stem, file in files.items() if file.exists()}
    tables = {file.stem: pd.read_csv(file) for file in sorted(TABLES.glob("*.csv")) if file.stem not in LEFT_OUT}
    dataset = settings.dataset
    found = Run(dataset.name, settings.scale.name, dataset.twin is not None, models, metrics, tables)
    OUT.mkdir(parents=True, exist_ok=True)
    partial = OUT / f".{dataset.name}.json.partial"
    partial.write_text(found.to_json(), encoding="utf-8")
    partial.replace(OUT / f"{dataset.name}.json")
