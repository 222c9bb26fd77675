"""Intrinsics of a depth camera: OpenCV's YAML or XML, plain YAML (as ROS calibrates), plain JSON and Open3D's JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

import cv2
import numpy as np
import yaml

from pipeline.errors import RecordingError
from pipeline.instruments.delimited import read_text

# how calibration tools name the 3 × 3 matrix, the coefficients and the size; Open3D's intrinsic_matrix runs down the columns
MATRIX = ("cameraMatrix", "camera_matrix", "Camera_Matrix", "CameraMatrix", "K", "k", "intrinsic_matrix")
DISTORTION = (
    "distortionCoefficients",
    "distortion_coefficients",
    "Distortion_Coefficients",
    "DistCoeffs",
    "distCoeffs",
    "dist_coeffs",
    "D",
    "d",
)
BENT = re.compile(r"(?i)dist.*|.*coeff.*|[kp]1")  # a key that may be of distortion
MODELS = ("plumb_bob", "radtan", "rational_polynomial", "none")  # distortion models, as tools name them, of OpenCV's coefficients
FOCAL = ("fx", "fy", "cx", "cy")
SIZE = (("width", "height"), ("image_width", "image_height"), ("image_Width", "image_Height"))
MAX_CHARACTERS = 10**6
MAX_NESTING = 50  # how deep a parser follows differs between versions of Python
FLOATING = ("d", "f")  # how OpenCV names the types of a matrix; it would round its numbers to any other
COEFFICIENTS = (0, 4, 5, 8, 12, 14)  # the numbers of coefficients that OpenCV's model has


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole camera of ``width`` × ``height`` pixels: focal lengths and principal point in px, OpenCV's distortion k1, k2, p1, p2, k3 …"""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distortion: tuple[float, ...] = ()


def pinhole(matrix: np.ndarray, distortion: np.ndarray, *, width: int, height: int, **evidence: object) -> Intrinsics:
    """Intrinsics of the camera ``matrix`` (3, 3) and OpenCV's ``distortion`` (k,) of an image of ``width`` × ``height`` pixels.

    Raises RecordingError (with ``evidence``) for a matrix that is none, a coefficient too many and a principal point outside the image.
    """
    (fx, skew, cx), (low, fy, cy), bottom = matrix.tolist()
    if not np.isfinite(matrix).all() or fx <= 0 or fy <= 0 or (skew, low, *bottom) != (0, 0, 0, 0, 1):
        raise RecordingError("the camera matrix is not [fx 0 cx; 0 fy cy; 0 0 1]", **evidence)
    if not np.isfinite(distortion).all() or distortion.size not in COEFFICIENTS:
        raise RecordingError(
            f"{distortion.size} distortion coefficients, or one that is not finite; OpenCV's model has {COEFFICIENTS}", **evidence
        )
    if not (0 < cx < width and 0 < cy < height):
        raise RecordingError(f"the principal point {cx:.1f}, {cy:.1f} is outside {width} × {height} pixels", **evidence)
    return Intrinsics(fx, fy, cx, cy, width, height, tuple(distortion.ravel().tolist()))


def read_intrinsics(file: Path, *, width: int, height: int, matrix: str | None = None, distortion: str | None = None) -> Intrinsics:
    """Intrinsics of a camera of ``width`` × ``height`` pixels; a size that the file states must be that.

    ``matrix`` and ``distortion`` name the keys where they are not the usual ones, or where the file holds several. Focal lengths and
    principal point may stand as fx, fy, cx, cy instead of a matrix. Only JSON may leave the distortion out, for a camera without. Of
    the messages of a CameraInfo that ROS prints, all must be equal but for their headers. Raises RecordingError for a file that cannot be
    read as any of the formats, a key that is not there or not the only one (naming those that are), values that are no camera's, a
    distortion model that is not OpenCV's, and another size.
    """
    values = _values(file)
    for wide, high in SIZE:
        stated = (values.get(wide, width), values.get(high, height))
        if stated != (width, height):
            raise RecordingError(f"calibrated at {stated[0]} × {stated[1]} pixels, not {width} × {height}", file=file, key=wide)
    key = _key(values, matrix, MATRIX, "camera matrix", file)
    if key is not None:
        found = _numbers(values[key], file, key)
        if found.size != 9:
            raise RecordingError(f"there is no 3 × 3 {key}; export the calibration again", file=file, key=key)
        camera = found.reshape(3, 3).T if key == "intrinsic_matrix" and found.ndim == 1 else found.reshape(3, 3)
    elif set(FOCAL) <= set(values):
        four = [_numbers(values[name], file, name) for name in FOCAL]
        if any(number.size != 1 for number in four):
            raise RecordingError("fx, fy, cx and cy are not four numbers", file=file)
        fx, fy, cx, cy = (number.item() for number in four)
        camera = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    else:
        raise RecordingError(
            f"no camera matrix under a usual name; the file has {', '.join(map(str, values))}: name its key in camera_matrix", file=file
        )
    bent = _key(values, distortion, DISTORTION, "distortion", file)
    if bent is None and (not _is_json(file) or any(BENT.fullmatch(name) for name in values)):
        raise RecordingError(
            f"there are no distortionCoefficients; the file has {', '.join(map(str, values))}: name their key in distortion, "
            "or write zeros where there is no distortion",
            file=file,
        )
    coefficients = np.zeros(0) if bent is None else _numbers(values[bent], file, bent).ravel()
    model = values.get("distortion_model")
    if coefficients.any() and model not in (None, "", *MODELS):
        raise RecordingError(
            f"the distortion {model!r} is none of {', '.join(MODELS)}; calibrate with one of these", file=file, key="distortion_model"
        )
    return pinhole(camera, coefficients, width=width, height=height, file=file, key=key)


def stated_size(file: Path) -> tuple[int, int] | None:
    """Width and height in px that the calibration in ``file`` states, None where it does not; RecordingError as in read_intrinsics."""
    values = _values(file)
    stated = [(values[wide], values[high]) for wide, high in SIZE if wide in values and high in values]
    whole = [size for size in stated if all(isinstance(pixels, int | float) and 0 < pixels < 2**31 for pixels in size)]
    return (int(whole[0][0]), int(whole[0][1])) if whole else None


def _is_json(file: Path) -> bool:
    return Path(file).read_bytes().lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")


def _key(values: Mapping, chosen: str | None, usual: tuple[str, ...], what: str, file: Path) -> str | None:
    if chosen is not None:
        if chosen not in values:
            raise RecordingError(f"no {what} {chosen!r}; the file has {', '.join(map(str, values))}", file=file)
        return chosen
    found = [name for name in usual if name in values]
    if len(found) > 1:
        raise RecordingError(f"{' and '.join(found)} could each be the {what}; choose one by option", file=file)
    return found[0] if found else None


def _numbers(value: object, file: Path, key: str) -> np.ndarray:
    # ROS writes a matrix as rows, cols, data
    value = value.get("data", value) if isinstance(value, Mapping) else value
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        found = f", but {value}" if isinstance(value, str) else ""
        raise RecordingError(f"{key} holds no floating-point numbers{found}", file=file, key=key) from None


def _values(file: Path) -> Mapping:
    """What the file holds by key, from whole lines alone: in YAML nothing else shows that a number was cut."""
    text = read_text(file)
    if sum(map(len, text.lines)) > MAX_CHARACTERS:
        raise RecordingError("the file is far larger than any calibration", file=file)
    body = "\n".join(text.lines)
    if _nesting(body + (text.cut or "")) > MAX_NESTING:
        raise RecordingError("lists lie far deeper in one another than in any calibration", file=file)
    if _is_json(file):
        try:
            values = json.loads("\n".join([*text.lines, text.cut or ""]))
        except (ValueError, RecursionError):
            raise RecordingError("this is no JSON, or it is truncated; export it again", file=file) from None
    elif body.startswith(("%YAML", "<?xml")) or "!!opencv-matrix" in body:
        values = _opencv(body, file)
    else:
        try:
            if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(body, yaml.SafeLoader)):
                raise RecordingError("the file refers to parts of itself, which can unfold without bound; write the numbers out", file=file)
            values = _only(yaml.safe_load_all(body), file)
        except (yaml.YAMLError, ValueError, RecursionError):
            raise RecordingError("this is no calibration in OpenCV's YAML or XML, YAML or JSON, or it is truncated", file=file) from None
    # Open3D puts the camera beside its pose
    values = values.get("intrinsic", values) if isinstance(values, Mapping) else values
    if not isinstance(values, Mapping):
        raise RecordingError("this is no calibration: it holds no keys; export it again", file=file)
    return values


def _only(documents: Iterable[object], file: Path) -> object:
    """The one document, or message that ROS printed, that the file holds, however often."""
    held = [document for document in documents if document is not None]
    plain = [{key: value for key, value in one.items() if key != "header"} if isinstance(one, Mapping) else one for one in held]
    if any(other != plain[0] for other in plain[1:]):
        raise RecordingError(f"the file holds {len(held)} calibrations, not all of them equal; keep one", file=file)
    return plain[0] if plain else None


def _nesting(body: str) -> int:
    """How many brackets are open at once at most."""
    return max(accumulate((mark in "[{") - (mark in "]}") for mark in body if mark in "[]{}"), default=0)


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
        raise RecordingError("this is no calibration in OpenCV's YAML or XML, or it is truncated; export it again", file=file) from None
    return values


def write_intrinsics(file: Path, intrinsics: Intrinsics) -> None:
    """Write ``cameraMatrix`` and ``distortionCoefficients`` (zeros where there are none) as OpenCV's YAML; numbers read back exactly."""
    matrix = np.array([[intrinsics.fx, 0, intrinsics.cx], [0, intrinsics.fy, intrinsics.cy], [0, 0, 1]])
    storage = cv2.FileStorage("intrinsics.yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("cameraMatrix", matrix)
    storage.write("distortionCoefficients", np.array([intrinsics.distortion or (0.0,) * 5]))
    # "%YAML:1.0" is how OpenCV 2 to 4 head the calibrations of depth cameras; version 5 writes another head, and reads both
    body = storage.releaseAndGetString().partition("\n")[2]
    Path(file).write_bytes(f"%YAML:1.0\n{body}".encode())
