"""Intrinsics of a depth camera, as calibration tools write them: OpenCV's YAML or XML, plain YAML
(as ROS calibrates), plain JSON, that of Open3D and of RealSense.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import yaml

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import read_text
from pipeline.formats.format import Format, Head, Kind, read_alone

MATRIX = ("cameraMatrix", "camera_matrix", "Camera_Matrix", "CameraMatrix")
MATRIX += ("K", "k", "intrinsic_matrix")
DISTORTION = ("distortionCoefficients", "distortion_coefficients", "Distortion_Coefficients")
DISTORTION += ("DistCoeffs", "distCoeffs", "dist_coeffs", "D", "d")
BENT = re.compile(r"(?i)dist.*|.*coeff.*|[kp]1")  # a key that may be of distortion
# distortion models, as tools name them, of OpenCV's coefficients
MODELS = ("plumb_bob", "radtan", "rational_polynomial", "distortion.brown_conrady", "none")
# names of RealSense: names of this module
REALSENSE = {"ppx": "cx", "ppy": "cy", "coeffs": "D", "model": "distortion_model"}
FOCAL = ("fx", "fy", "cx", "cy")
SIZE = (("width", "height"), ("image_width", "image_height"), ("image_Width", "image_Height"))
ANY_SIZE = (10**6, 10**6)  # px, holds every principal point
NARROWEST = 100  # focal length over the longer side: a view of half a degree
COEFFICIENTS = (0, 4, 5, 8, 12, 14)  # the numbers of coefficients that OpenCV's model has
# a number of a calibration is decimal: YAML 1.1 takes 0525 for 341, yes for true, 5:25 for 325
WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]*)$")
REAL = re.compile(
    r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))([eE][-+]?[0-9]+)?$|[-+]?\.(nan|inf)$"
)
NO_CALIBRATION = "this is no calibration in OpenCV's YAML or XML, YAML or JSON, or it is truncated"
# also of calibrations in another form, which the reader refuses by their keys
CALIBRATED = re.compile(
    rf'(?:^|[{{,])[^\S\n]*["<]?(?:{"|".join((*MATRIX, *DISTORTION, "ppx"))})\b"?\s*[:>\s]'
    r'|"Intrinsics"|^\s+intrinsics: \[',
    re.MULTILINE,
)


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole camera, in px; OpenCV's distortion k1, k2, p1, p2, k3 …"""

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
    """Return the camera of ``matrix`` (3, 3) and OpenCV's ``distortion`` (k,); RecordingError (with
    ``evidence``) for values of no camera, or of none of ``width`` × ``height`` pixels.
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
    file: Path,
    *,
    width: int | None = None,
    height: int | None = None,
    matrix: str | None = None,
    distortion: str | None = None,
) -> Intrinsics:
    """Return the intrinsics of a camera of ``width`` × ``height`` pixels; a size that the file
    states must be that. Without one it is the file's, else ANY_SIZE.

    ``matrix`` and ``distortion`` name the keys where they are not the usual ones, or where the file
    holds several. Only JSON may leave the distortion out, for a camera without. Of the messages of
    a CameraInfo that ROS prints, all must be equal but for their headers. Raises RecordingError for
    a file of none of the formats, a key that is not there or not the only one (naming those that
    are), values that are no camera's, a distortion model that is not OpenCV's, and another size.
    """
    # a library may end on damaged text, or take any time
    values, is_json = read_alone(_values, Path(file), file=file, advice="export it again")
    for names in SIZE:  # where it is not given, it is the file's
        stated = [values.get(name) for name in names]
        width, height = (a or b for a, b in zip((width, height), stated, strict=True))
    width, height = width or ANY_SIZE[0], height or ANY_SIZE[1]
    for wide, high in SIZE:
        stated = values.get(wide, width), values.get(high, height)
        require_size(stated, width, height, file=file)
    there = f"the file has {', '.join(map(str, values))}"

    def choose(chosen: str | None, usual: tuple[str, ...], what: str) -> str | None:
        present = [name for name in ((chosen,) if chosen else usual) if name in values]
        if chosen and not present:
            raise RecordingError(f"no {what} {chosen!r}; {there}", file=file)
        if len(present) > 1:
            message = f"{' and '.join(present)} could each be the {what}; choose one by option"
            raise RecordingError(message, file=file)
        return present[0] if present else None

    key = choose(matrix, MATRIX, "camera matrix")
    bent = choose(distortion, DISTORTION, "distortion")
    if key is not None:
        camera = _numbers(values[key], 9, file, key)
        columns = key == "intrinsic_matrix" and camera.ndim == 1  # as Open3D writes it
        camera = camera.reshape(3, 3).T if columns else camera.reshape(3, 3)
    elif {*FOCAL} <= {*values}:
        fx, fy, cx, cy = (_numbers(values[name], 1, file, name).item() for name in FOCAL)
        camera = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    else:
        message = f"no camera matrix under a usual name, nor fx, fy, cx, cy; {there}: name its key "
        message += "in camera_matrix, or write these four outside of any other key"
        raise RecordingError(message, file=file)
    if bent is None and (not is_json or any(BENT.fullmatch(name) for name in values)):
        message = f"there are no distortionCoefficients; {there}: name their key in distortion, or "
        raise RecordingError(f"{message}write zeros where there is no distortion", file=file)
    coefficients = np.zeros(0) if bent is None else _numbers(values[bent], None, file, bent).ravel()
    require_model(values.get("distortion_model"), coefficients, file=file)
    return pinhole(camera, coefficients, width=width, height=height, file=file, key=key)


def _numbers(value: object, count: int | None, file: Path, key: str) -> np.ndarray:
    """Return the numbers under ``key``, ``count`` in all; a matrix may be rows, cols and data."""
    wanted = {count} - {None}
    if isinstance(value, Mapping):
        shape = [value.get(name) for name in ("rows", "cols")]
        value = value.get("data")
        wanted |= {shape[0] * shape[1]} if all(type(n) is int for n in shape) else set()
    numbers = np.array(0)
    with suppress(ValueError):  # lists of other lengths
        numbers = np.array(value)
    # words and true are no numbers, though NumPy would make some of them
    if numbers.dtype.kind not in "fiu" or (numbers.ndim == 0) != (count == 1):
        message = f"{key} holds no decimal numbers, but {str(value)[:80]}"
    elif wanted - {numbers.size}:
        message = f"{key} holds {numbers.size} numbers, not {max(wanted)}; export it again"
    else:
        return numbers.astype(float)
    raise RecordingError(message, file=file, key=key)


def _values(file: Path) -> tuple[Mapping, bool]:
    """Return the file's values by key, of whole lines alone, as in YAML nothing else shows that a
    number was cut; and whether it is JSON.
    """
    text = read_text(file)
    body, whole = "\n".join(text.lines), "\n".join([*text.lines, text.cut or ""])
    is_json, message = whole.lstrip().startswith("{"), f"{NO_CALIBRATION}; export it again"
    try:
        if is_json:
            held = [json.loads(whole)]
        elif body.lstrip().startswith("<"):
            held = [{one.tag: _element(one) for one in ElementTree.fromstring(body)}]
        else:
            # a directive of OpenCV, which is none of YAML
            held = [*yaml.load_all(re.sub(r"^%YAML:1\.0.*\n", "", body), _Decimal)]
    except (yaml.YAMLError, ElementTree.ParseError, ValueError, RecursionError):
        raise RecordingError(message, file=file) from None
    # Open3D puts the camera beside its pose, ROS prints messages again and again
    held = [one.get("intrinsic", one) if isinstance(one, Mapping) else one for one in held if one]
    if not held or not all(isinstance(one, Mapping) for one in held):
        raise RecordingError(message, file=file)
    plain = [{key: value for key, value in one.items() if key != "header"} for one in held]
    if any(other != plain[0] for other in plain):
        message = f"the file holds {len(held)} calibrations, not all of them equal; keep one"
        raise RecordingError(message, file=file)
    if "ppx" in plain[0]:
        named = {REALSENSE.get(key, key): value for key, value in plain[0].items()}
        return {"distortion_model": "that is not stated"} | named, is_json
    return plain[0], is_json


class _Decimal(yaml.SafeLoader):
    """YAML whose numbers are decimal; every other plain word is text."""

    yaml_implicit_resolvers: ClassVar[dict] = {}


_Decimal.add_implicit_resolver("tag:yaml.org,2002:null", re.compile(r"(~|null|)$"), None)
_Decimal.add_implicit_resolver("tag:yaml.org,2002:int", WHOLE, None)
_Decimal.add_implicit_resolver("tag:yaml.org,2002:float", REAL, None)
_Decimal.add_constructor(
    "tag:yaml.org,2002:opencv-matrix",
    lambda loader, node: loader.construct_mapping(node, deep=True),
)


def _element(element: ElementTree.Element) -> object:
    """Return the content of an element as OpenCV's XML has it."""
    if len(element):
        return {one.tag: _element(one) for one in element}
    words = [_word(word) for word in (element.text or "").split()]
    return words if element.tag == "data" else words[0] if len(words) == 1 else element.text


def _word(word: str) -> float | str:
    return int(word) if WHOLE.match(word) else float(word) if REAL.match(word) else word


def write_intrinsics(file: Path, intrinsics: Intrinsics) -> None:
    """Write the camera as OpenCV's YAML; numbers read back exactly."""
    # here, as few write a calibration
    import cv2

    one = intrinsics
    matrix = np.array([[one.fx, 0, one.cx], [0, one.fy, one.cy], [0, 0, 1]])
    storage = cv2.FileStorage("intrinsics.yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("cameraMatrix", matrix)
    storage.write("distortionCoefficients", np.array([one.distortion or (0.0,) * 5]))
    # the head of OpenCV 2 to 4, which version 5 reads too
    body = storage.releaseAndGetString().partition("\n")[2]
    Path(file).write_bytes(f"%YAML:1.0\n{body}".encode())


def _begins(head: Head) -> bool:
    if head.suffix not in (".yaml", ".yml", ".json", ".xml"):
        return False
    text = head.text or ""
    return CALIBRATED.search(text) is not None or all(
        re.search(rf'(?m)(?:^|[{{,])[^\S\n]*"?{name}"?\s*:', text) for name in FOCAL
    )


FORMAT = Format("camera intrinsics", Kind.INTRINSICS, read_intrinsics, _begins)
