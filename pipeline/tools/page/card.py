"""The dataset card: what a user asks before the use of a dataset, in the form of Gebru et al.,
Datasheets for Datasets, Comm. ACM 64 (2021).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from pipeline.core import config
from pipeline.core.typed_yaml import read_yaml
from pipeline.tools.page.option_comments import Part, parts
from pipeline.verdicts.wording import number

TEMPLATES = Path(__file__).parent / "templates"
RECORDINGS, TABLES = Path("data/raw"), Path("reports/tables")
OPTIONS = Path("pipeline/laboratory/options")


@dataclass(frozen=True)
class Facts:
    """What is known of a dataset.

    ``about`` is what its recorders say of it, ``stored`` bytes and number of files by path,
    ``takes`` their quality one by one, ``quality`` that of the instruments; ``rate`` (1/s) and
    ``steps`` are of the motion grid, ``depth_rate`` (1/s) is None without a depth camera,
    ``configurations`` names the arrangements of the cooperating robots. ``laboratory`` is None for
    recordings.
    """

    name: str
    scale: str
    seed: int
    about: Mapping[str, str]
    stored: Mapping[str, tuple[int, int]]
    takes: pd.DataFrame
    quality: pd.DataFrame
    rate: float
    steps: int
    depth_rate: float | None
    configurations: Sequence[str]
    force_seconds: float
    laboratory: Sequence[Part] | None


def gather(settings: SimpleNamespace) -> Facts:
    """The facts of the dataset that ``settings`` describe, from its folder and the reports."""
    dataset = settings.dataset
    lock = RECORDINGS / dataset.name / "dvc.lock"
    stages = read_yaml(lock)["stages"].values() if lock.is_file() else []
    laboratory = None
    if dataset.laboratory:
        values = {name: asdict(options) for name, options in dataset.laboratory.items()}
        sources = [file.read_text(encoding="utf-8") for file in sorted(OPTIONS.glob("*.py"))]
        laboratory = parts("\n".join(sources), config.LABORATORY, values)
    return Facts(
        name=dataset.name,
        scale=settings.scale.name,
        seed=settings.seed,
        about=read_yaml(RECORDINGS / dataset.name / "dataset.yaml")["about"],
        stored={
            out["path"]: (out["size"], out.get("nfiles", 1))
            for stage in stages
            for out in stage["outs"]
        },
        takes=pd.read_csv(TABLES / "takes.csv"),
        quality=pd.read_csv(TABLES / "recording_quality.csv"),
        rate=dataset.motion.rate,
        steps=dataset.motion.steps,
        depth_rate=dataset.depth.rate if dataset.depth else None,
        configurations=list(dataset.force.configurations) if dataset.force else [],
        force_seconds=settings.scale.force_seconds,
        laboratory=laboratory,
    )


def card(facts: Facts) -> str:
    """The dataset card as Markdown."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES, encoding="utf-8"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"number": number, "cell": _cell}
    takes_of_part = facts.takes["part"].value_counts()
    left_out = facts.takes.loc[facts.takes["left_out"].astype(bool), "take"]
    return environment.get_template("dataset_card.md").render(
        facts=facts, parts=takes_of_part.to_dict(), left_out=list(left_out)
    )


def _cell(text: object) -> str:
    """A text that does not end its cell of a table."""
    return str(text).replace("|", "\\|")
