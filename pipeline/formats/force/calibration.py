"""The calibration of an ATI transducer: its units, its ratings and the matrix from gauge voltages
to forces (a ``.cal`` file, XML).

From version 1.1 on the rows of the matrix stand in ``UserAxis``; version 1.0 has ``Axis`` alone,
each row times a scale and about the gauges' own origin, from which ``BasicTransform`` leads to the
transducer's (Axis → UserAxis of a 1.1 file shows the rule).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import file_content
from pipeline.formats.format import Format, Kind, is_xml
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
    """Return the calibration in ``file``.

    Raises RecordingError for a file that is no XML or declares a document type (entities could then
    exhaust memory or open other files), that holds not one calibration, an axis without six gauges
    or a rating, or a basic transform that turns the axes or has no known unit.
    """
    elements = _elements(Path(file))
    serial = next((values["Serial"] for _, values in elements if "Serial" in values), "")
    stated = [values for _, values in elements if {"ForceUnits", "TorqueUnits"} <= {*values}]
    if len(stated) != 1:
        message = f"{len(stated)} elements state ForceUnits and TorqueUnits; a calibration has one"
        raise RecordingError(message, file=file)
    kind = "UserAxis" if any(name == "UserAxis" for name, _ in elements) else "Axis"
    rows = {values.get("Name"): values for name, values in elements if name == kind}
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
        matrix[3:] -= np.cross(_offset(elements, stated[0], file), matrix[:3], axisb=0, axisc=0)
    units = stated[0]["ForceUnits"], stated[0]["TorqueUnits"]
    return Calibration(Path(file), serial, *units, matrix, full_scale)


def _offset(elements: list, stated: dict[str, str], file: Path) -> np.ndarray:
    """Return (3,) the offset of the basic transform, in the arm's length that the unit of torque
    has to the unit of force; in the file's own numbers where no unit of distance is stated.
    """
    basic = next((values for name, values in elements if name == "BasicTransform"), {})
    held = {name: _numbers(basic, name, 1, file)[0] for name in basic if name[:1] in "DR"}
    if any(held.get(turn) for turn in ("Rx", "Ry", "Rz")):
        message = "the basic transform turns the axes; ask for a calibration with UserAxis rows"
        raise RecordingError(message, file=file)
    offset = np.array([held.get(shift, 0.0) for shift in ("Dx", "Dy", "Dz")])
    if not offset.any() or "DistUnits" not in stated:
        return offset
    force, torque = (plain_unit(stated[f"{quantity}Units"]) for quantity in ("Force", "Torque"))
    length = stated["DistUnits"]
    if force not in FORCE_UNITS or torque not in TORQUE_UNITS or length not in LENGTH_UNITS:
        message = f"the units {force}, {torque}, {length} are not all known, and the basic "
        raise RecordingError(f"{message}transform needs them", file=file)
    return offset * (LENGTH_UNITS[length] * FORCE_UNITS[force] / TORQUE_UNITS[torque])


def _numbers(values: dict[str, str], name: str, count: int, file: Path) -> list[float]:
    try:
        numbers = [float(word) for word in values[name].split()]
    except (KeyError, ValueError):
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        message = f"{name} of {values.get('Name', 'the basic transform')} must be {count} finite "
        raise RecordingError(f"{message}number(s), not {values.get(name)!r}", file=file)
    return numbers


def _elements(file: Path) -> list[tuple[str, dict[str, str]]]:
    elements: list[tuple[str, dict[str, str]]] = []

    def refuse(*_: object) -> None:
        message = "the calibration declares a document type or entities; remove the declaration"
        raise RecordingError(message, file=file)

    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda name, values: elements.append((name, values))
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(file_content(file), True)
    except expat.ExpatError as error:
        message = f"this is no XML ({expat.ErrorString(error.code)}); copy it again"
        raise RecordingError(message, file=file, line=error.lineno) from None
    except (LookupError, ValueError) as error:
        message = f"the encoding that the XML announces cannot be read ({error}); save it as UTF-8"
        raise RecordingError(message, file=file, line=1) from None
    return elements


FORMAT = Format(
    "ATI calibration",
    Kind.CALIBRATION,
    read_calibration,
    is_xml("FTSensor", "Calibration", "UserAxis"),
)
