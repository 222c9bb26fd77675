"""Intrinsics of a depth camera, as calibration tools write them: OpenCV's YAML or XML, plain YAML
(as ROS calibrates), plain JSON and Open3D's JSON.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
import yaml

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import read_text
from pipeline.formats.format import Format, Head, Kind, Stated, read_alone

MATRIX = ("cameraMatrix", "camera_matrix", "Camera_Matrix", "CameraMatrix")
MATRIX += ("K", "k", "intrinsic_matrix")
DISTORTION = ("distortionCoefficients", "distortion_coefficients", "Distortion_Coefficients")
DISTORTION += ("DistCoeffs", "distCoeffs", "dist_coeffs", "D", "d")
BENT = re.compile(r"(?i)dist.*|.*coeff.*|[kp]1")  # a key that may be of distortion
# distortion models, as tools name them, of OpenCV's coefficients
MODELS = ("plumb_bob", "radtan", "rational_polynomial", "none")
FOCAL = ("fx", "fy", "cx", "cy")
SIZE = (("width", "height"), ("image_width", "image_height"), ("image_Width", "image_Height"))
NARROWEST = 100  # focal length over the longer side: a view of half a degree
COEFFICIENTS = (0, 4, 5, 8, 12, 14)  # the numbers of coefficients that OpenCV's model has
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
NO_CALIBRATION = "this is no calibration in OpenCV's YAML or XML, YAML or JSON, or it is truncated"


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole camera of ``width`` × ``height`` pixels: focal lengths and principal point in px,
    OpenCV's distortion k1, k2, p1, p2, k3 …
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distortion: tuple[float, ...] = ()


def pinhole(
    matrix: np.ndarray, distortion: np.ndarray, *, width: int, height: int, **evidence: object
) -> Intrinsics:
    """Return the camera ``matrix`` (3, 3) and OpenCV's ``distortion`` (k,) of an image of ``width``
    × ``height`` pixels.

    Raises RecordingError (with ``evidence``) for a matrix that is none, a coefficient too many, a
    focal length of no camera and a principal point outside the image.
    """
    (fx, skew, cx), (low, fy, cy), bottom = matrix.tolist()
    finite, rest = np.isfinite(matrix).all(), (skew, low, *bottom)
    message = ""
    if not finite or min(fx, fy) <= 0 or rest != (0, 0, 0, 0, 1):
        message = "the camera matrix is not [fx 0 cx; 0 fy cy; 0 0 1]"
    elif not np.isfinite(distortion).all() or distortion.size not in COEFFICIENTS:
        message = f"{distortion.size} distortion coefficients, or one that is not finite; OpenCV's "
        message += f"model has {COEFFICIENTS}"
    elif max(fx, fy) > NARROWEST * max(width, height):
        message = f"a focal length of {max(fx, fy):.6g} px is of no camera of {width} × {height}"
    elif not (0 < cx < width and 0 < cy < height):
        message = f"the principal point {cx:.1f}, {cy:.1f} is outside {width} × {height} pixels"
    if message:
        raise RecordingError(message, **evidence)
    return Intrinsics(fx, fy, cx, cy, width, height, tuple(distortion.ravel().tolist()))


def require_size(
    stated: tuple[object, object], width: int, height: int, **evidence: object
) -> None:
    """Raise RecordingError where a calibration's ``stated`` size is not ``width`` × ``height``."""
    if stated != (width, height):
        message = f"calibrated at {stated[0]} × {stated[1]} pixels, not {width} × {height}"
        raise RecordingError(message, **evidence)


def require_model(model: object, distortion: np.ndarray, **evidence: object) -> None:
    """Raise RecordingError where coefficients are of a ``model`` that is not OpenCV's."""
    if distortion.any() and model not in (None, "", *MODELS):
        message = f"the distortion {model!r} is none of {', '.join(MODELS)}; calibrate with one of "
        raise RecordingError(f"{message}these", key="distortion_model", **evidence)


def read_intrinsics(
    file: Path, *, width: int, height: int, matrix: str | None = None, distortion: str | None = None
) -> Intrinsics:
    """Return the intrinsics of a camera of ``width`` × ``height`` pixels; a size that the file
    states must be that.

    ``matrix`` and ``distortion`` name the keys where they are not the usual ones, or where the file
    holds several. Focal lengths and principal point may stand as fx, fy, cx, cy instead of a
    matrix. Only JSON may leave the distortion out, for a camera without. Of the messages of a
    CameraInfo that ROS prints, all must be equal but for their headers. Raises RecordingError for a
    file that cannot be read as any of the formats, a key that is not there or not the only one
    (naming those that are), values that are no camera's, a distortion model that is not OpenCV's,
    and another size.
    """
    values, is_json = _values(file)
    for wide, high in SIZE:
        stated = values.get(wide, width), values.get(high, height)
        require_size(stated, width, height, file=file, key=wide)
    there = f"the file has {', '.join(map(str, values))}"

    def choose(chosen: str | None, usual: tuple[str, ...], what: str) -> str | None:
        if chosen is not None and chosen not in values:
            raise RecordingError(f"no {what} {chosen!r}; {there}", file=file)
        present = [chosen] if chosen else [name for name in usual if name in values]
        if len(present) > 1:
            message = f"{' and '.join(present)} could each be the {what}; choose one by option"
            raise RecordingError(message, file=file)
        return present[0] if present else None

    key = choose(matrix, MATRIX, "camera matrix")
    if key is not None:
        camera = _numbers(values[key], file, key)
        if camera.size != 9:
            message = f"there is no 3 × 3 {key}; export the calibration again"
            raise RecordingError(message, file=file, key=key)
        columns = key == "intrinsic_matrix" and camera.ndim == 1  # as Open3D writes it
        camera = camera.reshape(3, 3).T if columns else camera.reshape(3, 3)
    elif {*FOCAL} <= {*values}:
        four = [_numbers(values[name], file, name) for name in FOCAL]
        if any(number.size != 1 for number in four):
            raise RecordingError("fx, fy, cx and cy are not four numbers", file=file)
        fx, fy, cx, cy = (number.item() for number in four)
        camera = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    else:
        message = f"no camera matrix under a usual name; {there}: name its key in camera_matrix"
        raise RecordingError(message, file=file)
    bent = choose(distortion, DISTORTION, "distortion")
    if bent is None and (not is_json or any(BENT.fullmatch(name) for name in values)):
        message = f"there are no distortionCoefficients; {there}: name their key in distortion, or "
        raise RecordingError(f"{message}write zeros where there is no distortion", file=file)
    coefficients = np.zeros(0) if bent is None else _numbers(values[bent], file, bent).ravel()
    require_model(values.get("distortion_model"), coefficients, file=file)
    return pinhole(camera, coefficients, width=width, height=height, file=file, key=key)


def _numbers(value: object, file: Path, key: str) -> np.ndarray:
    # ROS writes a matrix as rows, cols, data
    value = value.get("data", value) if isinstance(value, Mapping) else value
    # NumPy would make numbers of words and of true
    words = [str(each) for each in _flat(value) if isinstance(each, str | bool)]
    try:
        if words:
            raise TypeError
        return np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        message = f"{key} holds no decimal numbers{f', but {words[0]}' if words else ''}"
        raise RecordingError(message, file=file, key=key) from None


def _flat(value: object) -> Iterator[object]:
    if isinstance(value, list):
        for each in value:
            yield from _flat(each)
    else:
        yield value


def _values(file: Path) -> tuple[Mapping, bool]:
    """Return the file's values by key, and whether it is JSON; from whole lines alone, since in
    YAML nothing else shows that a number was cut.
    """
    text = read_text(file)

    def fault(message: str) -> RecordingError:
        return RecordingError(f"{message}; export it again", file=file)

    if sum(map(len, text.lines)) > MAX_CHARACTERS:
        raise fault("the file is far larger than any calibration")
    body = "\n".join(text.lines)
    whole = "\n".join([*text.lines, text.cut or ""])
    brackets = ((mark in "[{") - (mark in "]}") for mark in whole if mark in "[]{}")
    if max(accumulate(brackets), default=0) > MAX_NESTING:
        raise fault("lists lie far deeper in one another than in any calibration")
    is_json = whole.lstrip().startswith("{")
    try:
        if is_json:
            values = json.loads(whole)
        elif body.startswith(("%YAML", "<?xml")) or "!!opencv-matrix" in body:
            values = _opencv_alone(body, file)
        else:
            events = yaml.parse(body, yaml.CSafeLoader)
            if any(isinstance(event, yaml.AliasEvent) for event in events):
                raise fault("the file refers to parts of itself, which can unfold without bound")
            values = _only(yaml.load_all(body, _Decimal), fault)
    except (yaml.YAMLError, ValueError, RecursionError):
        raise fault(NO_CALIBRATION) from None
    # Open3D puts the camera beside its pose
    values = values.get("intrinsic", values) if isinstance(values, Mapping) else values
    if not isinstance(values, Mapping):
        raise fault("this is no calibration: it holds no keys")
    return values, is_json


class _Decimal(yaml.SafeLoader):
    """Plain YAML whose numbers are decimal; every other plain word is text."""

    yaml_implicit_resolvers: ClassVar[dict] = {}


_Decimal.add_implicit_resolver("tag:yaml.org,2002:null", re.compile(r"(~|null|)$"), None)
_Decimal.add_implicit_resolver("tag:yaml.org,2002:int", WHOLE, None)
_Decimal.add_implicit_resolver("tag:yaml.org,2002:float", REAL, None)


def _only(documents: Iterable[object], fault: Callable[[str], RecordingError]) -> object:
    """Return the one document, or message that ROS printed, that the file holds, however often."""
    held = [document for document in documents if document is not None]
    plain = [
        {key: value for key, value in one.items() if key != "header"}
        if isinstance(one, Mapping)
        else one
        for one in held
    ]
    if any(other != plain[0] for other in plain[1:]):
        raise fault(f"the file holds {len(held)} calibrations, not all of them equal; keep one")
    return plain[0] if plain else None


@lru_cache(maxsize=1)  # the takes of a camera share its file
def _opencv_alone(body: str, file: Path) -> Mapping[str, object]:
    """Return the values by OpenCV in a process of its own, which some damaged files end."""
    return read_alone(_opencv, body, file, file=file, advice="export it again")


def _opencv(body: str, file: Path) -> dict[str, object]:
    for held in LISTS.findall(body):
        if wrong := NO_DECIMAL.search(held):
            message = f"OpenCV reads {wrong[0]} as no decimal number: write it as one, without a "
            raise RecordingError(f"{message}zero before it", file=file)
    values = {}
    try:
        storage = cv2.FileStorage(body, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        for key in storage.root().keys():
            values[key] = _node(storage.getNode(key))
        storage.release()
    except (cv2.error, SystemError):  # the constructor of FileStorage fails with the latter
        raise RecordingError(f"{NO_CALIBRATION}; export it again", file=file) from None
    return values


def _node(node: cv2.FileNode) -> object:
    """Return the content of a node, None of a structure of the tool's own."""
    if node.isInt() or node.isReal():
        return node.real()
    if node.isString():
        return node.string()
    rows, columns, data, stored = (node.getNode(name) for name in ("rows", "cols", "data", "dt"))
    if node.isMap() and (kind := stored.string()):
        # OpenCV would round numbers to any other type, and read on behind the end of a short list
        sized = rows.isInt() and columns.isInt() and data.isSeq()
        if kind not in ("d", "f"):
            return f"a matrix of type {kind}"
        if not sized or not rows.real() * columns.real() == data.size() > 0:
            return None
    try:
        return node.mat()
    except cv2.error:
        return None


def write_intrinsics(file: Path, intrinsics: Intrinsics) -> None:
    """Write ``cameraMatrix`` and ``distortionCoefficients`` (zeros where there are none) as
    OpenCV's YAML; numbers read back exactly.
    """
    matrix = np.array(
        [[intrinsics.fx, 0, intrinsics.cx], [0, intrinsics.fy, intrinsics.cy], [0, 0, 1]]
    )
    storage = cv2.FileStorage("intrinsics.yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("cameraMatrix", matrix)
    storage.write("distortionCoefficients", np.array([intrinsics.distortion or (0.0,) * 5]))
    # "%YAML:1.0" is how OpenCV 2 to 4 head the calibrations of depth cameras; version 5 writes
    # another head, and reads both
    body = storage.releaseAndGetString().partition("\n")[2]
    Path(file).write_bytes(f"%YAML:1.0\n{body}".encode())


CALIBRATED = re.compile(
    rf'(?:^|[{{,])[^\S\n]*["<]?(?:{"|".join((*MATRIX, *DISTORTION))})\b"?\s*[:>\s]', re.MULTILINE
)


def _begins(head: Head) -> bool:
    if head.suffix not in (".yaml", ".yml", ".json", ".xml"):
        return False
    text = head.text or ""
    return CALIBRATED.search(text) is not None or all(
        re.search(rf'(?m)(?:^|[{{,])[^\S\n]*"?{name}"?\s*:', text) for name in FOCAL
    )


def _states(file: Path) -> Stated:
    """Return width and height in px as ``facts``, where the file states both."""
    values, _ = _values(file)
    for size in ([values.get(wide), values.get(high)] for wide, high in SIZE):
        if all(type(pixels) in (int, float) and 0 < pixels < 2**31 for pixels in size):
            return Stated(facts={"width": int(size[0]), "height": int(size[1])})
    return Stated()


FORMAT = Format("camera intrinsics", Kind.INTRINSICS, read_intrinsics, _begins, _states)
