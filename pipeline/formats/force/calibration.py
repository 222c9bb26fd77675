"""Calibrations of ATI transducers (``.cal`` files, XML): units, ratings and the matrix from gauge
voltages to forces. Version 1.1 has it in ``UserAxis``. Version 1.0 has ``Axis`` alone: rows times a
scale, about the gauges' origin, and ``BasicTransform`` from there to the transducer's origin.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import FORCE_UNITS, LENGTH_UNITS, TORQUE_UNITS, plain_unit
from pipeline.formats.format import Format, Kind, decoded, file_content, is_xml

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
    """Return the calibration in ``file``; RecordingError for a file that is no XML or not one
    calibration, an axis without six gauges or a rating, and a basic transform that turns the axes.
    """
    try:
        # as text, since the first line may state another encoding than the file has
        elements = [*ElementTree.fromstring(decoded(file_content(file)) or "").iter()]
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        line = {"line": error.position[0]} if hasattr(error, "position") else {}
        message = f"this is no XML ({error}); copy it again"
        raise RecordingError(message, file=file, **line) from None
    serial = next((one.attrib["Serial"] for one in elements if "Serial" in one.attrib), "")
    stated = [one.attrib for one in elements if {"ForceUnits", "TorqueUnits"} <= {*one.attrib}]
    kind = "UserAxis" if any(one.tag == "UserAxis" for one in elements) else "Axis"
    rows = {one.get("Name"): one.attrib for one in elements if one.tag == kind}
    basic = next((one.attrib for one in elements if one.tag == "BasicTransform"), {})
    try:
        (units,) = stated
        matrix, full_scale = _numbers(rows, "values", 6), _numbers(rows, "max", 1)
        if full_scale.min() <= 0:
            raise ValueError("max of an axis must be above 0")
        if kind == "Axis":
            matrix = matrix / _numbers(rows, "scale", 1)
            # torque about the transducer's origin, which lies at the offset in the gauges' frame
            matrix[3:] -= np.cross(_offset(basic, units), matrix[:3], axisb=0, axisc=0)
        if not np.isfinite(matrix).all():
            raise ValueError("scale of an axis is 0")
    except (KeyError, ValueError) as error:
        message = f"not one calibration with ForceUnits and TorqueUnits and {kind} of each of "
        message += f"{', '.join(AXES)} ({error}); copy it again"
        raise RecordingError(message, file=file) from None
    names = units["ForceUnits"], units["TorqueUnits"]
    return Calibration(Path(file), serial, *names, matrix, full_scale[:, 0])


def _numbers(rows: Mapping[str, Mapping[str, str]], name: str, count: int) -> np.ndarray:
    held = [[*map(float, rows[axis][name].split())] for axis in AXES]
    if {*map(len, held)} != {count} or not np.isfinite(held).all():
        raise ValueError(f"{name} of an axis must be {count} finite number(s)")
    return np.array(held)


def _offset(basic: Mapping[str, str], stated: Mapping[str, str]) -> np.ndarray:
    """Return (3,) the offset of the basic transform in the length unit of the torques, or as stated
    where the file has no unit of distance.
    """
    if any(float(basic.get(turn, 0)) for turn in ("Rx", "Ry", "Rz")):
        raise ValueError("the basic transform turns the axes; ask for one with UserAxis rows")
    offset = np.array([float(basic.get(shift, 0)) for shift in ("Dx", "Dy", "Dz")])
    if not offset.any() or "DistUnits" not in stated:
        return offset
    force, torque = (plain_unit(stated[f"{quantity}Units"]) for quantity in ("Force", "Torque"))
    return offset * (LENGTH_UNITS[stated["DistUnits"]] * FORCE_UNITS[force] / TORQUE_UNITS[torque])


MARKS = is_xml("FTSensor", "Calibration", "UserAxis")
FORMAT = Format("ATI calibration", Kind.CALIBRATION, read_calibration, MARKS)
