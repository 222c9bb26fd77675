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
    """Return the calibration in ``file``; RecordingError for a file that is not XML or has
    another number of calibrations than one, and for an axis without six gauges or a rating.
    """
    try:
        # parse text, since the encoding in the first line may be wrong
        elements = [*ElementTree.fromstring(decoded(file_content(file)) or "").iter()]
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        line = {"line": error.position[0]} if hasattr(error, "position") else {}
        message = f"this is no XML ({error}); copy it again"
        raise RecordingError(message, file=file, **line) from None
    serials = []
    stated = []
    axes = {}
    for element in elements:
        attributes = element.attrib
        if "Serial" in attributes:
            serials.append(attributes["Serial"])
        if {"ForceUnits", "TorqueUnits"} <= attributes.keys():
            stated.append(attributes)
        if element.tag == "UserAxis":
            axes[element.get("Name")] = attributes
    try:
        (units,) = stated
        force = units["ForceUnits"]
        torque = units["TorqueUnits"]
        newtons = UNITS["force"].get(plain_unit(force))
        newton_metres = UNITS["torque"].get(plain_unit(torque))
        matrix = _numbers(axes, "values", 6)
        full_scale = _numbers(axes, "max", 1)[:, 0]
        if full_scale.min() <= 0:
            raise ValueError("max of an axis must be above 0")
        if newtons is None or newton_metres is None:
            raise ValueError(f"{force} or {torque} is no known unit")
    except (KeyError, ValueError) as error:
        raise RecordingError(
            "the file must have one calibration with ForceUnits, TorqueUnits and UserAxis of "
            f"{', '.join(AXES)} ({error}); copy it again, or get a calibration of version 1.1 or "
            "later from ATI",
            file=file,
        ) from None
    factors = np.repeat([newtons, newton_metres], 3)
    return Calibration(
        file=Path(file),
        serial=serials[0] if serials else "",
        force_unit=force,
        torque_unit=torque,
        matrix=factors[:, None] * matrix,
        full_scale=factors * full_scale,
    )


def _numbers(
    axes: Mapping[str, Mapping[str, str]],
    name: str,
    count: int,
) -> np.ndarray:
    """Return the numbers (6, ``count``) in the attribute ``name`` of the six axes."""
    numbers = []
    for axis in AXES:
        numbers.append([float(word) for word in axes[axis][name].split()])
    lengths = {len(row) for row in numbers}
    if lengths != {count} or not np.isfinite(numbers).all():
        raise ValueError(f"{name} of an axis must be {count} finite number(s)")
    return np.array(numbers)


MARKS = is_xml("FTSensor", "Calibration", "UserAxis")
FORMAT = Format("ATI calibration", Kind.CALIBRATION, read_calibration, MARKS)
