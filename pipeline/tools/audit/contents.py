"""What two versions of an output hold, number by number and pixel by pixel, against the
tolerances.
"""

from __future__ import annotations

import io
import json
import re
from base64 import b64decode
from collections.abc import Callable, Iterator
from gzip import decompress
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from pipeline.tools.audit.difference import Difference, inside, number_differences
from pipeline.tools.audit.tolerance import LEVELS, PRINTED, ROUNDING

# a whole number is a word: it may be a count, a seed or a year
DECIMAL = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?\d+[eE][-+]?\d+")
# of a file (MD5, of a folder too, and SHA-256), and the names that matplotlib makes of what it
# draws
DIGEST = re.compile(r"\b(?:[0-9a-f]{64}|[0-9a-f]{32}(?:\.dir)?|[a-z]{1,8}[0-9a-f]{10})\b")
EMBEDDED = re.compile(r"data:([\w.+-]+/[\w.+-]+);base64,([A-Za-z0-9+/=]*)")


def compare(committed: Path, rerun: Path) -> list[Difference]:
    """The differences of two files, or of the files in two folders; none where all bytes are
    equal.
    """
    if committed.is_dir() != rerun.is_dir():
        return [Difference("", False, "a folder in one run and a file in the other")]
    if not committed.is_dir():
        return [*_compare_bytes(committed.suffix, committed.read_bytes(), rerun.read_bytes())]
    names = {
        file.relative_to(folder)
        for folder in (committed, rerun)
        for file in folder.rglob("*")
        if file.is_file()
    }
    differences = []
    for name in sorted(names):
        if not (rerun / name).is_file():
            differences.append(Difference(str(name), False, "not written by the rerun"))
        elif not (committed / name).is_file():
            differences.append(Difference(str(name), False, "written by the rerun alone"))
        else:
            differences += [
                inside(str(name), part) for part in compare(committed / name, rerun / name)
            ]
    return differences


def _compare_bytes(kind: str, old: bytes, new: bytes) -> Iterator[Difference]:
    """The differences by the rule for the kind of file; where one version is damaged, that the
    bytes differ.
    """
    if old == new:
        return
    try:
        differences = list(_RULES.get(kind, _text)(old, new))
    except (ValueError, OSError, EOFError):
        differences = [Difference("", False, f"bytes differ: {len(old)} before, {len(new)} now")]
    # equal contents in other bytes: another compression, or hashes of other outputs
    yield from differences or [Difference("", True, "the contents are equal, the bytes are not")]


def _table(before: pd.DataFrame, now: pd.DataFrame) -> Iterator[Difference]:
    if list(before.columns) != list(now.columns) or len(before) != len(now):
        yield Difference(
            "",
            False,
            f"{len(before)} rows of {len(before.columns)} columns before, {len(now)} of "
            f"{len(now.columns)} now",
        )
        return
    for name in before.columns:
        yield from (inside(f"column {name}", part) for part in _columns(before[name], now[name]))


def _columns(before: pd.Series, now: pd.Series) -> Iterator[Difference]:
    kinds = {column.dtype.kind for column in (before, now)}
    if "f" in kinds and kinds <= set("if"):
        old, new = (column.to_numpy(float) for column in (before, now))
        yield from number_differences(
            old, new, ROUNDING * np.abs(old[np.isfinite(old)]).max(initial=0.0)
        )
    elif all(pd.api.types.is_string_dtype(column) for column in (before, now)):
        yield from _texts("\n".join(before.fillna("")), "\n".join(now.fillna("")))
    elif not before.equals(now):
        yield Difference("", False, f"{int((before != now).sum())} of {len(now)} values differ")


def _parquet(old: bytes, new: bytes) -> Iterator[Difference]:
    return _table(*(pd.read_parquet(io.BytesIO(content)) for content in (old, new)))


def _csv(old: bytes, new: bytes) -> Iterator[Difference]:
    """A table by its columns; what an instrument logged in lines of different lengths as text."""
    try:
        before, now = (pd.read_csv(io.BytesIO(content), low_memory=False) for content in (old, new))
    except pd.errors.ParserError:
        return _text(old, new)
    return _table(before, now)


def _packed(old: bytes, new: bytes) -> Iterator[Difference]:
    """The page packs long tables, and nothing else."""
    return _csv(decompress(old), decompress(new))


def _json(old: bytes, new: bytes) -> Iterator[Difference]:
    before, now = (dict(_leaves(json.loads(content))) for content in (old, new))
    if before.keys() != now.keys():
        lone = sorted(before.keys() ^ now.keys())
        yield Difference(lone[0], False, f"{len(lone)} keys in one run alone")
        return
    for key, was in before.items():
        if isinstance(was, float) and isinstance(now[key], float):
            yield from (
                inside(key, part)
                for part in number_differences(np.array([was]), np.array([now[key]]), 0.0)
            )
        elif isinstance(was, str) and isinstance(now[key], str):
            yield from (inside(key, part) for part in _texts(was, now[key]))
        elif was != now[key]:
            yield Difference(key, False, f"{was} before, {now[key]} now")


def _leaves(value: object, key: str = "") -> Iterator[tuple[str, object]]:
    """Every value by the keys and places that lead to it."""
    parts = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else None
    )
    if parts is None:
        yield key, value
    else:
        yield f"{key}/", type(value).__name__
        for name, part in parts:
            yield from _leaves(part, f"{key}/{name}" if key else str(name))


def _text(old: bytes, new: bytes) -> Iterator[Difference]:
    return _texts(old.decode(), new.decode())


def _texts(old: str, new: str) -> Iterator[Difference]:
    """Lines by their words and their decimal numbers, and what is embedded in a page by the rule
    for its kind.
    """
    for (kind, was), (_, now) in zip(EMBEDDED.findall(old), EMBEDDED.findall(new), strict=False):
        yield from (
            inside(f"embedded {kind}", part)
            for part in _compare_bytes(kind, b64decode(was), b64decode(now))
        )
    before, now = (DIGEST.sub("", EMBEDDED.sub("", text)).splitlines() for text in (old, new))
    if len(before) != len(now):
        yield Difference("", False, f"{len(before)} lines before, {len(now)} now")
        return
    lines = {
        line: pair
        for line, pair in enumerate(zip(before, now, strict=True), 1)
        if pair[0] != pair[1]
    }
    if worded := [
        line
        for line, (was, here) in lines.items()
        if DECIMAL.sub(".", was) != DECIMAL.sub(".", here)
    ]:
        yield Difference(
            f"line {worded[0]}", False, f"the words of {len(worded)} of {len(now)} lines differ"
        )
        return
    pairs = [
        pair
        for was, here in lines.values()
        for pair in zip(DECIMAL.findall(was), DECIMAL.findall(here), strict=True)
    ]
    printed = np.array(
        [min(_unit(was), _unit(here), PRINTED * abs(float(was))) for was, here in pairs]
    )
    yield from number_differences(*np.array(pairs, float).reshape(-1, 2).T, printed)


def _unit(number: str) -> float:
    """One unit of the last printed digit, and a little more, as neither of two neighbours is exact
    in binary.
    """
    digits, _, exponent = number.lower().partition("e")
    return 1.01 * 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))


def _picture(old: bytes, new: bytes) -> Iterator[Difference]:
    before, now = (
        np.asarray(Image.open(io.BytesIO(content))).astype(np.int64) for content in (old, new)
    )
    if before.shape != now.shape:
        yield Difference("", False, f"size {before.shape} before, {now.shape} now")
    elif (off := np.abs(now - before)).any():
        words = f"{np.count_nonzero(off)} of {off.size} values by at most {off.max()} levels"
        yield Difference("", bool(off.max() <= LEVELS), words, float(off.max()))


# by the ending of a file or the media type of what is embedded; all others are texts, or bytes that
# none of these can read
_RULES: dict[str, Callable[[bytes, bytes], Iterator[Difference]]] = {
    ".parquet": _parquet,
    ".csv": _csv,
    "text/csv": _csv,
    ".json": _json,
    "application/gzip": _packed,
    ".png": _picture,
    "image/png": _picture,
}
