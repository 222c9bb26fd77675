"""What a calibration file holds by key: OpenCV's YAML or XML, plain YAML (as ROS calibrates), plain
JSON and Open3D's JSON.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from itertools import accumulate
from pathlib import Path

import cv2
import yaml

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import read_text

MAX_CHARACTERS = 10**6
MAX_NESTING = 50  # how deep a parser follows differs between versions of Python
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
        values = _opencv(body, file)
    else:
        try:
            if any(
                isinstance(event, yaml.AliasEvent) for event in yaml.parse(body, yaml.SafeLoader)
            ):
                raise RecordingError(
                    "the file refers to parts of itself, which can unfold without bound; write "
                    "the numbers out",
                    file=file,
                )
            values = _only(yaml.safe_load_all(body), file)
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


def is_json(file: Path) -> bool:
    """Whether ``file`` begins as JSON does."""
    return Path(file).read_bytes().lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")


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


def _opencv(body: str, file: Path) -> dict[str, object]:
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
