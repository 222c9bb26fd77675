"""Numbers, intervals and tables as text, and the prose of the pages."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.typed_yaml import read_yaml

MISSING = "–"
CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f]")  # characters, other than line ends
# start of a tag that the pages do not use themselves
TAG = re.compile(r'<(?=[A-Za-z/!?])(?!br>|/?details>|/?summary>|a id="[\w-]+">|/a>|!--)')
TEXTS = read_yaml(Path(__file__).with_name("texts.yaml"))


def plain_name(model: str) -> str:
    """Return the name of ``model`` on the pages."""
    return TEXTS["names"].get(model, model)


def number(value: float, digits: int = 4) -> str:
    """Return ``value`` with significant ``digits``; whole numbers in full, NaN as a dash."""
    if pd.isna(value):
        return MISSING
    if np.isinf(value):
        return "∞" if value > 0 else "−∞"
    whole = float(value).is_integer() and abs(value) < 1e9
    return f"{value:,.0f}" if whole else f"{value:.{digits}g}"


def interval(low: float, high: float) -> str:
    """Return an interval in brackets."""
    return f"[{number(low)}, {number(high)}]"


def plain_page(text: str) -> str:
    """Return the Markdown ``text`` of a page, in which names come from files, without control
    characters and with all tags escaped that the pages do not use.
    """
    return TAG.sub("&lt;", CONTROL.sub(" ", text))


def escaped(text: str) -> str:
    """Return ``text`` for a cell: no columns, no tags but line ends, no control characters."""
    return re.sub(r"<(?!br>)", "&lt;", " ".join(plain_page(text).split())).replace("|", r"\|")


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table; :func:`number` writes the cells that are numbers. Other cells are
    escaped: names from recordings in them are plain text.
    """

    def text(cell: object) -> str:
        return number(cell) if isinstance(cell, int | float | np.number) else escaped(str(cell))

    lines = [map(text, header), ["---"] * len(header), *(map(text, row) for row in rows)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def join_names(names: Iterable[str]) -> str:
    """Return ``names`` separated by commas, with "and" before the last."""
    *first, last = names
    return " and ".join(filter(None, [", ".join(first), last]))


def page(parts: Iterable[str], sections: dict[str, str] | None = None) -> str:
    """Return the paragraphs ``parts``, then the ``sections`` by heading; empty ones are dropped."""
    headed = [f"## {heading}\n{text}" for heading, text in (sections or {}).items() if text]
    return plain_page("\n\n".join([*filter(None, parts), *headed]) + "\n")
