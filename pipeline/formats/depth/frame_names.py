"""Sequences of depth frames by their file names, which state a number or a time.

The number is the one that differs between the names. A time is a time of day with or without
a date, seconds with a fraction, or an integer since 1970 (s, ms, µs or ns by its digits).
"""

import re
from collections.abc import Iterable, Sequence
from glob import escape
from operator import contains
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
    # numbers, or times in ns since 1970 or another start; none without digits
    values: list[int]
    timed: bool  # whether the values are times


def frame_sequences(files: Iterable[Path]) -> list[FrameSequence]:
    """Return the sequences in ``files``: equal folder, suffix and words, and different numbers."""
    by_words = {}
    for file in files:
        words = re.split(r"\d+", file.stem, flags=re.ASCII)
        by_words.setdefault((file.parent, file.suffix, *words), []).append(file)
    sequences = []
    for alike in by_words.values():
        sequences += _split(alike)
    return sequences


def _numbers(text: str) -> list[str]:
    return re.findall(r"\d+", text, re.ASCII)


def _split(files: list[Path]) -> list[FrameSequence]:
    """Return the sequences of ``files`` whose names differ in numbers only."""
    rows = [_numbers(file.stem) for file in files]
    columns = [*zip(*rows, strict=True)]
    varying = [place for place, column in enumerate(columns) if len({*column}) > 1]
    values, in_times = _times([file.stem for file in files], varying)
    timed = bool(values)
    if timed:
        separate = [place for place in varying if place not in in_times]
    elif varying:
        likeness = [(*_likeness(columns[place]), place) for place in varying]
        *_, frame = max(likeness)
        separate = [place for place in varying if place != frame]
        values = [int(number) for number in columns[frame]]
    else:
        separate = []
        last_numbers = [int(column[0]) for column in columns[-1:]]
        values = last_numbers * len(files)
    if not separate or len({*values}) == len(files):
        return [_sequence(files, varying, values, timed)]
    by_separate = {}
    for row, file in zip(rows, files, strict=True):
        numbers = tuple(row[place] for place in separate)
        by_separate.setdefault(numbers, []).append(file)
    sequences = []
    for alike in by_separate.values():
        sequences += _split(alike)
    return sequences


def _likeness(column: Sequence[str]) -> tuple[bool, int]:
    """Return how like a frame's number a ``column`` is: padded by zeros, with many values."""
    lengths = {len(number) for number in column}
    padded = len(lengths) == 1 and len(column[0]) > 2
    return padded, len({*column})


def _sequence(
    files: list[Path],
    varying: Sequence[int],
    values: list[int],
    timed: bool,
) -> FrameSequence:
    pattern = files[0]
    if len(files) > 1:
        # numbers are at the odd places
        words = re.split(r"(\d+)", pattern.stem, flags=re.ASCII)
        words = [escape(word) for word in words]
        for place in varying:
            words[2 * place + 1] = "[0-9]*"
        pattern = pattern.with_name("".join(words) + pattern.suffix)
    if not values:
        return FrameSequence(pattern, files, [], timed)
    ordered = sorted(zip(values, map(str, files), files, strict=True))
    ordered_files = [file for _, _, file in ordered]
    return FrameSequence(pattern, ordered_files, sorted(values), timed)


def _times(stems: list[str], varying: Sequence[int]) -> tuple[list[int], range]:
    """Return the times in ns that all ``stems`` state in one way, and the numbers in them."""
    for form in (DATE, SECONDS, DAYTIME, DECIMAL, INTEGER):
        matches = [form.search(stem) for stem in stems]
        if None in matches:
            continue
        before = {len(_numbers(match.string[: match.start()])) for match in matches}
        first = min(before)
        in_times = range(first, first + len(_numbers(matches[0][0])))
        seconds = [_seconds(match) for match in matches]
        if len(before) > 1 or None in seconds or {*varying}.isdisjoint(in_times):
            continue
        if _counts(matches):
            continue
        times = _with_fractions(seconds, matches)
        return _across_midnight(times) if form is DAYTIME else times, in_times
    return [], range(0)


def _across_midnight(times: list[int]) -> list[int]:
    """Return the ``times`` of day in ns, those behind the longest gap as of the day before."""
    ordered = sorted(times)
    steps = np.diff([*ordered, ordered[0] + DAY])
    last = ordered[int(steps.argmax())]  # of the second day
    return [time - DAY if time > last else time for time in times]


def _counts(matches: list[re.Match]) -> bool:
    """Return whether the last digits count on by one, and what precedes them is constant."""
    form = matches[0].re
    fraction = form is DATE and any(match["f"] for match in matches)
    if form in (SECONDS, INTEGER) or fraction:
        return False
    last_digits = [match["f"] or match[0][-6:] for match in matches]
    if not all(map(str.isdecimal, last_digits)):
        return False
    before = {
        match[0].removesuffix(digits)
        for match, digits in zip(matches, last_digits, strict=True)
    }
    numbers = sorted(map(int, last_digits))
    counted = [*range(numbers[0], numbers[0] + len(numbers))]
    return len(before) == 1 and numbers == counted


def _seconds(match: re.Match) -> int | None:
    """Return the whole seconds of a time, None for a date or time that cannot be."""
    if match.re is DATE:
        try:
            date = "{}-{}-{}T{}:{}:{}".format(*match.groups()[:6])
            return int(np.datetime64(date).astype(int))
        except ValueError:
            return None
    if match.re is DAYTIME:
        hours, minutes, seconds = map(int, match.groups()[:3])
        return 3600 * hours + 60 * minutes + seconds
    whole = int(match["s"])
    return whole if match.re is DECIMAL or whole in EPOCH else None


def _with_fractions(whole: list[int], matches: list[re.Match]) -> list[int]:
    """Return the times in ns of ``whole`` seconds and fractions: decimals if all have as many
    digits or one begins with a zero; else whole ms, µs or ns if one ends with a zero; else the
    reading with more even steps.
    """
    fractions = [match["f"] or "" for match in matches]
    lengths = {len(digits) for digits in fractions}
    groups = -(-max(lengths) // 3)  # of three digits: ms, µs or ns
    unit = 10 ** (9 - 3 * groups)
    decimals = []
    counted = []
    for seconds, digits in zip(whole, fractions, strict=True):
        start = seconds * NANO
        decimals.append(start + int(digits.ljust(9, "0")))
        counted.append(start + int(digits or 0) * unit)
    if len(lengths) == 1 or any(re.match("0.", digits) for digits in fractions):
        return decimals
    if any(re.search(".0$", digits) for digits in fractions):
        return counted
    likely = [counted, decimals]
    with_points = [f".{digits}" for digits in fractions]
    if any(map(contains, [match[0] for match in matches], with_points)):
        likely.reverse()
    return min(likely, key=_unevenness)


def _unevenness(times: list[int]) -> float:
    """Return the greatest step between ``times`` over the median step."""
    steps = np.diff(sorted(times))
    return float(steps.max() / max(np.median(steps), 1))
