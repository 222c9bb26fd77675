"""Damage to the files of valid recordings: functions of content (of all files where the name begins
with "all_"), severity and draws.
"""

import re
from functools import partial

import cv2
import numpy as np

ROW = re.compile(rb'[ \t"]*[-+]?[\d.]')  # start of a row of numbers, not of a header


def some(among, number: float, rng: np.random.Generator) -> list:
    """``number`` of the entries ``among``, in order."""
    return sorted(
        rng.choice(among, min(int(number), len(among)), replace=False).tolist(),
    )


def lines_of(content: bytes) -> tuple[list[bytes], list[int]]:
    """The lines with their ends, and the indices of the rows of numbers."""
    lines = content.splitlines(keepends=True)
    return lines, [i for i, line in enumerate(lines) if ROW.match(line)]


# any log of text


def header_number(key: bytes):
    """Damage that multiplies the number after ``key``."""

    def change(content, factor, rng):
        match = re.search(re.escape(key) + rb"[\s,=:]*([\d.]+)", content)
        stated = float(match[1]) * factor
        text = b"%d" % round(stated) if match[1].isdigit() else b"%.6f" % stated
        return content[: match.start(1)] + text + content[match.end(1) :]

    return change


def header_word(key: bytes, word: bytes):
    return lambda content, severity, rng: content.replace(key, word)


# markers, in Motive's columns


def on_take(change):
    """Damage that edits cells: rows of labels, rows of frames; ``change`` also gets the first
    column of each marker.
    """

    def apply(content, severity, rng):
        lines, rows = lines_of(content)
        (first,) = (i for i, line in enumerate(lines) if line.startswith(b",Type"))
        cells = [line.rstrip(b"\r\n").split(b",") for line in lines[first:]]
        count = rows[0] - first  # of the rows of labels
        labels = cells[:count]
        frames = cells[count:]
        markers = range(2, len(labels[1]), 3)
        change(labels, frames, markers, severity, rng)

        edited = lines[:first]
        edited += [b",".join(row) + b"\r\n" for row in cells]
        return b"".join(edited)

    return apply


def burst(frames, length, rng):
    """Indices of ``length`` consecutive frames, without the first and the last."""
    length = min(int(length), len(frames) - 2)
    start = int(rng.integers(1, len(frames) - length))
    return range(start, start + length)


@on_take
def hidden_link(labels, frames, markers, number, rng):
    first = markers[3 * int(rng.integers(len(markers) // 3))]
    for i in burst(frames, number, rng):
        frames[i][first : first + 9] = [b""] * 9


@on_take
def hidden_samples(labels, frames, markers, share, rng):
    for i, j in np.argwhere(rng.random((len(frames), len(markers))) < share):
        frames[i][markers[j] : markers[j] + 3] = [b""] * 3


def swap_labels(labels, frames, markers, number, rng, apart):
    """Two markers of one link, or of links ``apart``, exchange their labels for a burst."""
    links = len(markers) // 3
    link = int(rng.integers(links - apart))
    columns = []
    for on_link, of_link in zip(
        (link, link + apart),
        rng.choice(3, 2, False),
        strict=True,
    ):
        column = markers[3 * on_link + of_link]
        columns.append(slice(column, column + 3))

    for i in burst(frames, number, rng):
        positions = [frames[i][column] for column in columns]
        for column, position in zip(columns, positions[::-1], strict=True):
            frames[i][column] = position


swapped_labels = on_take(partial(swap_labels, apart=0))
swapped_links = on_take(partial(swap_labels, apart=1))


@on_take
def lost_label(labels, frames, markers, number, rng):
    column = int(rng.choice(markers))
    place = slice(column, column + 3)
    stray = (b"Marker", b"Unlabeled 9000", b'"9000"', b"Position")
    for row, word in zip(labels, stray, strict=False):
        row += [word] * 3
    labels[-1] += [b"X", b"Y", b"Z"]

    lost = burst(frames, number, rng)
    for i, row in enumerate(frames):
        if i in lost:
            row += row[place]
            row[place] = [b""] * 3
        else:
            row += [b""] * 3


@on_take
def frozen_tracker(labels, frames, markers, number, rng):
    for i in burst(frames, number, rng):
        frames[i][2:] = frames[i - 1][2:]


@on_take
def other_lengths(labels, frames, markers, factor, rng):
    for row in frames:
        row[2:] = [
            b"%.6f" % (float(cell) * factor) if cell else cell for cell in row[2:]
        ]


# depth frames and their clock


def all_lost(files, number, rng):
    lost = some([name for name in files if name.endswith(".png")], number, rng)
    return {name: content for name, content in files.items() if name not in lost}


def all_frozen(files, number, rng):
    names = sorted(name for name in files if name.endswith(".png"))
    first = int(rng.integers(max(1, len(names) - int(number))))
    again = names[first + 1 : first + 1 + int(number)]
    return {**files, **dict.fromkeys(again, files[names[first]])}


def on_pixels(change):
    """Damage to every depth image: ``change`` of its values, severity and draws."""

    def apply(files, severity, rng):
        changed = dict(files)
        for name in (name for name in files if name.endswith(".png")):
            content = np.frombuffer(files[name], np.uint8)
            image = cv2.imdecode(content, cv2.IMREAD_UNCHANGED)
            edited = change(image, severity, rng).astype(np.uint16)
            changed[name] = cv2.imencode(".png", edited)[1].tobytes()
        return changed

    return apply


all_lost_pixels = on_pixels(
    lambda x, share, rng: np.where(rng.random(x.shape) < share, 0, x),
)
all_other_unit = on_pixels(
    lambda x, factor, rng: np.where(x * factor < 2**16, x * factor, 0),
)


def retimed(change):
    """Damage to the times of an index: ``change`` of time, share of the rows before, severity."""

    def apply(content, severity, rng):
        lines, rows = lines_of(content)
        for number, i in enumerate(rows):
            stamp, rest = lines[i].split(b" ", 1)
            time = change(float(stamp), number / len(rows), severity)
            lines[i] = b"%.6f %s" % (time, rest)
        return b"".join(lines)

    return apply


clock_offset = retimed(lambda t, share, severity: t + severity)
clock_drift = retimed(lambda t, share, severity: t * (1 + severity))
clock_jump = retimed(lambda t, share, severity: t + severity * (share > 0.5))
