"""Calibration of an ATI transducer (a ``.cal`` file, XML): units, ratings and the matrix from gauge
voltages to forces, in ``UserAxis`` from version 1.1 on; version 1.0 has ``Axis`` alone, each row
times a scale and about the gauges' own origin, from which ``BasicTransform`` leads to the
transducer's.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Kind, decoded, file_content, is_xml
from pipeline.formats.units import FORCE_UNITS, LENGTH_UNITS, TORQUE_UNITS, plain_unit

AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")


@dataclass(frozen=True)
class Calibration:
    """One calibration, in its own units."""

    file: Path
    serial: str
    force_unit: str
    torque_unit: str
    matrix: np.ndarray  # (6, 6) force_unit and torque_unit per volt of the six gauges
    full_scale: np.ndarray  # (6,) rated load of fx … tz


def read_calibration(file: Path) -> Calibration:
    """Return the calibration in ``file``; RecordingError for a file that is no XML, not one
    calibration, an axis without six gauges or a rating, and a basic transform of unknown effect.
    """
    try:
        # as text, since programs save it in another encoding than its first line states
        elements = [*ElementTree.fromstring(decoded(file_content(file)) or "").iter()]
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        line = {"line": error.position[0]} if hasattr(error, "position") else {}
        message = f"this is no XML ({error}); copy it again"
        raise RecordingError(message, file=file, **line) from None
    serial = next((one.attrib["Serial"] for one in elements if "Serial" in one.attrib), "")
    stated = [one.attrib for one in elements if {"ForceUnits", "TorqueUnits"} <= {*one.attrib}]
    if len(stated) != 1:
        message = f"{len(stated)} elements state ForceUnits and TorqueUnits; a calibration has one"
        raise RecordingError(message, file=file)
    kind = "UserAxis" if any(one.tag == "UserAxis" for one in elements) else "Axis"
    rows = {one.get("Name"): one.attrib for one in elements if one.tag == kind}
    if missing := [axis for axis in AXES if axis not in rows]:
        raise RecordingError(f"no {kind} {', '.join(missing)} in the calibration", file=file)

    def numbers(name: str, count: int) -> np.ndarray:
        return np.array([_numbers(rows[axis], name, count, file) for axis in AXES])

    matrix, full_scale = numbers("values", 6), numbers("max", 1)[:, 0]
    if np.any(full_scale <= 0):
        raise RecordingError("the rating of an axis is not positive", file=file)
    if kind == "Axis":
        if np.any((scale := numbers("scale", 1)) == 0):
            raise RecordingError("the scale of an axis is zero", file=file)
        matrix = matrix / scale
        # torque about the transducer's origin, which lies at the offset in the gauges' frame
        basic = next((one.attrib for one in elements if one.tag == "BasicTransform"), {})
        offset = _offset(basic, stated[0], file)
        matrix[3:] -= np.cross(offset, matrix[:3], axisb=0, axisc=0)
    units = stated[0]["ForceUnits"], stated[0]["TorqueUnits"]
    return Calibration(Path(file), serial, *units, matrix, full_scale)


def _offset(basic: dict[str, str], stated: dict[str, str], file: Path) -> np.ndarray:
    """Return (3,) the offset of the basic transform in the length of the unit of torque, or in the
    file's own numbers where no unit of distance is stated.
    """
    held = {name: _numbers(basic, name, 1, file)[0] for name in basic if name[:1] in "DR"}
    if any(held.get(turn) for turn in ("Rx", "Ry", "Rz")):
        message = "the basic transform turns the axes; ask for a calibration with UserAxis rows"
        raise RecordingError(message, file=file)
    offset = np.array([held.get(shift, 0.0) for shift in ("Dx", "Dy", "Dz")])
    if not offset.any() or "DistUnits" not in stated:
        return offset
    force, torque = (plain_unit(stated[f"{quantity}Units"]) for quantity in ("Force", "Torque"))
    length = stated["DistUnits"]
    try:
        return offset * (LENGTH_UNITS[length] * FORCE_UNITS[force] / TORQUE_UNITS[torque])
    except KeyError:
        message = f"the units {force}, {torque}, {length} are not all known, and the basic "
        raise RecordingError(f"{message}transform needs them", file=file) from None


def _numbers(values: dict[str, str], name: str, count: int, file: Path) -> list[float]:
    try:
        numbers = [float(word) for word in values[name].split()]
    except (KeyError, ValueError):
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        message = f"{name} of {values.get('Name', 'the basic transform')} must be {count} finite "
        raise RecordingError(f"{message}number(s), not {values.get(name)!r}", file=file)
    return numbers


MARKS = is_xml("FTSensor", "Calibration", "UserAxis")
FORMAT = Format("ATI calibration", Kind.CALIBRATION, read_calibration, MARKS)
