"""Intrinsics of a depth camera, as calibration tools write them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.calibration_file import is_json, read_values
from pipeline.formats.format import Format, Head, Kind, Stated

MATRIX = (
    *("cameraMatrix", "camera_matrix", "Camera_Matrix", "CameraMatrix"),
    *("K", "k", "intrinsic_matrix"),
)
DISTORTION = (
    *("distortionCoefficients", "distortion_coefficients", "Distortion_Coefficients"),
    *("DistCoeffs", "distCoeffs", "dist_coeffs", "D", "d"),
)
BENT = re.compile(r"(?i)dist.*|.*coeff.*|[kp]1")  # a key that may be of distortion
# distortion models, as tools name them, of OpenCV's coefficients
MODELS = ("plumb_bob", "radtan", "rational_polynomial", "none")
FOCAL = ("fx", "fy", "cx", "cy")
SIZE = (("width", "height"), ("image_width", "image_height"), ("image_Width", "image_Height"))
NARROWEST = 100  # focal length over the longer side: a view of half a degree
COEFFICIENTS = (0, 4, 5, 8, 12, 14)  # the numbers of coefficients that OpenCV's model has


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
    """Intrinsics of the camera ``matrix`` (3, 3) and OpenCV's ``distortion`` (k,) of an image of
    ``width`` × ``height`` pixels.

    Raises RecordingError (with ``evidence``) for a matrix that is none, a coefficient too many, a
    focal length of no camera and a principal point outside the image.
    """
    (fx, skew, cx), (low, fy, cy), bottom = matrix.tolist()
    if (
        not np.isfinite(matrix).all()
        or fx <= 0
        or fy <= 0
        or (skew, low, *bottom) != (0, 0, 0, 0, 1)
    ):
        raise RecordingError("the camera matrix is not [fx 0 cx; 0 fy cy; 0 0 1]", **evidence)
    if not np.isfinite(distortion).all() or distortion.size not in COEFFICIENTS:
        raise RecordingError(
            f"{distortion.size} distortion coefficients, or one that is not finite; OpenCV's "
            f"model has {COEFFICIENTS}",
            **evidence,
        )
    if max(fx, fy) > NARROWEST * max(width, height):
        raise RecordingError(
            f"a focal length of {max(fx, fy):.6g} px is of no camera of {width} × {height}",
            **evidence,
        )
    if not (0 < cx < width and 0 < cy < height):
        raise RecordingError(
            f"the principal point {cx:.1f}, {cy:.1f} is outside {width} × {height} pixels",
            **evidence,
        )
    return Intrinsics(fx, fy, cx, cy, width, height, tuple(distortion.ravel().tolist()))


def read_intrinsics(
    file: Path, *, width: int, height: int, matrix: str | None = None, distortion: str | None = None
) -> Intrinsics:
    """Intrinsics of a camera of ``width`` × ``height`` pixels; a size that the file states must be
    that.

    ``matrix`` and ``distortion`` name the keys where they are not the usual ones, or where the file
    holds several. Focal lengths and principal point may stand as fx, fy, cx, cy instead of a
    matrix. Only JSON may leave the distortion out, for a camera without. Of the messages of a
    CameraInfo that ROS prints, all must be equal but for their headers. Raises RecordingError for a
    file that cannot be read as any of the formats, a key that is not there or not the only one
    (naming those that are), values that are no camera's, a distortion model that is not OpenCV's,
    and another size.
    """
    values = read_values(file)
    for wide, high in SIZE:
        stated = (values.get(wide, width), values.get(high, height))
        if stated != (width, height):
            raise RecordingError(
                f"calibrated at {stated[0]} × {stated[1]} pixels, not {width} × {height}",
                file=file,
                key=wide,
            )
    key = _key(values, matrix, MATRIX, "camera matrix", file)
    if key is not None:
        entries = _numbers(values[key], file, key)
        if entries.size != 9:
            raise RecordingError(
                f"there is no 3 × 3 {key}; export the calibration again", file=file, key=key
            )
        camera = (
            entries.reshape(3, 3).T
            if key == "intrinsic_matrix" and entries.ndim == 1
            else entries.reshape(3, 3)
        )
    elif set(FOCAL) <= set(values):
        four = [_numbers(values[name], file, name) for name in FOCAL]
        if any(number.size != 1 for number in four):
            raise RecordingError("fx, fy, cx and cy are not four numbers", file=file)
        fx, fy, cx, cy = (number.item() for number in four)
        camera = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    else:
        raise RecordingError(
            f"no camera matrix under a usual name; the file has {', '.join(map(str, values))}: "
            "name its key in camera_matrix",
            file=file,
        )
    bent = _key(values, distortion, DISTORTION, "distortion", file)
    if bent is None and (not is_json(file) or any(BENT.fullmatch(name) for name in values)):
        raise RecordingError(
            f"there are no distortionCoefficients; the file has {', '.join(map(str, values))}: "
            "name their key in distortion, "
            "or write zeros where there is no distortion",
            file=file,
        )
    coefficients = np.zeros(0) if bent is None else _numbers(values[bent], file, bent).ravel()
    model = values.get("distortion_model")
    if coefficients.any() and model not in (None, "", *MODELS):
        raise RecordingError(
            f"the distortion {model!r} is none of {', '.join(MODELS)}; calibrate with one of these",
            file=file,
            key="distortion_model",
        )
    return pinhole(camera, coefficients, width=width, height=height, file=file, key=key)


def _key(
    values: Mapping, chosen: str | None, usual: tuple[str, ...], what: str, file: Path
) -> str | None:
    if chosen is not None:
        if chosen not in values:
            raise RecordingError(
                f"no {what} {chosen!r}; the file has {', '.join(map(str, values))}", file=file
            )
        return chosen
    present = [name for name in usual if name in values]
    if len(present) > 1:
        raise RecordingError(
            f"{' and '.join(present)} could each be the {what}; choose one by option", file=file
        )
    return present[0] if present else None


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
        instead = f", but {words[0]}" if words else ""
        raise RecordingError(
            f"{key} holds no decimal numbers{instead}", file=file, key=key
        ) from None


def _flat(value: object) -> Iterator[object]:
    if isinstance(value, list):
        for each in value:
            yield from _flat(each)
    else:
        yield value


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
    """Width and height in px as ``facts``, where the file states both."""
    values = read_values(file)
    sizes = [[values.get(wide), values.get(high)] for wide, high in SIZE]
    for size in sizes:
        if all(type(pixels) in (int, float) and 0 < pixels < 2**31 for pixels in size):
            return Stated(facts={"width": int(size[0]), "height": int(size[1])})
    return Stated()


FORMAT = Format("camera intrinsics", Kind.INTRINSICS, read_intrinsics, _begins, _states)
