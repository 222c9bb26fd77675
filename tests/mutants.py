"""Damage to files as it happens to them: to their bytes on the way, to the rows, cells and numbers
of text in a spreadsheet, an editor or another culture.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

import numpy as np

Rng = np.random.Generator
Change = Callable[[bytes, Rng], bytes]
NUMBER = re.compile(rb"\d+(\.\d+)?")
SEPARATORS = (b",", b";", b"\t", b" ")


def _span(new: Change, longest: int = 40) -> Change:
    """Change of up to ``longest`` bytes somewhere: ``new`` of them."""

    def mutate(content: bytes, rng: Rng) -> bytes:
        start = int(rng.integers(len(content)))
        end = min(start + int(rng.integers(1, longest)), len(content))
        return content[:start] + new(content[start:end], rng) + content[end:]

    return mutate


def _number(new: Change) -> Change:
    """Change of one of the numbers."""

    def mutate(content: bytes, rng: Rng) -> bytes:
        numbers = [*NUMBER.finditer(content)]
        start, end = numbers[int(rng.integers(len(numbers)))].span()
        return content[:start] + new(content[start:end], rng) + content[end:]

    return mutate


def _rows(change: Callable[[list[bytes], int, Rng], object]) -> Change:
    """Change of the lines at one of them."""

    def mutate(content: bytes, rng: Rng) -> bytes:
        lines = content.splitlines(keepends=True)
        change(lines, int(rng.integers(len(lines))), rng)
        return b"".join(lines)

    return mutate


def _cells(change: Callable[[list[bytes], int, Rng], object], *, all_rows: bool = False) -> Change:
    """Change of the cells of one line, or of all that have as many as it, at one place."""

    def mutate(content: bytes, rng: Rng) -> bytes:
        mark = max(SEPARATORS[:3], key=content.count)
        mark = mark if content.count(mark) > 3 else SEPARATORS[3]
        lines = content.split(b"\n")
        filled = [i for i, line in enumerate(lines) if mark in line]
        chosen = int(rng.choice(filled)) if filled else 0
        width = lines[chosen].count(mark) + 1
        place = int(rng.integers(width))
        for i, line in enumerate(lines):
            if i == chosen or (all_rows and line.count(mark) + 1 == width):
                cells = line.split(mark)
                change(cells, place, rng)
                lines[i] = mark.join(cells)
        return b"\n".join(lines)

    return mutate


def _swapped(parts: list[bytes], place: int, rng: Rng) -> None:
    parts[place - 1], parts[place] = parts[place], parts[place - 1]


def _cut(parts: list[bytes], place: int, rng: Rng) -> None:
    parts[place] = parts[place][: int(rng.integers(len(parts[place])))] + b"\n"


PARTS = {  # of rows, cells or columns: the list of them, and the place of one
    "lost": lambda parts, place, rng: parts.pop(place),
    "doubled": lambda parts, place, rng: parts.insert(place, parts[place]),
    "emptied": lambda parts, place, rng: parts.__setitem__(place, b""),
    "swapped": _swapped,
}
BYTES = {
    "bit flipped": _span(lambda block, rng: bytes([block[0] ^ 1 << int(rng.integers(8))]), 2),
    "cut": lambda content, rng: content[: int(rng.integers(1, len(content)))],
    "block lost": _span(lambda block, rng: b""),
    "block doubled": _span(lambda block, rng: block + block),
    "block zeroed": _span(lambda block, rng: bytes(len(block))),
    "block of noise": _span(lambda block, rng: rng.bytes(len(block))),
    "block of ones": _span(lambda block, rng: b"\xff" * len(block), 9),
    "noise behind": lambda content, rng: content + rng.bytes(int(rng.integers(1, 400))),
}
TEXT = {f"row {kind}": _rows(change) for kind, change in PARTS.items()}
TEXT |= {f"cell {kind}": _cells(change) for kind, change in PARTS.items()}
TEXT |= {f"column {kind}": _cells(change, all_rows=True) for kind, change in PARTS.items()}
for line in ("", "# note", "the, sensor; was moved"):
    added = f"{line}\n".encode()
    TEXT[f"line {line!r}"] = _rows(lambda rows, place, rng, new=added: rows.insert(place, new))
for word in (b"1e400", b"1e300", b"1e9", b"NaN", b"inf", b"7" * 5000, b"seven", b"0x1F"):
    TEXT[f"number {word[:5].decode()}"] = _number(lambda number, rng, new=word: new)
TEXT |= {
    "row cut": _rows(_cut),
    "sign added": _number(lambda number, rng: b"-" + number),
    "point lost": _number(lambda number, rng: number.replace(b".", b"")),
    "number with comma": _number(lambda number, rng: number.replace(b".", b",")),
    "commas for points": lambda content, rng: content.replace(b".", b","),
    "in UTF-16": lambda content, rng: content.decode("latin-1").encode("utf-16"),
    "with a byte-order mark": lambda content, rng: b"\xef\xbb\xbf" + content,
    "lines end in CR LF": lambda content, rng: re.sub(rb"\r?\n", b"\r\n", content),
    "lines end in CR": lambda content, rng: re.sub(rb"\r?\n", b"\r", content),
    "no last line end": lambda content, rng: content.rstrip(b"\r\n"),
    "blanks behind lines": lambda content, rng: re.sub(rb"(\r?\n)", rb"  \1", content),
}


def mutants(content: bytes, count: int, *, text: bool) -> Iterator[tuple[str, bytes]]:
    """``count`` changes of ``content`` by name, equal in every call; if it is ``text``, changes of
    text too.
    """
    kinds = [*(BYTES | TEXT if text else BYTES).items()]
    for number in range(count):
        name, change = kinds[number % len(kinds)]
        yield name, change(content, np.random.default_rng(number))
