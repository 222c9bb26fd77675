"""``python -m pipeline crate``: the dataset card, and an RO-Crate of how each file of the reports
was made.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pandas as pd

from pipeline.core import config, datasheet
from pipeline.core.contracts import write_text
from pipeline.core.typed_yaml import read_yaml
from pipeline.tools.crate.card import CardFacts, card
from pipeline.tools.crate.crate import describe

HERE, REPORTS, RECORDINGS = Path(__file__).parent, Path("reports"), Path("data/raw")
CRATE = REPORTS / "ro-crate-metadata.json"


def run(words: list[str]) -> None:
    """Write reports/DATASET/dataset_card.md and reports/ro-crate-metadata.json from the lock files."""
    argparse.ArgumentParser(
        prog="python -m pipeline crate", description=__doc__.partition(": ")[2]
    ).parse_args(words)
    settings = config.sections("crate", HERE / "dvc.yaml")
    dataset = settings.dataset
    reports = REPORTS / dataset.name
    about = read_yaml(datasheet.path_of(dataset.name))["about"]
    recorded = _locked(RECORDINGS / dataset.name / "dvc.lock")
    stored = {
        out["path"]: (out.get("nfiles", 1), out["size"])
        for stage in recorded.values()
        for out in stage["outs"]
    }
    facts = CardFacts(
        name=dataset.name,
        synthetic=bool(dataset.laboratory),
        seed=settings.seed,
        about=about,
        stored=stored,
        takes=pd.read_csv(reports / "tables/takes.csv"),
        quality=pd.read_csv(reports / "tables/recording_quality.csv"),
        rate=dataset.motion.rate,
        steps=dataset.motion.steps,
    )
    write_text(card(facts), reports / "dataset_card.md")
    stages = recorded | _locked(Path("dvc.lock"))
    for lock in sorted(Path("pipeline/studies").glob("*/dvc.lock")):
        stages |= _locked(lock)
    files = sorted(
        file.as_posix()
        for file in REPORTS.rglob("*")
        if file.is_file() and file != CRATE and not file.name.startswith(".")
    )
    recordings = {"path": f"data/raw/{dataset.name}"} | dict(about)
    crate = describe(read_yaml(Path("CITATION.cff")), recordings, stages, files)
    text = json.dumps(crate, indent=1, ensure_ascii=False, sort_keys=True) + "\n"
    write_text(text, CRATE)


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
