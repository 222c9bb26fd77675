"""The figures with all that belongs to them: caption, what to look at, numbers, script, stages and the tables behind."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path

import pandas as pd
import pyarrow as pa

from pipeline.errors import ContractError
from pipeline.report.graph import Stage

LOOK = "To look at:"
DIGITS = "%.5g"  # of numbers in a table that is made for the page
PLAIN = 400_000  # characters of a table; longer ones are compressed, by pyarrow's own zlib, whose bytes are the same everywhere
LONGEST = 60_000  # rows; of longer ones only those of the models that are drawn are on the page


@dataclass(frozen=True)
class Download:
    """A table as CSV: ``name`` of its file, where it comes from, rows, size in bytes, its address with all its data, and what it lacks."""

    name: str
    source: str
    rows: int
    bytes: int
    address: str
    lacks: str = ""

    @property
    def size(self) -> str:
        """Its size for a reader."""
        return f"{self.bytes / 1e6:.1f} MB" if self.bytes >= 1e6 else f"{max(1, round(self.bytes / 1e3))} kB"


@dataclass(frozen=True)
class Illustration:
    """A figure of ``captions.json`` as the page shows it; ``image`` is the address of its picture with all its data."""

    name: str
    title: str
    caption: str
    look: str
    numbers: Mapping[str, float]
    script: str
    image: str
    downloads: list[Download]
    stages: list[str]

    @property
    def alternative(self) -> str:
        """What the picture shows, for those who do not see it: its title and the first sentence of the caption."""
        return f"{self.title}. {self.caption.split('. ')[0].rstrip('.')}."


def illustrations(
    captions: Mapping[str, Mapping], folder: Path, tables: Path, stages: Sequence[Stage], drawn: Sequence[str]
) -> list[Illustration]:
    """The figures of ``captions`` in their order, from the pictures in ``folder``; ``tables`` holds those of the reports.

    ``drawn`` are the models that figures of single takes show.
    """
    found = []
    for name, of in captions.items():
        caption, _, look = of["caption"].partition(LOOK)
        sources = [Path(source) for source in of["sources"]]
        of_data = [source for source in sources if source.suffix == ".parquet"]
        writers = [stage.name for stage in stages if any(_wrote(stage, source) for source in sources)]
        look = look.strip()
        found.append(
            Illustration(
                name, of["title"], caption.strip(), look[:1].upper() + look[1:], of["numbers"], of["script"], picture(folder, name),
                [download_behind(source, tables, drawn) for source in of_data], [*writers, "figures"],
            )
        )  # fmt: skip
    return found


def _wrote(stage: Stage, file: Path) -> bool:
    return any(fnmatch(file.as_posix(), pattern) for path in stage.writes for pattern in (path, f"{path}/*"))


def picture(folder: Path, name: str) -> str:
    """The address of the smaller of a figure's two files with all its data."""
    vector, pixels = (folder / f"{name}.{kind}" for kind in ("svg", "png"))
    if vector.stat().st_size <= pixels.stat().st_size:
        return data_address("image/svg+xml", vector.read_bytes())
    return data_address("image/png", pixels.read_bytes())


def data_address(kind: str, content: bytes) -> str:
    """``content`` of a media type as an address that needs no file beside the page."""
    return f"data:{kind};base64,{b64encode(content).decode('ascii')}"


def download_behind(source: Path, tables: Path, drawn: Sequence[str]) -> Download:
    """The table in ``source``, on the page once: without an address where the reports hold it, for those are listed as tables.

    Raises ContractError where it is not there.
    """
    reported = tables / f"{source.stem}.csv"
    if reported.is_file():
        return replace(download(reported), address="")
    if not source.is_file():
        raise ContractError("a figure was drawn from this table, and it is not there; run the stage that writes it", file=source)
    rows, lacks = pd.read_parquet(source), ""
    if len(rows) > LONGEST and "model" in rows.columns:
        rows, lacks = rows[rows["model"].isin(drawn)], f"of the models {', '.join(drawn)} alone"
    text = rows.to_csv(index=False, float_format=DIGITS, lineterminator="\n").encode()
    if len(text) <= PLAIN:
        return Download(f"{source.stem}.csv", source.as_posix(), len(rows), len(text), data_address("text/csv", text), lacks)
    packed = pa.Codec("gzip", compression_level=6).compress(text, asbytes=True)
    return Download(f"{source.stem}.csv.gz", source.as_posix(), len(rows), len(packed), data_address("application/gzip", packed), lacks)


def download(file: Path) -> Download:
    """A CSV of the reports as it is."""
    content = file.read_bytes()
    return Download(file.name, file.as_posix(), content.count(b"\n") - 1, len(content), data_address("text/csv", content))
