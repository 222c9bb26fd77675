"""Damage to files as it happens to them: to their bytes on the way, to the rows, cells and numbers
of text in a spreadsheet, an editor or another culture.
"""

import re
from collections.abc import Callable, Iterator

import numpy as np

Rng = np.random.Generator
Change = Callable[[bytes, Rng], bytes]


def _span(new: Change, longest: int = 40) -> Change:
    """Change of up to ``longest`` bytes somewhere: ``new`` of them."""

    def mutate(content: bytes, rng: Rng) -> bytes:
        start = int(rng.integers(len(content)))
        end = min(start + int(rng.integers(1, longest)), len(content))
        return content[:start] + new(content[start:end], rng) + content[end:]

    return mutate


def _part(pattern: bytes, new: Change) -> Change:
    """Change of one of the parts that match ``pattern``: ``new`` of it."""

    def mutate(content: bytes, rng: Rng) -> bytes:
        found = [*re.finditer(pattern, content)]
        start, end = found[int(rng.integers(len(found)))].span() if found else (0, 0)
        return content[:start] + new(content[start:end], rng) + content[end:]

    return mutate


ROW, CELL, NUMBER = rb"[^\n]*\n", rb"[^,;\t\n ]+[,;\t\n ]", rb"\d+(\.\d+)?"
CELLS = rb"([^,;\t\n ]+)([,;\t ])([^,;\t\n ]+)"
BYTES = {
    "bit flipped": _span(
        lambda block, rng: bytes([block[0] ^ 1 << int(rng.integers(8))]), 2
    ),
    "cut": lambda content, rng: content[: int(rng.integers(1, len(content)))],
    "block lost": _span(lambda block, rng: b""),
    "block doubled": _span(lambda block, rng: block + block),
    "block zeroed": _span(lambda block, rng: bytes(len(block))),
    "block of noise": _span(lambda block, rng: rng.bytes(len(block))),
    "block of ones": _span(lambda block, rng: b"\xff" * len(block), 9),
    "noise behind": lambda content, rng: content + rng.bytes(int(rng.integers(1, 400))),
}
TEXT = {
    "rows swapped": _part(
        ROW + ROW, lambda rows, rng: b"".join(rows.splitlines(True)[::-1])
    ),
    "cells swapped": _part(CELLS, lambda cells, rng: re.sub(CELLS, rb"\3\2\1", cells)),
    "column lost": lambda content, rng: re.sub(rb"(?m)^" + CELLS, rb"\1", content),
    "row cut": _part(
        ROW, lambda row, rng: row[: int(rng.integers(len(row) + 1))] + b"\n"
    ),
    "sign added": _part(NUMBER, lambda number, rng: b"-" + number),
    "point lost": _part(NUMBER, lambda number, rng: number.replace(b".", b"")),
    "number with comma": _part(NUMBER, lambda number, rng: number.replace(b".", b",")),
    "commas for points": lambda content, rng: content.replace(b".", b","),
    "in UTF-16": lambda content, rng: content.decode("latin-1").encode("utf-16"),
    "with a byte-order mark": lambda content, rng: b"\xef\xbb\xbf" + content,
    "lines end in CR LF": lambda content, rng: re.sub(rb"\r?\n", b"\r\n", content),
    "lines end in CR": lambda content, rng: re.sub(rb"\r?\n", b"\r", content),
    "no last line end": lambda content, rng: content.rstrip(b"\r\n"),
    "blanks behind lines": lambda content, rng: re.sub(rb"(\r?\n)", rb"  \1", content),
}
for name, pattern in (("row", ROW), ("cell", CELL)):
    TEXT[f"{name} lost"] = _part(pattern, lambda part, rng: b"")
    TEXT[f"{name} doubled"] = _part(pattern, lambda part, rng: part + part)
    TEXT[f"{name} emptied"] = _part(pattern, lambda part, rng: part[-1:])
for line in (b"\n", b"# note\n", b"the, sensor; was moved\n"):
    TEXT[f"line {line.decode()!r}"] = _part(ROW, lambda row, rng, line=line: line + row)
for word in (
    b"1e400",
    b"1e300",
    b"1e9",
    b"NaN",
    b"inf",
    b"7" * 5000,
    b"seven",
    b"0x1F",
):
    TEXT[f"number {word[:5].decode()}"] = _part(
        NUMBER, lambda number, rng, word=word: word
    )


def mutants(content: bytes, count: int, *, text: bool) -> Iterator[tuple[str, bytes]]:
    """``count`` changes of ``content`` by name, equal in every call; if it is ``text``, changes of
    text too.
    """
    kinds = [*(BYTES | TEXT if text else BYTES).items()]
    for number in range(count):
        name, change = kinds[number % len(kinds)]
        yield name, change(content, np.random.default_rng(number))
