"""datasheet: what a user asks of the dataset before its use, answered from the configuration and from what the analysis counted."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pandas as pd

from pipeline import config
from pipeline.report.datasheet import Facts, write
from pipeline.report.laboratory import parts
from pipeline.typed_yaml import read_yaml

RECORDINGS, TABLES, OUT = Path("data/raw"), Path("reports/tables"), Path("reports/datasheet.md")
OPTIONS = Path("pipeline/twin/options.py")


def run() -> None:
    """Gather the facts and write the datasheet."""
    settings = config.sections("datasheet")
    dataset = settings.dataset
    lock = RECORDINGS / dataset.name / "dvc.lock"
    stored = [out for stage in read_yaml(lock)["stages"].values() for out in stage["outs"]] if lock.is_file() else []
    values = {name: asdict(options) for name, options in dataset.twin.items()} if dataset.twin else None
    facts = Facts(
        name=dataset.name,
        scale=settings.scale.name,
        seed=settings.seed,
        about=read_yaml(RECORDINGS / dataset.name / "dataset.yaml")["about"],
        stored={out["path"]: (out["size"], out.get("nfiles", 1)) for out in stored},
        takes=pd.read_csv(TABLES / "takes.csv"),
        quality=pd.read_csv(TABLES / "recording_quality.csv"),
        rate=dataset.motion.rate,
        steps=dataset.motion.steps,
        depth_rate=dataset.depth.rate if dataset.depth else None,
        configurations=list(dataset.force.configurations) if dataset.force else [],
        force_seconds=settings.scale.force_seconds,
        laboratory=parts(OPTIONS.read_text(encoding="utf-8"), config.TWIN, values) if values else None,
    )
    partial = OUT.with_name(f".{OUT.name}.partial")
    partial.write_text(write(facts), encoding="utf-8")
    partial.replace(OUT)
