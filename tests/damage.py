"""Damage to the files of valid recordings: functions of content (or of all files), severity and
draws.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.formats.depth.image import decode_depth, encode_depth

Files = Mapping[str, bytes]  # path below the folder of the recordings → content
ROW = re.compile(rb'[ \t"]*[-+]?[\d.]')  # how a row of numbers begins, and no header


def chosen(files: Files, pattern: str, number: float, rng: np.random.Generator) -> list[str]:
    """``number`` of the files that match ``pattern``, in order."""
    names = sorted(name for name in files if fnmatchcase(name, pattern))
    picked = rng.choice(len(names), min(int(number), len(names)), replace=False)
    return [names[i] for i in sorted(picked)]


def some(among: list[int], number: float, rng: np.random.Generator) -> set[int]:
    """``number`` of the indices ``among``."""
    return {among[i] for i in rng.choice(len(among), min(int(number), len(among)), replace=False)}


def lines_of(content: bytes) -> tuple[list[bytes], list[int]]:
    """The lines with their ends, and the indices of the rows of numbers."""
    lines = content.splitlines(keepends=True)
    return lines, [i for i, line in enumerate(lines) if ROW.match(line)]


# any log of text


def truncated(content, share, rng):
    return content[: len(content) - int(np.ceil(share * len(content)))]


def dropped_rows(content, number, rng):
    lines, rows = lines_of(content)
    lost = some(rows[1:-1], number, rng)
    return b"".join(line for i, line in enumerate(lines) if i not in lost)


def doubled_rows(content, number, rng):
    lines, rows = lines_of(content)
    again = some(rows, number, rng)
    return b"".join(line * (1 + (i in again)) for i, line in enumerate(lines))


def swapped_rows(content, number, rng):
    lines, rows = lines_of(content)
    for i in some(rows[:-1:2], number, rng):
        lines[i], lines[i + 1] = lines[i + 1], lines[i]
    return b"".join(lines)


def foreign_bytes(content, number, rng):
    lines, rows = lines_of(content)
    header = content[: sum(map(len, lines[: rows[0]]))]
    letters = [match.end() for match in re.finditer(rb"[A-Za-z]", header)]
    for place in sorted(some(letters, number, rng), reverse=True):
        content = content[:place] + b"\xe9" + content[place:]
    return content


def header_number(key: bytes):
    def change(content, factor, rng):
        match = re.search(re.escape(key) + rb"[\s,=:]*([\d.]+)", content)
        stated = float(match[1]) * factor
        text = b"%d" % round(stated) if match[1].isdigit() else b"%.6f" % stated
        return content[: match.start(1)] + text + content[match.end(1) :]

    return change


def header_word(key: bytes, word: bytes):
    return lambda content, severity, rng: content.replace(key, word)


# markers, in Motive's columns


def _take(content):
    """Lines above the labels, cells of the labels' rows and of the frames', columns of markers."""
    lines, rows = lines_of(content)
    first = next(i for i, line in enumerate(lines) if line.startswith(b",Type"))
    cells = [line.rstrip(b"\r\n").split(b",") for line in lines]
    labels, frames = cells[first : rows[0]], [cells[i] for i in rows]
    names = labels[1]
    markers = [i for i in range(2, len(names), 3) if not names[i].startswith(b"Unlabeled")]
    return lines[:first], labels, frames, markers


def _joined(top, labels, frames):
    return b"".join(top) + b"".join(b",".join(cells) + b"\r\n" for cells in labels + frames)


def _burst(frames, length, rng):
    length = min(int(length), len(frames) - 2)
    start = int(rng.integers(1, len(frames) - length))
    return range(start, start + length)


def hidden_link(content, number, rng):
    top, labels, frames, markers = _take(content)
    first = 3 * int(rng.integers(len(markers) // 3))
    for i in _burst(frames, number, rng):
        for column in markers[first : first + 3]:
            frames[i][column : column + 3] = [b""] * 3
    return _joined(top, labels, frames)


def hidden_samples(content, share, rng):
    top, labels, frames, markers = _take(content)
    for i, j in np.argwhere(rng.random((len(frames), len(markers))) < share):
        frames[i][markers[j] : markers[j] + 3] = [b""] * 3
    return _joined(top, labels, frames)


def swapped_labels(content, number, rng, apart=0):
    """Two markers of one link, or of links ``apart``, carry each other's label for a burst."""
    top, labels, frames, markers = _take(content)
    first = 3 * int(rng.integers(len(markers) // 3 - apart))
    one, other = rng.choice(3, 2, replace=False)
    one, other = markers[first + one], markers[first + 3 * apart + other]
    for i in _burst(frames, number, rng):
        row = frames[i]
        row[one : one + 3], row[other : other + 3] = row[other : other + 3], row[one : one + 3]
    return _joined(top, labels, frames)


swapped_links = partial(swapped_labels, apart=1)


def lost_label(content, number, rng):
    top, labels, frames, markers = _take(content)
    column = int(rng.choice(markers))
    stray = (b"Marker", b"Unlabeled 9000", b'"9000"', b"Position")
    for cells, word in zip(labels, stray, strict=False):
        cells += [word] * 3
    labels[-1] += [b"X", b"Y", b"Z"]
    burst = _burst(frames, number, rng)
    for i, row in enumerate(frames):
        row += row[column : column + 3] if i in burst else [b""] * 3
        if i in burst:
            row[column : column + 3] = [b""] * 3
    return _joined(top, labels, frames)


def frozen_tracker(content, number, rng):
    top, labels, frames, _ = _take(content)
    for i in _burst(frames, number, rng):
        frames[i][2:] = frames[i - 1][2:]
    return _joined(top, labels, frames)


def other_lengths(content, factor, rng):
    top, labels, frames, _ = _take(content)
    for row in frames:
        row[2:] = [b"%.6f" % (float(cell) * factor) if cell else cell for cell in row[2:]]
    return _joined(top, labels, frames)


# depth frames and their clock; of all files where the name begins with "all_"


def all_lost(files, number, rng):
    lost = chosen(files, "*.png", number, rng)
    return {name: content for name, content in files.items() if name not in lost}


def all_frozen(files, number, rng):
    names = sorted(name for name in files if name.endswith(".png"))
    first = int(rng.integers(max(1, len(names) - int(number))))
    return {
        **files,
        **dict.fromkeys(names[first + 1 : first + 1 + int(number)], files[names[first]]),
    }


def _pixelwise(files, change):
    changed = dict(files)
    for name in files:
        if name.endswith(".png"):
            height, width = (int.from_bytes(files[name][i : i + 4]) for i in (20, 16))
            image = decode_depth(files[name], shape=(height, width), file=Path(name)).pixels
            changed[name] = encode_depth(change(image).astype(np.uint16))
    return changed


def all_lost_pixels(files, share, rng):
    return _pixelwise(files, lambda image: np.where(rng.random(image.shape) < share, 0, image))


def all_other_unit(files, factor, rng):
    return _pixelwise(files, lambda image: np.where(image * factor < 2**16, image * factor, 0))


def flipped_bits(content, number, rng):
    damaged = bytearray(content)
    for place in rng.integers(len(content), size=int(number)):
        damaged[place] ^= 1 << int(rng.integers(8))
    return bytes(damaged)


def retimed(change):
    """A change of the times of an index: of (time, row over rows, severity)."""

    def apply(content, severity, rng):
        lines, rows = lines_of(content)
        for number, i in enumerate(rows):
            stamp, rest = lines[i].split(b" ", 1)
            time = change(float(stamp), number / len(rows), severity)
            lines[i] = b"%.6f %s" % (time, rest)
        return b"".join(lines)

    return apply


# forces


def _block(content, share, rng):
    lines, rows = lines_of(content)
    length = max(1, round(share * len(rows)))
    first = int(rng.integers(1, max(2, len(rows) - length)))
    return lines, rows[first : first + length]


def saturated(content, share, rng, full_scale=32.0):
    lines, block = _block(content, share, rng)
    for i in block:
        lines[i] = b'"%.15G",' % full_scale + lines[i].split(b",", 1)[1]
    return b"".join(lines)


def frozen_sensor(content, share, rng):
    lines, block = _block(content, share, rng)
    for i in block:
        lines[i] = lines[block[0] - 1]
    return b"".join(lines)
