"""Damage to files as it happens to them: to their bytes on the way, to the rows, cells and numbers
of text in a spreadsheet, an editor or another culture.
"""

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.core.typed_yaml import read_yaml

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
    number = int(rng.integers(len(matches)))
    match = matches[number]
    before = content[: match.start()]
    after = content[match.end() :]
    return before + match.expand(new) + after


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
PATTERNS = read_yaml(Path(__file__).with_suffix(".yaml"))
TEXT: dict[str, Change] = {
    "row cut": _cut_row,
    "in UTF-16": lambda content, rng: content.decode("latin-1").encode("utf-16"),
}
for name, (pattern, new) in PATTERNS["every match"].items():
    TEXT[name] = partial(_replace_all, pattern.encode(), new.encode())
for name, (pattern, new) in PATTERNS["one match"].items():
    TEXT[name] = partial(_replace_one, pattern.encode(), new.encode())
NUMBER = PATTERNS["one match"]["number in words"][0].encode()
TEXT["number of many digits"] = partial(_replace_one, NUMBER, b"7" * 5000)


def mutants(content: bytes, count: int, *, text: bool) -> Iterator[tuple[str, bytes]]:
    """``count`` changes of ``content`` by name, equal in every call; if it is ``text``, changes of
    text too.
    """
    changes = BYTES | TEXT if text else BYTES
    kinds = [*changes.items()]
    for number in range(count):
        name, change = kinds[number % len(kinds)]
        yield name, change(content, np.random.default_rng(number))
