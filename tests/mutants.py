"""Damage to files as it happens to them: to their bytes on the way, to the rows, cells and numbers
of text in a spreadsheet, an editor or another culture.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

import numpy as np

Rng = np.random.Generator
NUMBER = re.compile(rb"\d+(\.\d+)?")
SEPARATORS = (b",", b";", b"\t", b" ")
# spellings that another setting of the program would have given
WORDS = {b"Meters": b"Millimeters", b"Quaternion": b"XYZ", b"Global": b"Local", b"(N)": b"(lbf)"}
WORDS |= {b"(N-m)": b"(lbf-in)", b"Units: N": b"Units: lbf", b'ForceUnits="N"': b'ForceUnits="lbf"'}
WORDS |= {b"revolute": b"continuous", b"width": b"height", b"Force X": b"Force Y", b"Fx": b"Fy"}
WORDS |= {b"float": b"int", b"plumb_bob": b"fisheye", b"righthanded": b"lefthanded"}


def _span(content: bytes, rng: Rng, longest: int = 40) -> tuple[int, int]:
    start = int(rng.integers(len(content)))
    return start, min(start + int(rng.integers(1, longest)), len(content))


def _put(content: bytes, start: int, end: int, new: bytes) -> bytes:
    return content[:start] + new + content[end:]


def _in_span(new: Callable[[bytes, Rng], bytes], longest: int = 40) -> Callable:
    """Change of a random span: ``new`` of its bytes."""

    def mutate(content: bytes, rng: Rng) -> bytes:
        start, end = _span(content, rng, longest)
        return _put(content, start, end, new(content[start:end], rng))

    return mutate


def _bit(content: bytes, rng: Rng) -> bytes:
    place, _ = _span(content, rng)
    return _put(content, place, place + 1, bytes([content[place] ^ 1 << int(rng.integers(8))]))


BYTES = {
    "bit flipped": _bit,
    "cut": lambda content, rng: content[: int(rng.integers(1, len(content)))],
    "block lost": _in_span(lambda block, rng: b""),
    "block doubled": _in_span(lambda block, rng: block + block),
    "block zeroed": _in_span(lambda block, rng: bytes(len(block))),
    "block of noise": _in_span(lambda block, rng: rng.bytes(len(block))),
    "block of ones": _in_span(lambda block, rng: b"\xff" * len(block), 9),
    "noise behind": lambda content, rng: content + rng.bytes(int(rng.integers(1, 400))),
}


def _number(change: Callable[[bytes, Rng], bytes]) -> Callable[[bytes, Rng], bytes]:
    """One of the numbers, changed."""

    def mutate(content: bytes, rng: Rng) -> bytes:
        numbers = [*NUMBER.finditer(content)]
        chosen = numbers[int(rng.integers(len(numbers)))]
        return _put(content, *chosen.span(), change(chosen[0], rng))

    return mutate


def _digit(number: bytes, rng: Rng, new: Callable[[bytes], bytes]) -> bytes:
    place = int(rng.choice([i for i, letter in enumerate(number) if letter != ord(".")]))
    return _put(number, place, place + 1, new(number[place : place + 1]))


def _rows(change: Callable[[list[bytes], int, Rng], None]) -> Callable[[bytes, Rng], bytes]:
    """The lines, changed at one of them."""

    def mutate(content: bytes, rng: Rng) -> bytes:
        lines = content.splitlines(keepends=True)
        change(lines, int(rng.integers(len(lines))), rng)
        return b"".join(lines)

    return mutate


def _cells(change: Callable[[list[bytes], int], None], *, all_rows: bool = False) -> Callable:
    """The cells of one line, or of all that have as many as it, changed at one place."""

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
                change(cells, place)
                lines[i] = mark.join(cells)
        return b"\n".join(lines)

    return mutate


def _lost(parts: list[bytes], place: int, *rng: Rng) -> None:
    del parts[place]


def _doubled(parts: list[bytes], place: int, *rng: Rng) -> None:
    parts.insert(place, parts[place])


def _swapped(parts: list[bytes], place: int, *rng: Rng) -> None:
    parts[place - 1], parts[place] = parts[place], parts[place - 1]


def _emptied(parts: list[bytes], place: int, *rng: Rng) -> None:
    parts[place] = b""


def _row_cut(lines: list[bytes], place: int, rng: Rng) -> None:
    lines[place] = lines[place][: int(rng.integers(len(lines[place])))] + b"\n"


def _line_added(line: bytes) -> Callable[[list[bytes], int, Rng], None]:
    return lambda lines, place, rng: lines.insert(place, line)


def _word(content: bytes, rng: Rng) -> bytes:
    there = [word for word in WORDS if word in content]
    if not there:
        return content
    word = there[int(rng.integers(len(there)))]
    return content.replace(word, WORDS[word], 1 if rng.integers(2) else -1)


def _becomes(new: bytes) -> Callable[[bytes, Rng], bytes]:
    return _number(lambda number, rng: new)


TEXT = {
    "row lost": _rows(_lost),
    "row doubled": _rows(_doubled),
    "rows swapped": _rows(_swapped),
    "row cut": _rows(_row_cut),
    "blank line": _rows(_line_added(b"\n")),
    "comment line": _rows(_line_added(b"# note\n")),
    "line of words": _rows(_line_added(b"the, sensor; was moved\n")),
    "cell lost": _cells(_lost),
    "cell doubled": _cells(_doubled),
    "cell emptied": _cells(_emptied),
    "cells swapped": _cells(_swapped),
    "column lost": _cells(_lost, all_rows=True),
    "column doubled": _cells(_doubled, all_rows=True),
    "column emptied": _cells(_emptied, all_rows=True),
    "columns swapped": _cells(_swapped, all_rows=True),
    "digit changed": _number(lambda n, rng: _digit(n, rng, lambda d: b"%d" % rng.integers(10))),
    "digit lost": _number(lambda n, rng: _digit(n, rng, lambda d: b"")),
    "digit added": _number(lambda n, rng: _digit(n, rng, lambda d: d + d)),
    "sign added": _number(lambda n, rng: b"-" + n),
    "point lost": _number(lambda n, rng: n.replace(b".", b"")),
    "number with comma": _number(lambda n, rng: n.replace(b".", b",")),
    "commas for points": lambda content, rng: content.replace(b".", b","),
    "number 1e400": _becomes(b"1e400"),
    "number 1e300": _becomes(b"1e300"),
    "number 1e9": _becomes(b"1e9"),
    "number NaN": _becomes(b"NaN"),
    "number inf": _becomes(b"inf"),
    "number of 5000 digits": _becomes(b"7" * 5000),
    "number as word": _becomes(b"seven"),
    "number in hexadecimal": _becomes(b"0x1F"),
    "setting": _word,
    "in UTF-16": lambda content, rng: content.decode("latin-1").encode("utf-16"),
    "with a byte-order mark": lambda content, rng: b"\xef\xbb\xbf" + content,
    "lines end in CR LF": lambda content, rng: re.sub(rb"\r?\n", b"\r\n", content),
    "lines end in CR": lambda content, rng: re.sub(rb"\r?\n", b"\r", content),
    "no last line end": lambda content, rng: content.rstrip(b"\r\n"),
    "blanks behind lines": lambda content, rng: re.sub(rb"(\r?\n)", rb"  \1", content),
}


def mutants(content: bytes, count: int, *, text: bool) -> Iterator[tuple[str, bytes]]:
    """``count`` changes of ``content`` by name, the same ones each time; those of text too where it
    is ``text``.
    """
    kinds = [*(BYTES | TEXT if text else BYTES).items()]
    for number in range(count):
        name, change = kinds[number % len(kinds)]
        yield name, change(content, np.random.default_rng(number))
