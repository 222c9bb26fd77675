"""``python -m pipeline crate``: the dataset card, and an RO-Crate of how each file of the reports
was made.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.core import config, datasheet
from pipeline.core.contracts import write_text
from pipeline.core.typed_yaml import read_yaml
from pipeline.tools.crate.crate import describe
from pipeline.verdicts.wording import number, table

HERE, REPORTS = Path(__file__).parent, Path("reports")
CARD, CRATE = REPORTS / "dataset_card.md", REPORTS / "ro-crate-metadata.json"
QUALITY = ["instrument", "quantity", "unit", "total", "mean", "least", "greatest"]


def run(words: list[str]) -> None:
    """Write reports/dataset_card.md and reports/ro-crate-metadata.json from the lock files."""
    argparse.ArgumentParser(
        prog="python -m pipeline crate", description=__doc__.partition(": ")[2]
    ).parse_args(words)
    settings = config.sections("crate", HERE / "dvc.yaml")
    name = settings.dataset.name
    about = read_yaml(datasheet.path_of(name))["about"]
    stages = _locked(Path("data/raw") / name / "dvc.lock")
    stored = [out for stage in stages.values() for out in stage["outs"]]
    takes, quality = (
        pd.read_csv(REPORTS / f"tables/{table}.csv") for table in ("takes", "recording_quality")
    )
    write_text(card(settings, about, stored, takes, quality), CARD)
    for lock in (Path("dvc.lock"), *sorted(Path("pipeline/studies").glob("*/dvc.lock"))):
        stages |= _locked(lock)
    files = [file for file in REPORTS.rglob("*") if file.is_file() and file != CRATE]
    files = sorted(file.as_posix() for file in files if not file.name.startswith("."))
    recordings = {"path": f"data/raw/{name}"} | dict(about)
    crate = describe(read_yaml(Path("CITATION.cff")), recordings, stages, files)
    write_text(json.dumps(crate, indent=1, ensure_ascii=False, sort_keys=True) + "\n", CRATE)


def _locked(file: Path) -> dict[str, dict]:
    """The stages of a lock file whose outputs are all there, by name; none without the file.

    DVC keeps entries of stages and of models that are gone.
    """
    entries = read_yaml(file).get("stages", {}) if file.is_file() else {}
    return {
        name: entry
        for name, entry in entries.items()
        if all(Path(out["path"]).exists() for out in entry["outs"])
    }


def card(
    settings: Any,
    about: Mapping[str, str],
    stored: list[dict],
    takes: pd.DataFrame,
    quality: pd.DataFrame,
) -> str:
    """Return the dataset card as Markdown: answers of card.yaml, and the composition in numbers.

    ``settings`` holds seed and dataset, ``about`` is the datasheet's section, ``stored`` the locked
    outputs of the recording, ``takes`` and ``quality`` are tables of the reports.
    """
    dataset, motion = settings.dataset, settings.dataset.motion
    answers = read_yaml(HERE / "card.yaml")["synthetic" if dataset.laboratory else "recorded"]
    values = {"name": dataset.name, "seed": settings.seed} | dict(about)
    parts_of = takes["part"].value_counts()
    parts = [f"# Dataset card: {dataset.name}"]
    for heading, text in answers.items():
        parts += [f"## {heading}", text.format(**values)]
        if heading == "Motivation":
            parts += [
                "## Composition",
                f"{about['subject']}. A take is one motion of {motion.steps} steps at "
                f"{number(motion.rate)} per second.",
                table(["part", "takes"], [[part, str(count)] for part, count in parts_of.items()]),
            ]
            files = [[f"`{o['path']}`", str(o.get("nfiles", 1)), number(o["size"])] for o in stored]
            parts += [table(["folder or file", "files", "bytes"], files)] if files else []
            cells = [
                [number(cell) if isinstance(cell, float) else str(cell) for cell in row]
                for row in quality[QUALITY].to_numpy().tolist()
            ]
            left_out = takes.loc[takes["left_out"].astype(bool), "take"]
            parts += [
                "Missing, wrong or noisy, as counted over the takes or records of an instrument:",
                table(QUALITY, cells),
                "Takes beyond the dataset's limits, which the analysis leaves out: "
                f"{', '.join(left_out) or 'none'}. Each take: `reports/tables/takes.csv`.",
            ]
    return "\n\n".join(parts) + "\n"
