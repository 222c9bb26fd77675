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

from pipeline.core.bounds import read_whole
from pipeline.core.errors import RecordingError
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
    """Calibration in ``file``.

    Raises RecordingError for a file that is no XML or declares a document type (entities could then
    exhaust memory or open other files), that holds not one calibration, an axis without six gauges
    or a rating, or a basic transform that turns the axes or has no known unit.
    """
    elements = _elements(Path(file))
    serial = next((values["Serial"] for _, values in elements if "Serial" in values), "")
    stated = [
        values for _, values in elements if "ForceUnits" in values and "TorqueUnits" in values
    ]
    if len(stated) != 1:
        raise RecordingError(
            f"{len(stated)} elements state ForceUnits and TorqueUnits; a calibration has one",
            file=file,
        )
    rows = {
        kind: {values.get("Name"): values for name, values in elements if name == kind}
        for kind in ("UserAxis", "Axis")
    }
    kind = "UserAxis" if rows["UserAxis"] else "Axis"
    if missing := [axis for axis in AXES if axis not in rows[kind]]:
        raise RecordingError(f"no {kind} {', '.join(missing)} in the calibration", file=file)
    matrix = np.array([_numbers(rows[kind][axis], "values", 6, file) for axis in AXES])
    full_scale = np.array([_numbers(rows[kind][axis], "max", 1, file)[0] for axis in AXES])
    if np.any(full_scale <= 0):
        raise RecordingError("the rating of an axis is not positive", file=file)
    if kind == "Axis":
        scale = np.array([_numbers(rows[kind][axis], "scale", 1, file) for axis in AXES])
        if np.any(scale == 0):
            raise RecordingError("the scale of an axis is zero", file=file)
        matrix = matrix / scale
        transform = next((values for name, values in elements if name == "BasicTransform"), {})
        if any(
            _numbers(transform, turn, 1, file)[0]
            for turn in ("Rx", "Ry", "Rz")
            if turn in transform
        ):
            raise RecordingError(
                "the basic transform turns the axes; ask for a calibration with UserAxis rows",
                file=file,
            )
        offset = np.array(
            [
                _numbers(transform, shift, 1, file)[0] if shift in transform else 0.0
                for shift in ("Dx", "Dy", "Dz")
            ]
        )
        offset *= _lever(stated[0], file) if offset.any() else 1.0
        # torque about the transducer's origin, which lies at the offset in the gauges' frame
        matrix[3:] -= np.cross(offset, matrix[:3], axisb=0, axisc=0)
    return Calibration(
        Path(file), serial, stated[0]["ForceUnits"], stated[0]["TorqueUnits"], matrix, full_scale
    )


def _lever(stated: dict[str, str], file: Path) -> float:
    """The unit of distances over the arm's length that the unit of torque has to that of force; 1
    where no distance is stated.
    """
    if "DistUnits" not in stated:
        return 1.0
    force, torque = (plain_unit(stated[f"{quantity}Units"]) for quantity in ("Force", "Torque"))
    if (
        force not in FORCE_UNITS
        or torque not in TORQUE_UNITS
        or stated["DistUnits"] not in LENGTH_UNITS
    ):
        units = ", ".join(stated[f"{quantity}Units"] for quantity in ("Force", "Torque", "Dist"))
        raise RecordingError(
            f"the units {units} are not all known, and the basic transform needs them", file=file
        )
    return LENGTH_UNITS[stated["DistUnits"]] * FORCE_UNITS[force] / TORQUE_UNITS[torque]


def _elements(file: Path) -> list[tuple[str, dict[str, str]]]:
    elements: list[tuple[str, dict[str, str]]] = []

    def refuse(*_: object) -> None:
        raise RecordingError(
            "the calibration declares a document type or entities, which no calibration needs",
            file=file,
        )

    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda name, values: elements.append((name, values))
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(read_whole(file), True)
    except OSError as error:
        raise RecordingError(f"the file cannot be read ({error.strerror})", file=file) from None
    except expat.ExpatError as error:
        raise RecordingError(
            f"this is no XML ({expat.ErrorString(error.code)})", file=file, line=error.lineno
        ) from None
    except (LookupError, ValueError) as error:
        raise RecordingError(
            f"the encoding that the XML announces cannot be read ({error}); save it as UTF-8",
            file=file,
            line=1,
        ) from None
    return elements


def _numbers(values: dict[str, str], name: str, count: int, file: Path) -> list[float]:
    try:
        numbers = [float(word) for word in values[name].split()]
    except (KeyError, ValueError):
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        message = (
            f"{name} of {values.get('Name', 'the basic transform')} must be {count} "
            f"finite number(s), not {values.get(name)!r}"
        )
        raise RecordingError(message, file=file)
    return numbers


FORMAT = Format(
    "ATI calibration",
    Kind.CALIBRATION,
    read_calibration,
    is_xml("FTSensor", "Calibration", "UserAxis"),
)
