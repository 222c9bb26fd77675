"""The figures with all that belongs to them: caption, what to look at, numbers, script, stages and
the tables behind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq

from pipeline.core.errors import ContractError
from pipeline.tools.page.pictures import Picture, picture
from pipeline.tools.page.stages import StageRun, touch
from pipeline.verdicts.wording import number

LOOK = "To look at:"
SHOWN = 12  # rows of a table that are on the page to be read


@dataclass(frozen=True)
class Table:
    """A table that lies beside the page: the path of its file, its rows, its size in bytes, its
    header, and its first rows as texts; none of a table between stages.
    """

    file: Path
    count: int
    bytes: int
    header: list[str]
    rows: list[list[str]]

    @property
    def size(self) -> str:
        """Its size for a reader."""
        if self.bytes >= 1e6:
            return f"{self.bytes / 1e6:.1f} MB"
        return f"{max(1, round(self.bytes / 1e3))} kB"


@dataclass(frozen=True)
class Illustration:
    """A figure of ``captions.json`` as the page shows it."""

    name: str
    title: str
    caption: str
    look: str
    numbers: Mapping[str, float]
    script: str
    picture: Picture
    tables: list[Table]
    stages: list[str]

    @property
    def alternative(self) -> str:
        """What the picture shows, for those who do not see it: its title and the first sentence of
        the caption.
        """
        return f"{self.title}. {self.caption.split('. ')[0].rstrip('.')}."


def illustrations(
    captions: Mapping[str, Mapping], folder: Path, tables: Path, runs: Sequence[StageRun]
) -> list[Illustration]:
    """The figures of ``captions`` in their order, from the pictures in ``folder``; ``tables`` holds
    those of the reports, ``runs`` what wrote the tables behind.
    """
    return [
        _illustration(name, caption, folder, tables, runs) for name, caption in captions.items()
    ]


def _illustration(
    name: str, caption: Mapping, folder: Path, tables: Path, runs: Sequence[StageRun]
) -> Illustration:
    text, _, look = (part.strip() for part in caption["caption"].partition(LOOK))
    behind = [Path(source) for source in caption["sources"] if source.endswith(".parquet")]
    writers = {
        run.stage: None
        for source in caption["sources"]
        for run in runs
        if any(touch(source, written) for written in run.writes)
    }
    return Illustration(
        name,
        caption["title"],
        text,
        look[:1].upper() + look[1:],
        caption["numbers"],
        caption["script"],
        picture(folder / f"{name}.png"),
        [table_behind(source, tables) for source in behind],
        [*writers, "figures"],
    )


def table_behind(source: Path, tables: Path) -> Table:
    """The table in ``source``: that of the reports where they hold it. Raises ContractError where
    it is not there.
    """
    reported = tables / f"{source.stem}.csv"
    if reported.is_file():
        return table(reported)
    if not source.is_file():
        raise ContractError(
            "a figure was drawn from this table, and it is not there; run the stage that writes it",
            file=source,
        )
    return Table(source, pq.read_metadata(source).num_rows, source.stat().st_size, [], [])


def table(file: Path) -> Table:
    """A CSV of the reports, its first rows to be read."""
    rows = pd.read_csv(file)
    cells = rows.head(SHOWN).map(_text).to_numpy().tolist()
    header = [str(name).replace("_", " ") for name in rows.columns]
    return Table(file, len(rows), file.stat().st_size, header, cells)


def _text(cell: object) -> str:
    is_number = isinstance(cell, int | float) and not isinstance(cell, bool)
    return number(cell) if is_number else str(cell)
