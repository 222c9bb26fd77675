"""Intrinsics of a depth camera from files of calibration tools: YAML or XML of OpenCV, YAML of ROS,
plain YAML or JSON, JSON of Open3D and of RealSense.
"""

import json
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
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
MATRIX, DISTORTION = KEYS["camera matrix"], KEYS["distortion"]
REALSENSE: dict[str, str] = _STATED[
    "realsense"
]  # key of RealSense → key of this module
MODELS: list[str] = _STATED[
    "models"
]  # names of distortion models with OpenCV's coefficients
# keys that may state a distortion
DISTORTION_KEY = re.compile(r"(?i).*dist(?!ance).*|.*coeff.*|[kp]1")
ANY_SIZE = (10**6, 10**6)  # px, stands for an unknown image size
NARROWEST = (
    100  # greatest focal length over the longer side: a field of view of half a degree
)
WIDEST = (
    10  # greatest distance of the principal point from a side over the focal length
)
OFF_CENTRE = (
    0.24  # greatest distance of the principal point from the centre over the side
)
COEFFICIENTS = (
    0,
    4,
    5,
    8,
    12,
    14,
)  # possible numbers of coefficients in OpenCV's model
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
    finite, rest, message = np.isfinite(matrix).all(), (skew, low, *bottom), ""
    sides = [
        at / side for at, side in zip((cx, cy), size, strict=True) if side < ANY_SIZE[0]
    ]
    off_centre = min(cx, cy) <= 0 or any(
        abs(share - 0.5) >= OFF_CENTRE for share in sides
    )
    if stated not in (None, size):
        message = (
            f"calibrated at {stated[0]} × {stated[1]} pixels, not {size[0]} × {size[1]}"
        )
    elif distortion.any() and model not in (None, "", "null", *MODELS):
        message = f"the distortion model is {model!r}; calibrate with one of {', '.join(MODELS)}"
    elif not finite or min(fx, fy) <= 0 or rest != (0, 0, 0, 0, 1):
        message = "the camera matrix is not [fx 0 cx; 0 fy cy; 0 0 1]"
    elif not np.isfinite(distortion).all() or distortion.size not in COEFFICIENTS:
        message = f"{distortion.size} distortion coefficients, or one that is not finite; OpenCV's "
        message += f"model has {COEFFICIENTS}"
    elif (
        max(fx, fy) > NARROWEST * max(size)
        or min(fx, fy) < max(cx, cy) / WIDEST
        or off_centre
    ):
        message = f"a focal length of {max(fx, fy):.6g} px and a principal point at {cx:.1f}, "
        message += f"{cy:.1f} px are of no camera of {size[0]} × {size[1]} pixels: state them in px"
        message += " of these images, not of another size"
    if message:
        raise RecordingError(message, **evidence)
    return Intrinsics(fx, fy, cx, cy, *size, tuple(distortion.ravel().tolist()))


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
        _values, Path(file), file=file, advice="export it again"
    )
    keys_found = f"the file has {', '.join(map(str, values))}"

    def numbers(
        item: str, given: str | None = None, count: int | None = None
    ) -> np.ndarray | None:
        keys = (given,) if given else KEYS.get(item, (item,))
        present = [key for key in keys if key in values]
        if not (present or given):
            return None
        message = f"{len(present)} of {', '.join(present or keys)} are there, one {item} is needed"
        if len({str(values[key]) for key in present}) == 1:
            value, counts = values[present[0]], {count} - {None}
            if isinstance(value, Mapping):
                size = [str(value.get(name)) for name in ("rows", "cols")]
                if all(re.fullmatch(r"\d{1,9}", side) for side in size):
                    counts.add(int(size[0]) * int(size[1]))
                value = value.get("data")
            with suppress(ValueError):  # nested lists of unequal lengths
                words = np.array(value, dtype=str)
                decimal = all(map(DECIMAL.fullmatch, words.ravel().tolist()))
                if (
                    decimal
                    and not counts - {words.size}
                    and np.isfinite(words.astype(float)).all()
                ):
                    return words.astype(float)
            message = f"{present[0]} must be {max(counts, default='')} decimal numbers, found "
            message += str(value)[:80]
        message = f"{message}; name the key by option; {keys_found}"
        raise RecordingError(message, file=file, key=item)

    sides = [numbers(side, count=1) for side in ("width", "height")]
    stated = [None if side is None else int(side) for side in sides]
    sides = zip((width, height), stated, ANY_SIZE, strict=True)
    size = tuple(given or own or most for given, own, most in sides)
    camera, bend = (
        numbers("camera matrix", matrix, 9),
        numbers("distortion", distortion),
    )
    if camera is not None:
        # Open3D writes the matrix as a flat list, column by column
        columns = camera.ndim == 1 and "intrinsic_matrix" in (
            {matrix} if matrix else values
        )
        camera = camera.reshape(3, 3, order="F" if columns else "C")
    elif {*FOCAL} <= {*values}:
        fx, fy, cx, cy = (numbers(name, count=1).item() for name in FOCAL)
        camera = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    else:
        message = (
            f"no camera matrix; {keys_found}: name its key by option, or write at the "
        )
        message += f"outermost level one of fx, fy, cx, cy or {', '.join(MATRIX)}"
        raise RecordingError(message, file=file)
    if bend is None and (not is_json or any(map(DISTORTION_KEY.fullmatch, values))):
        message = f"no distortion; {keys_found}: name its key by option, or write at the outermost "
        message += f"level one of {', '.join(DISTORTION)}, with zeros for no distortion"
        raise RecordingError(message, file=file)
    bend, model = (
        np.zeros(0) if bend is None else bend.ravel(),
        values.get("distortion_model"),
    )
    own = tuple(side or given for side, given in zip(stated, size, strict=True))
    return pinhole(camera, bend, size, stated=own, model=model, file=file)


def _values(file: Path) -> tuple[Mapping, bool]:
    """Return key → value, numbers as text, and whether it is JSON; a cut YAML line is ignored."""
    text = read_text(file)
    body, whole = "\n".join(text.lines), "\n".join([*text.lines, text.cut or ""])
    is_json, documents = whole.lstrip().startswith("{"), []
    try:
        if is_json:
            documents = [json.loads(whole, parse_float=str, parse_int=str)]
        elif whole.lstrip().startswith("<"):
            documents = [
                {one.tag: _element(one) for one in ElementTree.fromstring(whole)}
            ]
        else:
            # OpenCV's first line is not valid YAML
            body = re.sub(r"^%YAML:1\.0.*\n", "", body)
            documents = [one for one in yaml.load_all(body, yaml.BaseLoader) if one]
    except (yaml.YAMLError, ElementTree.ParseError, ValueError, RecursionError):
        documents = []
    # Open3D's file has the camera and its pose, a ROS print has many messages
    plain = [one.get("intrinsic", one) for one in documents if isinstance(one, Mapping)]
    plain = [dict(one) for one in plain if isinstance(one, Mapping)]
    for one in plain:
        one.pop("header", None)
    if (
        not plain
        or len(plain) < len(documents)
        or any(other != plain[0] for other in plain)
    ):
        message = "no calibration in YAML, XML or JSON, or truncated, or several calibrations that "
        message += "differ; export one again"
        raise RecordingError(message, file=file)
    if "ppx" in plain[0]:
        named = {REALSENSE.get(key, key): value for key, value in plain[0].items()}
        return {"distortion_model": "not stated"} | named, is_json
    return plain[0], is_json


def _element(element: ElementTree.Element) -> object:
    """Return the content of an element of OpenCV's XML: key → value, words or text."""
    if len(element):
        return {one.tag: _element(one) for one in element}
    words = (element.text or "").split()
    return words if element.tag == "data" else " ".join(words)


def write_intrinsics(file: Path, intrinsics: Intrinsics) -> None:
    """Write the camera as OpenCV's YAML, without rounding."""
    import cv2  # here, since few callers write a calibration

    one = intrinsics
    matrix = np.array([[one.fx, 0, one.cx], [0, one.fy, one.cy], [0, 0, 1]])
    storage = cv2.FileStorage(
        "intrinsics.yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY
    )
    storage.write("cameraMatrix", matrix)
    storage.write("distortionCoefficients", np.array([one.distortion or (0.0,) * 5]))
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
