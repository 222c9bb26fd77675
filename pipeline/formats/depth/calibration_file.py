"""What a calibration file holds by key: OpenCV's YAML or XML, plain YAML (as ROS calibrates), plain
JSON and Open3D's JSON.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import ClassVar

import cv2
import yaml

from pipeline.core.bounds import call_alone, read_whole
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import read_text

MAX_CHARACTERS = 10**5
MAX_NESTING = 50  # how deep a parser follows differs between versions of Python
# a number of a calibration is decimal: YAML 1.1 and OpenCV take 0525 for 341, and YAML 1.1 yes for
# true and 5:25 for 325
WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]*)$")
REAL = re.compile(
    r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))([eE][-+]?[0-9]+)?$|[-+]?\.(nan|inf)$"
)
# where OpenCV's YAML and XML have the numbers of a camera, and what OpenCV makes others of
NAMED = r"(?:[fc][xy]|\w*(?:[wW]idth|[hH]eight))"
LISTS = re.compile(
    rf"\[[^\]]*\]|<data>[^<]*</data>|^[^\S\n]*{NAMED}[^\S\n]*:.*$|<{NAMED}>[^<]*<", re.MULTILINE
)
NO_DECIMAL = re.compile(
    r"(?<![\w.:/+-])([-+]?0[0-9xX][0-9a-fA-F]*|true|false|yes|no|on|off)(?![\w.:/-])", re.IGNORECASE
)
# how OpenCV names the types of a matrix; it would round its numbers to any other
FLOATING = ("d", "f")


def read_values(file: Path) -> Mapping:
    """What the file holds by key, from whole lines alone: in YAML nothing else shows that a number
    was cut.
    """
    text = read_text(file)
    if sum(map(len, text.lines)) > MAX_CHARACTERS:
        raise RecordingError("the file is far larger than any calibration", file=file)
    body = "\n".join(text.lines)
    if _nesting(body + (text.cut or "")) > MAX_NESTING:
        raise RecordingError(
            "lists lie far deeper in one another than in any calibration", file=file
        )
    if is_json(file):
        try:
            values = json.loads("\n".join([*text.lines, text.cut or ""]))
        except (ValueError, RecursionError):
            raise RecordingError(
                "this is no JSON, or it is truncated; export it again", file=file
            ) from None
    elif body.startswith(("%YAML", "<?xml")) or "!!opencv-matrix" in body:
        values = _opencv_alone(body, file)
    else:
        try:
            if any(
                isinstance(event, yaml.AliasEvent) for event in yaml.parse(body, yaml.CSafeLoader)
            ):
                raise RecordingError(
                    "the file refers to parts of itself, which can unfold without bound; write "
                    "the numbers out",
                    file=file,
                )
            values = _only(yaml.load_all(body, _Decimal), file)
        except (yaml.YAMLError, ValueError, RecursionError):
            raise RecordingError(
                "this is no calibration in OpenCV's YAML or XML, YAML or JSON, or it is truncated",
                file=file,
            ) from None
    # Open3D puts the camera beside its pose
    values = values.get("intrinsic", values) if isinstance(values, Mapping) else values
    if not isinstance(values, Mapping):
        raise RecordingError("this is no calibration: it holds no keys; export it again", file=file)
    return values


class _Decimal(yaml.SafeLoader):
    """Plain YAML whose numbers are decimal; every other plain word is text."""

    yaml_implicit_resolvers: ClassVar[dict] = {}


_Decimal.add_implicit_resolver("tag:yaml.org,2002:null", re.compile(r"(~|null|)$"), None)
_Decimal.add_implicit_resolver("tag:yaml.org,2002:int", WHOLE, None)
_Decimal.add_implicit_resolver("tag:yaml.org,2002:float", REAL, None)


def is_json(file: Path) -> bool:
    """Whether ``file`` begins as JSON does."""
    return read_whole(file).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")


def _only(documents: Iterable[object], file: Path) -> object:
    """The one document, or message that ROS printed, that the file holds, however often."""
    held = [document for document in documents if document is not None]
    plain = [
        {key: value for key, value in one.items() if key != "header"}
        if isinstance(one, Mapping)
        else one
        for one in held
    ]
    if any(other != plain[0] for other in plain[1:]):
        raise RecordingError(
            f"the file holds {len(held)} calibrations, not all of them equal; keep one", file=file
        )
    return plain[0] if plain else None


def _nesting(body: str) -> int:
    """How many brackets are open at once at most."""
    return max(
        accumulate((mark in "[{") - (mark in "]}") for mark in body if mark in "[]{}"), default=0
    )


@lru_cache(maxsize=1)  # the takes of a camera share its file
def _opencv_alone(body: str, file: Path) -> Mapping[str, object]:
    """By OpenCV in a process of its own: some that are damaged end the one that reads them."""
    return call_alone(_opencv, body, file, file=file)


def _opencv(body: str, file: Path) -> dict[str, object]:
    for held in LISTS.findall(body):
        if wrong := NO_DECIMAL.search(held):
            raise RecordingError(
                f"OpenCV reads {wrong[0]} as no decimal number: write it as one, without a zero "
                "before it",
                file=file,
            )
    values = {}
    try:
        storage = cv2.FileStorage(body, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        for key in storage.root().keys():
            node = storage.getNode(key)
            if node.isInt() or node.isReal():
                values[key] = node.real()
            elif node.isString():
                values[key] = node.string()
            elif node.isMap() or node.isSeq():
                stored = node.getNode("dt").string() if node.isMap() else ""
                if stored and stored not in FLOATING:
                    values[key] = f"a matrix of type {stored}"
                    continue
                if stored and not _is_whole(node):
                    values[key] = None
                    continue
                try:
                    values[key] = node.mat()
                except cv2.error:
                    values[key] = None  # a structure of the tool's own
        storage.release()
    except (cv2.error, SystemError):  # the constructor of FileStorage fails with the latter
        raise RecordingError(
            "this is no calibration in OpenCV's YAML or XML, or it is truncated; export it again",
            file=file,
        ) from None
    return values


def _is_whole(matrix: cv2.FileNode) -> bool:
    """Whether as many numbers stand there as the matrix has rows times columns; OpenCV would read
    on behind its end.
    """
    rows, columns, data = (matrix.getNode(name) for name in ("rows", "cols", "data"))
    sized = rows.isInt() and columns.isInt() and data.isSeq()
    return sized and rows.real() * columns.real() == data.size() > 0
