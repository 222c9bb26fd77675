"""Damage to files as it happens to them: to their bytes on the way, to the rows, cells and numbers
of text in a spreadsheet, an editor or another culture.
"""

import re
from collections.abc import Callable, Iterator
from functools import partial

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


def _replace_one(pattern: bytes, new: bytes, content: bytes, rng: Rng) -> bytes:
    """Replace one of the matches of ``pattern`` by ``new``, which may name groups of it."""
    matches = [*re.finditer(pattern, content)]
    if not matches:
        return content
    match = matches[int(rng.integers(len(matches)))]
    return content[: match.start()] + match.expand(new) + content[match.end() :]


def _replace_all(pattern: bytes, new: bytes, content: bytes, rng: Rng) -> bytes:
    """Replace every match of ``pattern``."""
    return re.sub(pattern, new, content)


def _cut(content: bytes, rng: Rng) -> bytes:
    return content[: int(rng.integers(1, len(content)))]


def _cut_row(content: bytes, rng: Rng) -> bytes:
    start, end = sorted(int(place) for place in rng.integers(len(content), size=2))
    end_of_row = content.find(b"\n", start, end)
    return content if end_of_row < 0 else content[:start] + content[end_of_row:]


def _bit_flipped(block: bytes, rng: Rng) -> bytes:
    return bytes([block[0] ^ 1 << int(rng.integers(8))])


BYTES: dict[str, Change] = {
    "bit flipped": _span(_bit_flipped, longest=2),
    "cut": _cut,
    "block lost": _span(lambda block, rng: b""),
    "block doubled": _span(lambda block, rng: block + block),
    "block zeroed": _span(lambda block, rng: bytes(len(block))),
    "block of noise": _span(lambda block, rng: rng.bytes(len(block))),
    "block of ones": _span(lambda block, rng: b"\xff" * len(block), longest=9),
    "noise behind": lambda content, rng: content + rng.bytes(int(rng.integers(1, 400))),
}
ROW, CELL = rb"([^\n]*)\n", rb"([^,;\t\n ]+)([,;\t\n ])"
CELLS = rb"([^,;\t\n ]+)([,;\t ])([^,;\t\n ]+)"
NUMBER = rb"\d+(?:\.\d+)?"
DECIMAL = rb"(\d+)\.(\d+)"
ONE = {  # name → pattern, of which one match is replaced, and its replacement
    "row lost": (ROW, rb""),
    "row doubled": (ROW, rb"\1\n\1\n"),
    "row emptied": (ROW, rb"\n"),
    "rows swapped": (rb"([^\n]*\n)([^\n]*\n)", rb"\2\1"),
    "cell lost": (CELL, rb""),
    "cell doubled": (CELL, rb"\1\2\1\2"),
    "cell emptied": (CELL, rb"\2"),
    "cells swapped": (CELLS, rb"\3\2\1"),
    "sign added": (NUMBER, rb"-\g<0>"),
    "number 1e400": (NUMBER, rb"1e400"),
    "point lost": (DECIMAL, rb"\1\2"),
    "number with comma": (DECIMAL, rb"\1,\2"),
    "blank line": (ROW, rb"\n\g<0>"),
    "line of a note": (ROW, rb"# note\n\g<0>"),
    "line of words": (ROW, rb"the, sensor; was moved\n\g<0>"),
    "number 1e300": (NUMBER, rb"1e300"),
    "number 1e9": (NUMBER, rb"1e9"),
    "number NaN": (NUMBER, rb"NaN"),
    "number inf": (NUMBER, rb"inf"),
    "number of many digits": (NUMBER, b"7" * 5000),
    "number in words": (NUMBER, rb"seven"),
    "number 0x1F": (NUMBER, rb"0x1F"),
}
ALL = {  # name → pattern, of which every match is replaced, and its replacement
    "column lost": (rb"(?m)^" + CELLS, rb"\1"),
    "commas for points": (rb"\.", rb","),
    "with a byte-order mark": (rb"\A", b"\xef\xbb\xbf"),
    "lines end in CR LF": (rb"\r?\n", rb"\r\n"),
    "lines end in CR": (rb"\r?\n", rb"\r"),
    "no last line end": (rb"[\r\n]+\Z", rb""),
    "blanks behind lines": (rb"(\r?\n)", rb"  \1"),
}
TEXT: dict[str, Change] = {
    "row cut": _cut_row,
    "in UTF-16": lambda content, rng: content.decode("latin-1").encode("utf-16"),
}
TEXT |= {name: partial(_replace_all, *change) for name, change in ALL.items()}
TEXT |= {name: partial(_replace_one, *change) for name, change in ONE.items()}


def mutants(content: bytes, count: int, *, text: bool) -> Iterator[tuple[str, bytes]]:
    """``count`` changes of ``content`` by name, equal in every call; if it is ``text``, changes of
    text too.
    """
    kinds = [*(BYTES | TEXT if text else BYTES).items()]
    for number in range(count):
        name, change = kinds[number % len(kinds)]
        yield name, change(content, np.random.default_rng(number))
