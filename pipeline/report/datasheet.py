"""The datasheet of a dataset in the form of Gebru et al., Datasheets for Datasets, Comm. ACM 64 (2021): what a user asks before its use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from pipeline.audit.results import number
from pipeline.report.laboratory import Part

TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Facts:
    """What is known of a dataset.

    ``about`` is what its recorders say of it, ``stored`` bytes and number of files by path, ``takes`` their quality one by one,
    ``quality`` that of the instruments; ``rate`` (1/s) and ``steps`` are of the motion grid, ``depth_rate`` (1/s) is None without a depth
    camera, ``configurations`` names the arrangements of the cooperating robots. ``laboratory`` is None for recordings.
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


def write(facts: Facts) -> str:
    """The datasheet as Markdown."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES, encoding="utf-8"), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters |= {"number": number, "cell": _cell}
    parts = facts.takes["part"].value_counts()
    left_out = facts.takes.loc[facts.takes["left_out"].astype(bool), "take"]
    return environment.get_template("datasheet.md").render(facts=facts, parts=parts.to_dict(), left_out=list(left_out))


def _cell(text: object) -> str:
    """A text that does not end its cell of a table."""
    return str(text).replace("|", "\\|")
