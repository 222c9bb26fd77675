"""Why a file is no recording that is known, and what to do about it."""

from __future__ import annotations

import re
from pathlib import Path

from pipeline.formats.delimited import foreign
from pipeline.formats.format import Head
from pipeline.tools.inspect.finding import UNKNOWN, Finding

# how files begin that hold recordings in a form that nothing here reads
MARKS = {
    b"\x89HDF": "an HDF5 file: save its arrays as CSV or .npz",
    b"\x93NUMPY": "a single array: save it with its times in one .npz",
    b"PK": "an archive without arrays of NumPy first: unpack it, or export a spreadsheet as CSV",
    b"\x1f\x8b": "a packed file: unpack it",
}
MANY = 3  # cells of a line that looks like labels


def unrecognised(file: Path) -> Finding:
    """Return the account of a file of no format that is read: a known one by its name and with what
    to export instead, another with the reason and what to do in its fact ``reason``.
    """
    head = Head.read(file)
    if head.text is not None and (known := foreign(head.text)):
        name, advice = known
        return Finding(file, name, UNKNOWN, stops=[f"{name} is not read: {advice}"])
    return Finding(file, UNKNOWN, facts={"reason": _reason(head)})


def _reason(head: Head) -> str:
    for mark, reason in MARKS.items():
        if head.content.startswith(mark):
            return reason
    if head.text is None:
        return "binary data of no known format: export as in pipeline/formats/README.md"
    labels = [line for line in head.lines if len(re.split(r"[,;\t]", line)) >= MANY]
    if head.suffix in (".csv", ".tsv") or (labels and len(labels) == len(head.lines)):
        return "labels or words without rows of numbers below: record or export it again"
    return "text without a table of numbers"
