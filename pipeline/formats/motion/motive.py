"""OptiTrack Motive takes as CSV: read in either of their grammars, written as Motive 1.23 writes
them.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import cells_of, read_text
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.motion.motive_columns import BODY, KEYS, RATES, RAW, read_columns
from pipeline.formats.motion.motive_rows import ROW_TYPES, read_rows
from pipeline.formats.motion.take import MotionTake


def read_motive(file: Path, unit: str | None = None) -> MotionTake:
    """Return the take in ``file``, in m and s; ``unit`` (m, cm or mm) is that of its lengths where
    it does not say it (versions 1.0 and 1.1 never do).

    A raw marker is preferred to the rigid body's solved marker of the same name, which is drawn
    where the body model expects it, occluded or not. Markers or bodies of one name but several IDs
    are each ``name [ID]``. Missing samples are blank, NAN or exactly zero in all coordinates. Euler
    angles are degrees about the moving axes. A rate that the file does not state is that of its
    printed times, and one that contradicts them is refused. Before version 1.2, markers of no name
    are packed into as many ``Unlabeled`` ones as are ever seen at once.

    ``counts`` besides those of the :class:`TakeBuilder`: ``blank_rows``, ``cut_rows`` (a last row
    without line end, dropped), ``repeated_rows`` (to the letter); by columns, ``solved_replaced``
    and ``solved_only`` markers, ``unused_columns`` and ``skipped_bones``; by rows, ``stray_ids``,
    ``stray_samples`` and ``lacking_body_rows`` (a body's own row of a frame).

    Raises RecordingError, with the line where there is one, for a file without unit, rate, marker
    and body, for a unit other than the asked one, and for truncated, malformed or disordered rows.
    """
    text = read_text(file)
    first = cells_of(text.lines[0], ",", file=file, number=1)[:1] if text.lines else []
    if first == ["Format Version"]:
        return read_columns(text, file, unit)
    if first and first[0] in ROW_TYPES:
        return read_rows(text, file, unit)
    message = "no Motive export with a header: the file starts with neither 'Format Version' nor a "
    message += "row type"
    if mark := re.match(r"(?:Format Version|comment|info)([;\t])", "".join(first)):
        separator = "semicolons" if mark[1] == ";" else "tabs"
        message = f"cells are separated by {separator}: another program saved the take; export it "
        message += "with commas"
    raise RecordingError(message, file=file, line=1)


def write_motive(file: Path, take: MotionTake, *, start: str) -> None:
    """Write ``take`` as Motive's 1.23 export in metres: six decimals, CRLF, a missing sample as
    blank cells, rigid bodies before markers; ``start`` is the capture's start as Motive prints it,
    such as ``2024-03-05 10.15.00.000 AM``. ``take.version`` and ``take.counts`` are not written.
    """
    values = dict.fromkeys(KEYS, "") | dict.fromkeys(RATES, f"{take.rate:.6f}")
    values |= {"Format Version": "1.23", "Take Name": _quoted(take.name)}
    values |= {"Rotation Type": "Quaternion", "Length Units": "Meters"}
    values |= {"Coordinate Space": "Global", "Capture Start Time": start}
    values["Total Frames in Take"] = str(int(take.frame[-1] - take.frame[0]) + 1)
    values["Total Exported Frames"] = str(len(take.frame))
    del values["Capture Start Frame"]  # 1.23 writes it for some takes only
    pose = [("Rotation", axis) for axis in "XYZW"] + [("Position", axis) for axis in "XYZ"]
    labels = [(BODY, name, *label) for name in take.bodies for label in pose]
    labels += [(RAW, name, "Position", axis) for name in take.markers for axis in "XYZ"]
    assets = dict.fromkeys(label[:2] for label in labels)
    identities = {key: f'"{number:X}"' for number, key in enumerate(assets, start=0xA10)}
    header = [
        ",".join(f"{key},{value}" for key, value in values.items()),
        "",
        ",".join([",Type", *(kind for kind, *_ in labels)]),
        ",".join([",Name", *(_quoted(name) for _, name, *_ in labels)]),
        ",".join([",ID", *(identities[label[:2]] for label in labels)]),
        ",".join([",", *(quantity for *_, quantity, _ in labels)]),
        ",".join(["Frame,Time (Seconds)", *(axis for *_, axis in labels)]),
    ]
    blocks = [block for body in take.bodies.values() for block in (body.quaternion, body.position)]
    table = np.column_stack([take.frame, take.frame / take.rate, *blocks, *take.markers.values()])
    row = ",".join(["%d", *["%.6f"] * (table.shape[1] - 1)]) + "\r\n"
    rows = (row * len(table) % tuple(table.ravel().tolist())).replace("nan", "")
    Path(file).write_bytes(("\r\n".join(header) + "\r\n" + rows).encode())


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if any(mark in name for mark in ',"') else name


def _begins(head: Head) -> bool:
    # another program may have saved it with other separators, which the reader then says
    lines = [re.split(r"[,;\t]", line) for line in head.lines[:2]]
    first = lines[0][0].strip().strip('"') if lines else ""
    return first == "Format Version" or (first in ROW_TYPES and max(map(len, lines)) > 1)


FORMAT = Format("Motive CSV", Kind.MOTION, read_motive, _begins)
