"""Intrinsics of a depth camera from files of calibration tools: YAML or XML of OpenCV, YAML of ROS,
plain YAML or JSON, JSON of Open3D and of RealSense.
"""

import json
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import yaml

from pipeline.core.errors import RecordingError
from pipeline.core.typed_yaml import read_yaml
from pipeline.formats.delimited import read_text
from pipeline.formats.format import Format, Head, Kind, read_alone

FOCAL = ("fx", "fy", "cx", "cy")
_STATED = read_yaml(Path(__file__).with_suffix(".yaml"))
KEYS: dict[str, list[str]] = _STATED["keys"]  # item → keys that state it
MATRIX = KEYS["camera matrix"]
DISTORTION = KEYS["distortion"]
# key of RealSense → key of this module
REALSENSE: dict[str, str] = _STATED["realsense"]
# names of distortion models with OpenCV's coefficients
MODELS: list[str] = _STATED["models"]
# keys that may state a distortion
DISTORTION_KEY = re.compile(r"(?i).*dist(?!ance).*|.*coeff.*|[kp]1")
ANY_SIZE = (10**6, 10**6)  # px, stands for an unknown image size
# greatest focal length over the longer side: a field of view of half a degree
NARROWEST = 100
# greatest distance of the principal point from a side over the focal length
WIDEST = 10
# greatest distance of the principal point from the centre over the side
OFF_CENTRE = 0.24
# possible numbers of coefficients in OpenCV's model
COEFFICIENTS = (0, 4, 5, 8, 12, 14)
# only decimal numbers: YAML 1.1 reads 0525 as 341, yes as true and 5:25 as 325
DECIMAL = re.compile(r"[-+]?(\d+\.\d*|\.\d+|0|[1-9]\d*|\d+(?=[eE]))([eE][-+]?\d+)?")
# matches calibrations in other forms too, for which the reader's error names the keys
CALIBRATED = re.compile(
    rf'(?:^|[{{,>])[^\S\n]*["<]?(?:{"|".join((*MATRIX, *DISTORTION, "ppx"))})'
    r'\b"?\s*[:>\s]|"Intrinsics"|^\s+intrinsics: \[',
    re.MULTILINE,
)


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole camera in px, with OpenCV's distortion coefficients k1, k2, p1, p2, k3, …"""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distortion: tuple[float, ...] = ()

    @property
    def matrix(self) -> np.ndarray:
        """Camera matrix (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])


def pinhole(
    matrix: np.ndarray,
    distortion: np.ndarray,
    size: tuple[int, int],
    *,
    stated: tuple[object, object] | None = None,
    model: object = None,
    **evidence: object,
) -> Intrinsics:
    """Return the camera with ``matrix`` (3, 3) and OpenCV's ``distortion`` (k,) for images of
    ``size`` (width, height); RecordingError (with ``evidence``) for another ``stated`` size,
    implausible values, and coefficients of a ``model`` other than OpenCV's.
    """
    (fx, skew, cx), (low, fy, cy), bottom = matrix.tolist()
    triangular = (skew, low, *bottom) == (0, 0, 0, 0, 1)
    usual = distortion.size in COEFFICIENTS and np.isfinite(distortion).all()
    if stated not in (None, size):
        fault = (
            f"calibrated at {stated[0]} × {stated[1]} pixels, not {size[0]} × {size[1]}"
        )
    elif distortion.any() and model not in (None, "", "null", *MODELS):
        fault = f"the distortion model is {model!r}; calibrate with one of {', '.join(MODELS)}"
    elif not np.isfinite(matrix).all() or min(fx, fy) <= 0 or not triangular:
        fault = "the camera matrix is not [fx 0 cx; 0 fy cy; 0 0 1]"
    elif not usual:
        fault = (
            f"{distortion.size} distortion coefficients, or one that is not finite; OpenCV's model "
            f"has {COEFFICIENTS}"
        )
    elif not _is_plausible((fx, fy), (cx, cy), size):
        fault = (
            f"a focal length of {max(fx, fy):.6g} px and a principal point at {cx:.1f}, {cy:.1f} "
            f"px are of no camera of {size[0]} × {size[1]} pixels: state them in px of these "
            "images, not of another size"
        )
    else:
        return Intrinsics(fx, fy, cx, cy, *size, tuple(distortion.ravel().tolist()))
    raise RecordingError(fault, **evidence)


def _is_plausible(
    focal: tuple[float, float],
    principal: tuple[float, float],
    size: tuple[int, int],
) -> bool:
    """Return whether a camera for images of ``size`` (width, height) may have the ``focal`` lengths
    (fx, fy) and the ``principal`` point (cx, cy), all in px.
    """
    narrow = max(focal) > NARROWEST * max(size)
    wide = min(focal) < max(principal) / WIDEST
    if narrow or wide or min(principal) <= 0:
        return False
    for place, side in zip(principal, size, strict=True):
        if side < ANY_SIZE[0] and abs(place / side - 0.5) >= OFF_CENTRE:
            return False
    return True


def read_intrinsics(
    file: Path,
    *,
    width: int | None = None,
    height: int | None = None,
    matrix: str | None = None,
    distortion: str | None = None,
) -> Intrinsics:
    """Return the intrinsics for images of ``width`` × ``height`` pixels (default the file's size,
    else ANY_SIZE). ``matrix`` and ``distortion`` are the keys to read, if a key is unusual or
    several fit. Only JSON may lack the distortion, which is then zero. Several printed CameraInfo
    messages must be equal except for their headers. Raises RecordingError for another format, size
    or distortion model, a key that is missing or ambiguous, and implausible values.
    """
    # a separate process, since a library may crash or hang on damaged text
    values, is_json = read_alone(
        _values,
        Path(file),
        file=file,
        advice="export it again",
    )
    calibration = _Calibration(Path(file), values)
    stated_width = calibration.side("width")
    stated_height = calibration.side("height")
    width = width or stated_width or ANY_SIZE[0]
    height = height or stated_height or ANY_SIZE[1]
    camera = calibration.camera_matrix(matrix)
    coefficients = calibration.numbers("distortion", distortion)
    if coefficients is None:
        if not is_json or any(DISTORTION_KEY.fullmatch(key) for key in values):
            raise RecordingError(
                f"no distortion; {calibration.keys}: name its key by option, or write at the "
                f"outermost level one of {', '.join(DISTORTION)}, with zeros for no distortion",
                file=file,
            )
        coefficients = np.zeros(0)
    return pinhole(
        camera,
        coefficients.ravel(),
        (width, height),
        stated=(stated_width or width, stated_height or height),
        model=values.get("distortion_model"),
        file=file,
    )


class _Calibration(NamedTuple):
    """Values of a calibration's file by key, numbers as text."""

    file: Path
    values: Mapping

    @property
    def keys(self) -> str:
        """The present keys, for an error."""
        return f"the file has {', '.join(map(str, self.values))}"

    def side(self, name: str) -> int | None:
        """Return the width or height in px that the file states, or None."""
        number = self.numbers(name, count=1)
        return None if number is None else int(number)

    def camera_matrix(self, key: str | None) -> np.ndarray:
        """Return the camera matrix (3, 3) of the option ``key``, of a usual key, or of fx, fy, cx
        and cy.
        """
        matrix = self.numbers("camera matrix", key, 9)
        if matrix is not None:
            # Open3D writes the matrix as a flat list, column by column
            open3d = "intrinsic_matrix" in ((key,) if key else self.values)
            by_columns = matrix.ndim == 1 and open3d
            return matrix.reshape(3, 3, order="F" if by_columns else "C")
        if {*FOCAL} <= {*self.values}:
            fx, fy, cx, cy = (self.numbers(name, count=1).item() for name in FOCAL)
            return Intrinsics(fx, fy, cx, cy, *ANY_SIZE).matrix
        raise RecordingError(
            f"no camera matrix; {self.keys}: name its key by option, or write at the outermost "
            f"level one of fx, fy, cx, cy or {', '.join(MATRIX)}",
            file=self.file,
        )

    def numbers(
        self,
        item: str,
        key: str | None = None,
        count: int | None = None,
    ) -> np.ndarray | None:
        """Return the numbers under the ``key``, else under a usual key of the ``item``, None if no
        usual key is there; RecordingError for several, and unless there are ``count`` numbers, or
        as many as the value itself states.
        """
        keys = (key,) if key else KEYS.get(item, (item,))
        present = [name for name in keys if name in self.values]
        if not present and not key:
            return None
        if len({str(self.values[name]) for name in present}) != 1:
            names = ", ".join(present or keys)
            fault = f"{len(present)} of {names} are there, one {item} is needed"
            raise self._fault(fault, item)
        value = self.values[present[0]]
        counts = set() if count is None else {count}
        if isinstance(value, Mapping):
            size = str(value.get("rows")), str(value.get("cols"))
            if all(re.fullmatch(r"\d{1,9}", side) for side in size):
                counts.add(int(size[0]) * int(size[1]))
            value = value.get("data")
        with suppress(ValueError):  # nested lists of unequal lengths
            words = np.array(value, dtype=str)
            decimal = all(DECIMAL.fullmatch(word) for word in words.ravel().tolist())
            if decimal and counts <= {words.size}:
                numbers = words.astype(float)
                if np.isfinite(numbers).all():
                    return numbers
        needed = max(counts, default="")
        fault = (
            f"{present[0]} must be {needed} decimal numbers, found {str(value)[:80]}"
        )
        raise self._fault(fault, item)

    def _fault(self, fault: str, item: str) -> RecordingError:
        message = f"{fault}; name the key by option; {self.keys}"
        return RecordingError(message, file=self.file, key=item)


def _values(file: Path) -> tuple[Mapping, bool]:
    """Return key → value, numbers as text, and whether it is JSON; a cut YAML line is ignored."""
    text = read_text(file)
    whole = "\n".join([*text.lines, text.cut or ""])
    is_json = whole.lstrip().startswith("{")
    documents = []
    try:
        if is_json:
            documents = [json.loads(whole, parse_float=str, parse_int=str)]
        elif whole.lstrip().startswith("<"):
            root = ElementTree.fromstring(whole)
            documents = [{element.tag: _element(element) for element in root}]
        else:
            # OpenCV's first line is not valid YAML
            body = re.sub(r"^%YAML:1\.0.*\n", "", "\n".join(text.lines))
            loaded = yaml.load_all(body, yaml.BaseLoader)
            documents = [document for document in loaded if document]
    except (yaml.YAMLError, ElementTree.ParseError, ValueError, RecursionError):
        documents = []
    # Open3D's file has the camera and its pose, a ROS print has many messages
    calibrations = []
    for document in documents:
        if isinstance(document, Mapping):
            document = document.get("intrinsic", document)
        if isinstance(document, Mapping):
            calibration = dict(document)
            calibration.pop("header", None)
            calibrations.append(calibration)
    differ = any(calibration != calibrations[0] for calibration in calibrations)
    if not calibrations or len(calibrations) < len(documents) or differ:
        raise RecordingError(
            "no calibration in YAML, XML or JSON, or truncated, or several calibrations that "
            "differ; export one again",
            file=file,
        )
    values = calibrations[0]
    if "ppx" in values:
        named = {REALSENSE.get(key, key): value for key, value in values.items()}
        values = {"distortion_model": "not stated"} | named
    return values, is_json


def _element(element: ElementTree.Element) -> object:
    """Return the content of an element of OpenCV's XML: key → value, words or text."""
    if len(element):
        return {child.tag: _element(child) for child in element}
    words = (element.text or "").split()
    return words if element.tag == "data" else " ".join(words)


def write_intrinsics(file: Path, intrinsics: Intrinsics) -> None:
    """Write the camera as OpenCV's YAML, without rounding."""
    import cv2  # here, since few callers write a calibration

    storage = cv2.FileStorage(
        "intrinsics.yaml",
        cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY,
    )
    storage.write("cameraMatrix", intrinsics.matrix)
    storage.write(
        "distortionCoefficients",
        np.array([intrinsics.distortion or (0.0,) * 5]),
    )
    body = storage.releaseAndGetString().partition("\n")[2]
    # first line of OpenCV 2 to 4, which version 5 also reads
    Path(file).write_bytes(f"%YAML:1.0\n{body}".encode())


def _begins(head: Head) -> bool:
    if head.suffix not in (".yaml", ".yml", ".json", ".xml"):
        return False
    text = head.text or ""
    return CALIBRATED.search(text) is not None or all(
        re.search(rf'(?m)(?:^|[{{,])[^\S\n]*"?{name}"?\s*:', text) for name in FOCAL
    )


FORMAT = Format("camera intrinsics", Kind.INTRINSICS, read_intrinsics, _begins)
