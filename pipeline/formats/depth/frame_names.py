"""Sequences of depth frames by their file names, which state a number or a time.

The number is the one that differs between the names. A time is a time of day with or without
a date, seconds with a fraction, or an integer since 1970 (s, ms, µs or ns by its digits).
"""

import re
from collections.abc import Iterable, Sequence
from glob import escape
from pathlib import Path
from typing import NamedTuple

import numpy as np

NANO = 10**9
DAY = 86_400 * NANO
EPOCH = range(9 * 10**8, 41 * 10**8)  # s since 1970: 1998 to 2099
# forms of times; the group f is a fraction of a second, s the seconds before it
DATE = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)[T_ -]+([012]\d)[-:._h]?([0-5]\d)"
    r"[-:._m]?([0-5]\d)(?:[.,_-](?P<f>\d{1,9}))?(?!\d)",
    re.ASCII,
)
SECONDS = re.compile(r"(?<!\d)(?P<s>\d{9,10})[._-](?P<f>\d{1,9})(?!\d)", re.ASCII)
DAYTIME = re.compile(
    r"(?<!\d)([01]\d|2[0-3])[-:.]([0-5]\d)[-:.]([0-5]\d)[.,_-](?P<f>\d{1,9})(?!\d)",
    re.ASCII,
)
DECIMAL = re.compile(r"(?<!\d)(?P<s>\d{1,8})\.(?P<f>\d{1,9})(?!\d)", re.ASCII)
INTEGER = re.compile(r"(?<!\d)(?P<s>\d{10})(?P<f>|\d{3}|\d{6}|\d{9})(?!\d)", re.ASCII)


class FrameSequence(NamedTuple):
    """Frames whose names differ in a number or a time, in its order."""

    pattern: Path  # glob of the names; the file's path for a single frame
    files: list[Path]
    values: list[
        int
    ]  # numbers, or times in ns since 1970 or another start; none without digits
    timed: bool  # whether the values are times


def frame_sequences(files: Iterable[Path]) -> list[FrameSequence]:
    """Return the sequences in ``files``: equal folder, suffix and words, and different numbers."""
    forms: dict[tuple, list[Path]] = {}
    for file in files:
        words = re.split(r"\d+", file.stem, flags=re.ASCII)
        forms.setdefault((file.parent, file.suffix, *words), []).append(file)
    return [sequence for group in forms.values() for sequence in _split(group)]


def _split(files: list[Path]) -> list[FrameSequence]:
    """Return the sequences of ``files`` whose names differ in numbers only."""
    columns = [
        *zip(*(re.findall(r"\d+", file.stem, re.ASCII) for file in files), strict=True)
    ]
    varying = [j for j, column in enumerate(columns) if len({*column}) > 1]
    times, inside = _times([file.stem for file in files], varying)
    others, values = [j for j in varying if j not in inside], times
    if not times and varying:
        # the frame's number is padded by zeros, has many values, or is late in a name
        padded = [len({*map(len, one)}) == 1 and len(one[0]) > 2 for one in columns]
        frame = max(varying, key=lambda j: (padded[j], len({*columns[j]}), j))
        others, values = [j for j in varying if j != frame], [*map(int, columns[frame])]
    elif not times:
        values = [int(column[0]) for column in columns[-1:]] * len(files)
    if not others or len({*values}) == len(files):
        return [_sequence(files, varying, values, bool(times))]
    groups: dict[tuple, list[Path]] = {}
    for row, file in enumerate(files):
        groups.setdefault(tuple(columns[j][row] for j in others), []).append(file)
    return [sequence for group in groups.values() for sequence in _split(group)]


def _sequence(
    files: list[Path], varying: Sequence[int], values: list[int], timed: bool
) -> FrameSequence:
    first, pattern = files[0], files[0]
    if len(files) > 1:
        words = re.split(
            r"(\d+)", first.stem, flags=re.ASCII
        )  # numbers at the odd places
        stars = {2 * j + 1 for j in varying}
        parts = [
            "[0-9]*" if n in stars else escape(word) for n, word in enumerate(words)
        ]
        pattern = first.with_name("".join(parts) + first.suffix)
    if not values:
        return FrameSequence(pattern, files, [], timed)
    order = sorted(range(len(files)), key=lambda row: (values[row], str(files[row])))
    return FrameSequence(
        pattern, [files[i] for i in order], [values[i] for i in order], timed
    )


def _times(stems: list[str], varying: Sequence[int]) -> tuple[list[int], range]:
    """Return the times in ns that all ``stems`` state in one way, and the numbers in them."""
    for mark in (DATE, SECONDS, DAYTIME, DECIMAL, INTEGER):
        matches = [mark.search(stem) for stem in stems]
        if None in matches:
            continue
        first, *other = {
            len(re.findall(r"\d+", m.string[: m.start()], re.ASCII)) for m in matches
        }
        inside = range(first, first + len(re.findall(r"\d+", matches[0][0], re.ASCII)))
        whole = [*map(_seconds, matches)]
        if not (
            other or None in whole or {*varying}.isdisjoint(inside) or _counts(matches)
        ):
            times = _with_fractions(whole, matches)
            if mark is DAYTIME:  # behind the longest gap, times are of the day before
                ordered = sorted(times)
                gap = int(np.argmax(np.diff([*ordered, ordered[0] + DAY]))) + 1
                times = [time - DAY * (time in ordered[gap:]) for time in times]
            return times, inside
    return [], range(0)


def _counts(matches: list[re.Match]) -> bool:
    """Return whether the last digits count on by one, and what precedes them is constant."""
    mark = matches[0].re
    if mark in (SECONDS, INTEGER) or (
        mark is DATE and any(match["f"] for match in matches)
    ):
        return False
    last = [match["f"] or match[0][-6:] for match in matches]
    if (
        len(
            {m[0].removesuffix(digits) for m, digits in zip(matches, last, strict=True)}
        )
        > 1
    ):
        return False
    numbers = sorted(int(digits) for digits in last if digits.isdecimal())
    return len(numbers) == len(last) and numbers == [
        *range(numbers[0], numbers[0] + len(last))
    ]


def _seconds(match: re.Match) -> int | None:
    """Return the whole seconds of a time, None for a date or time that cannot be."""
    if match.re is DATE:
        try:
            date = "{}-{}-{}T{}:{}:{}".format(*match.groups()[:6])
            return int(np.datetime64(date).astype(int))
        except ValueError:
            return None
    if match.re is DAYTIME:
        return int(np.dot([*map(int, match.groups()[:3])], [3600, 60, 1]))
    whole = int(match["s"])
    return whole if match.re is DECIMAL or whole in EPOCH else None


def _with_fractions(whole: list[int], matches: list[re.Match]) -> list[int]:
    """Return the times in ns of ``whole`` seconds and fractions: decimals if all have as many
    digits or one begins with a zero; else whole ms, µs or ns if one ends with a zero; else the
    reading with more even steps.
    """
    texts = [match["f"] or "" for match in matches]
    unit = 10 ** (9 - 3 * -(-max(map(len, texts)) // 3))
    pairs = [(s * NANO, digits) for s, digits in zip(whole, texts, strict=True)]
    decimals = [ns + int(digits.ljust(9, "0")) for ns, digits in pairs]
    counted = [ns + int(digits or 0) * unit for ns, digits in pairs]
    if len({*map(len, texts)}) == 1 or any(re.match("0.", digits) for digits in texts):
        return decimals
    if any(re.search(".0$", digits) for digits in texts):
        return counted

    def unevenness(times: list[int]) -> float:
        steps = np.diff(sorted(times))
        return float(steps.max() / max(np.median(steps), 1))

    point = any(f".{digits}" in m[0] for m, digits in zip(matches, texts, strict=True))
    return min([decimals, counted] if point else [counted, decimals], key=unevenness)
