"""Calibrations of ATI transducers (``.cal`` files, XML): units, ratings, and the matrix from gauge
voltages to forces about the transducer's origin, in the elements ``UserAxis``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import UNITS, plain_unit
from pipeline.formats.format import Format, Kind, decoded, file_content, is_xml

AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")


@dataclass(frozen=True)
class Calibration:
    """Calibration of one transducer."""

    file: Path
    serial: str
    force_unit: str  # units of the file, which logs of the transducer may not repeat
    torque_unit: str
    matrix: np.ndarray  # (6, 6) N and N·m per volt of the six gauges
    full_scale: np.ndarray  # (6,) rated loads fx, fy, fz in N and tx, ty, tz in N·m


def read_calibration(file: Path) -> Calibration:
    """Return the calibration in ``file``; RecordingError for a file that is no XML or does not have
    one calibration, and for an axis without six gauges or a rating.
    """
    try:
        # parse text, since the encoding in the first line may be wrong
        elements = [*ElementTree.fromstring(decoded(file_content(file)) or "").iter()]
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        line = {"line": error.position[0]} if hasattr(error, "position") else {}
        message = f"this is no XML ({error}); copy it again"
        raise RecordingError(message, file=file, **line) from None
    serial = next(
        (one.attrib["Serial"] for one in elements if "Serial" in one.attrib), ""
    )
    stated = [
        one.attrib for one in elements if {"ForceUnits", "TorqueUnits"} <= {*one.attrib}
    ]
    rows = {one.get("Name"): one.attrib for one in elements if one.tag == "UserAxis"}
    try:
        (units,) = stated
        names = {"force": units["ForceUnits"], "torque": units["TorqueUnits"]}
        factors = [
            UNITS[kind].get(plain_unit(name), np.nan) for kind, name in names.items()
        ]
        factors = np.repeat(factors, 3)
        matrix, full_scale = _numbers(rows, "values", 6), _numbers(rows, "max", 1)
        if full_scale.min() <= 0:
            raise ValueError("max of an axis must be above 0")
        if np.isnan(factors).any():
            raise ValueError(f"{' or '.join(names.values())} is no known unit")
    except (KeyError, ValueError) as error:
        message = "the file must have one calibration with ForceUnits, TorqueUnits and UserAxis of "
        message += f"{', '.join(AXES)} ({error}); copy it again, or get a calibration of version "
        message += "1.1 or later from ATI"
        raise RecordingError(message, file=file) from None
    matrix, full_scale = factors[:, None] * matrix, factors * full_scale[:, 0]
    return Calibration(Path(file), serial, *names.values(), matrix, full_scale)


def _numbers(
    rows: Mapping[str, Mapping[str, str]], name: str, count: int
) -> np.ndarray:
    numbers = [[*map(float, rows[axis][name].split())] for axis in AXES]
    if {*map(len, numbers)} != {count} or not np.isfinite(numbers).all():
        raise ValueError(f"{name} of an axis must be {count} finite number(s)")
    return np.array(numbers)


MARKS = is_xml("FTSensor", "Calibration", "UserAxis")
FORMAT = Format("ATI calibration", Kind.CALIBRATION, read_calibration, MARKS)
