"""A record of one force/torque transducer, what an option may say of its log, and the units such
logs are written in.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.calibration import Calibration
from pipeline.formats.units import FORCE_UNITS, TORQUE_UNITS, plain_unit

FORCES, TORQUES = ("fx", "fy", "fz"), ("tx", "ty", "tz")
OPTION = "dataset.force.log"


@dataclass(frozen=True)
class ForceRecord:
    """N samples of one sensor in the sensor's frame."""

    time: np.ndarray  # (N,) s since the first recorded sample
    force: np.ndarray  # (N, 3) N
    torque: np.ndarray  # (N, 3) N·m, NaN where the log holds forces alone
    rate: float  # Hz, nominal
    serial: str
    started: str  # as the PC printed it
    counts: dict[str, int]  # see the reader


@dataclass(frozen=True)
class ForceLogOptions:
    """What settles a force log where it does not say so itself; None where it does (section
    dataset.force.log).
    """

    # t, fx … tz → label, or number from 0
    columns: Mapping[str, str | int] = field(default_factory=dict)
    separator: str | None = None
    decimal: str | None = None
    force_unit: str | None = None
    torque_unit: str | None = None
    time_unit: str | None = None
    rate: float | None = None  # Hz
    counts: bool | None = None  # whether a Net F/T log holds counts
    calibration: Calibration | None = None
    topic: str | None = None  # of a bag


def si_factors(
    axes: list[str],
    stated: Mapping[str, str | None],
    options: ForceLogOptions,
    *,
    file: Path,
    line: int,
) -> np.ndarray:
    """(len(axes),) what turns each axis into N or N·m: as ``stated`` beside it in the log, else as
    the option, else the calibration says.

    Raises RecordingError that names the options for a unit that nothing states or that is unknown,
    and where log and option differ.
    """
    factors = []
    for axis in axes:
        key, units = (
            ("force_unit", FORCE_UNITS) if axis in FORCES else ("torque_unit", TORQUE_UNITS)
        )
        option = getattr(options, key)
        calibrated = options.calibration and getattr(options.calibration, key)
        unit = stated.get(axis) or option or calibrated
        known = ", ".join(units)
        if unit is None or plain_unit(unit) not in units:
            problem = f"{axis} has no known unit" + (f" ({unit!r})" if unit else "")
            raise RecordingError(
                f"{problem}: state one of {known} as {key}, or the calibration",
                file=file,
                line=line,
                key=f"{OPTION}.{key}",
            )
        if stated.get(axis) and option and units.get(plain_unit(option)) != units[plain_unit(unit)]:
            message = f"{axis} is in {unit} by the log and in {option} by the option"
            raise RecordingError(message, file=file, line=line, key=f"{OPTION}.{key}")
        factors.append(units[plain_unit(unit)])
    return np.array(factors)


def full_scale(calibration: Calibration | None) -> np.ndarray | None:
    """(6,) the ratings of a calibration in N and N·m, where there is one."""
    if calibration is None:
        return None
    units = dict.fromkeys(FORCES, calibration.force_unit) | dict.fromkeys(
        TORQUES, calibration.torque_unit
    )
    return calibration.full_scale * si_factors(
        [*FORCES, *TORQUES], units, ForceLogOptions(), file=calibration.file, line=1
    )


def check_columns(columns: Mapping[str, str | int], *, file: Path) -> None:
    """RecordingError where the option names an axis that does not exist, not every force, or some
    of the torques.
    """
    key = f"{OPTION}.columns"
    if unknown := sorted(set(columns) - {"t", *FORCES, *TORQUES}):
        raise RecordingError(
            f"no axis {', '.join(unknown)}; there are t, fx, fy, fz, tx, ty, tz", file=file, key=key
        )
    if missing := [axis for axis in FORCES if axis not in columns]:
        raise RecordingError(f"no column is named for {', '.join(missing)}", file=file, key=key)
    if 0 < len(set(TORQUES) & set(columns)) < 3:
        raise RecordingError("of the torques tx, ty, tz name all or none", file=file, key=key)


def check_serial(serial: str, options: ForceLogOptions, *, file: Path) -> None:
    """RecordingError where log and calibration both name a transducer, and not the same."""
    theirs = options.calibration.serial if options.calibration else ""
    if serial and theirs and serial != theirs:
        message = f"the log is of the transducer {serial}, the calibration of {theirs}"
        raise RecordingError(message, file=file, key=f"{OPTION}.calibration")


def repeats(values: np.ndarray) -> dict[str, int]:
    """``repeated_rows`` (equal to the row before) and ``zero_rows`` of samples (N, axes)."""
    return {
        "repeated_rows": int((values[1:] == values[:-1]).all(axis=1).sum()),
        "zero_rows": int((values == 0).all(axis=1).sum()),
    }


def with_torque(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces and torques (N, 3) of samples (N, 3 or 6); torques that were not logged are NaN."""
    return values[:, :3], values[:, 3:] if values.shape[1] == 6 else np.full(
        (len(values), 3), np.nan
    )


def axis_of(label: str) -> str | None:
    """Which of fx … tz a label such as ``Force X (N)``, ``Fx`` or ``Mz [N-m]`` stands for; None for
    any other.
    """
    match = re.fullmatch(
        r"(?:.*[./])?(f|force|t|torque|m|moment)[ _.]?([xyz])\s*(?:[(\[].*[)\]])?",
        label.strip().lower(),
    )
    return ("f" if match[1].startswith("f") else "t") + match[2] if match else None
