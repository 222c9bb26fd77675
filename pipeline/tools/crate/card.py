"""Dataset card: answers to the questions of Gebru et al., Datasheets for Datasets, Comm. ACM 64
(2021).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from pipeline.verdicts.wording import number, table

QUALITY = ["instrument", "quantity", "unit", "total", "mean", "least", "greatest"]
SYNTHETIC = {
    "Motivation": "Nobody has published the paper's recordings. This dataset takes their place: it "
    "runs the analysis from instruments' files to figures, with a truth that is known.",
    "Collection process": "Simulated by `pipeline/laboratory` from the seed {seed}; every run "
    "writes the same bytes. Its options, in `pipeline/laboratory/options.py`, state unit and "
    "source of each value. The robot's physics is none of the models that are tested on it; "
    "instruments see it with noise, bias, delays and faults. The path and the sizes of sway and "
    "play were chosen for the published covariance, so a covariance near it is no evidence.",
    "Preprocessing": "Nothing is filtered, cut or repaired in the files. The true joint angles and "
    "clock offsets are in `data/raw/{name}/truth`, which the stage `score` alone opens.",
    "Uses": "For methods: whether an estimator returns what it should, and whether a bound follows "
    "an error whose truth is known. Not for what the paper's robot and sensors did, and not as "
    "recordings of the instruments whose formats it has.",
    "Distribution": "Licence: {licence}. The recordings are not distributed: `dvc repro` writes "
    "them; their hashes are in `data/raw/{name}/dvc.lock`.",
    "Maintenance": "The recordings change with the laboratory's code and options alone, and each "
    "change shows in the lock file. `make audit` runs all of it again and compares.",
}
RECORDED = {
    "Motivation": "Recorded elsewhere: {source}. The purpose is known to its recorders alone.",
    "Collection process": "Described by its source; what is known here is in "
    "`data/raw/{name}/dataset.yaml`.",
    "Preprocessing": "The files are read as they are and none is changed. What the analysis "
    "repairs or leaves out in its own tables, it counts (table above).",
    "Uses": "For whether the paper's claims hold for this robot, as far as its instruments tell. "
    "Not for other robots.",
    "Distribution": "Licence: {licence}. The source says who may have the recordings.",
    "Maintenance": "By its source. A change of a file reruns what depends on it.",
}


@dataclass(frozen=True)
class CardFacts:
    """Facts of a dataset.

    ``about`` is the datasheet's section, ``stored`` number of files and bytes by path, ``takes``
    and ``quality`` are tables of the reports, ``rate`` (1/s) and ``steps`` belong to the motion.
    """

    name: str
    synthetic: bool
    seed: int
    about: Mapping[str, str]
    stored: Mapping[str, tuple[int, int]]
    takes: pd.DataFrame
    quality: pd.DataFrame
    rate: float
    steps: int


def card(facts: CardFacts) -> str:
    """Return the dataset card as Markdown."""
    values: dict[str, Any] = {"name": facts.name, "seed": facts.seed} | dict(facts.about)
    texts = SYNTHETIC if facts.synthetic else RECORDED
    answers = {heading: text.format(**values) for heading, text in texts.items()}
    parts = [f"# Dataset card: {facts.name}"]
    for heading, text in answers.items():
        parts += [f"## {heading}", text]
        if heading == "Motivation":
            parts += ["## Composition", *_composition(facts)]
    return "\n\n".join(parts) + "\n"


def _composition(facts: CardFacts) -> list[str]:
    left_out = facts.takes.loc[facts.takes["left_out"].astype(bool), "take"]
    takes = [[part, str(count)] for part, count in facts.takes["part"].value_counts().items()]
    quality = [
        [number(cell) if isinstance(cell, float) else str(cell) for cell in row]
        for row in facts.quality[QUALITY].to_numpy().tolist()
    ]
    files = [[f"`{path}`", str(n), number(size)] for path, (n, size) in facts.stored.items()]
    return [
        f"{facts.about['subject']}. A take is one motion of {facts.steps} steps at "
        f"{number(facts.rate)} per second.",
        table(["part", "takes"], takes),
        *([table(["folder or file", "files", "bytes"], files)] if files else []),
        "Missing, wrong or noisy, as counted over the takes or records of an instrument:",
        table(QUALITY, quality),
        "Takes beyond the dataset's limits, which the analysis leaves out: "
        f"{', '.join(left_out) or 'none'}. Each take: `reports/{facts.name}/tables/takes.csv`.",
    ]
