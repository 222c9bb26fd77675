"""A record of one force/torque transducer, the options of its log, its units, and samples that the
sensor did not measure.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.calibration import Calibration
from pipeline.formats.units import FORCE_UNITS, TORQUE_UNITS, plain_unit

FORCES, TORQUES = ("fx", "fy", "fz"), ("tx", "ty", "tz")
OPTION = "dataset.force.log"
FEWEST = 10  # samples of a record; what holds fewer may be settings that look like numbers
AXIS = re.compile(r"(?:.*[./])?(f|force|t|torque|m|moment)[ _.]?([xyz])\s*(?:[(\[].*[)\]])?")


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
    """Options for what a force log does not say (section dataset.force.log); None where it does."""

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


NO_OPTIONS = ForceLogOptions()


def si_factors(
    stated: Mapping[str, str | None], options: ForceLogOptions, **where: object
) -> np.ndarray:
    """Return the factor to N or N·m of each axis of ``stated``, by the unit there, else by the
    option, else by the calibration. RecordingError with the option for an unknown or missing unit,
    and where log and option differ.
    """
    factors = []
    for axis, own in stated.items():
        kind, units = ("force", FORCE_UNITS) if axis in FORCES else ("torque", TORQUE_UNITS)
        option = getattr(options, f"{kind}_unit")
        unit = own or option or getattr(options.calibration, f"{kind}_unit", None)
        message = ""
        if unit is None or plain_unit(unit) not in units:
            problem = f"{axis} has no known unit" + (f" ({unit!r})" if unit else "")
            message = f"{problem}: state one of {', '.join(units)} as {kind}_unit"
            message += ", or the calibration"
        elif own and option and units.get(plain_unit(option)) != units[plain_unit(unit)]:
            message = f"{axis} is in {unit} by the log and in {option} by the option"
        if message:
            raise RecordingError(message, key=f"{OPTION}.{kind}_unit", **where)
        factors.append(units[plain_unit(unit)])
    return np.array(factors)


def calibrated_factors(calibration: Calibration, options: ForceLogOptions) -> np.ndarray:
    """Return (6,) the factors from the units of a calibration to N and N·m."""
    units = dict.fromkeys(FORCES, calibration.force_unit)
    units |= dict.fromkeys(TORQUES, calibration.torque_unit)
    return si_factors(units, options, file=calibration.file, line=1)


def full_scale(calibration: Calibration | None) -> np.ndarray | None:
    """Return (6,) the ratings of a calibration in N and N·m, None without one."""
    return calibration and calibration.full_scale * calibrated_factors(calibration, NO_OPTIONS)


def repeats(values: np.ndarray) -> dict[str, int]:
    """Return ``repeated_rows`` (equal to the row before) and ``zero_rows`` of ``values``
    (N, axes).
    """
    repeated = (values[1:] == values[:-1]).all(axis=1).sum()
    return {"repeated_rows": int(repeated), "zero_rows": int((values == 0).all(axis=1).sum())}


def with_torque(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return forces and torques (N, 3) of ``values`` (N, 3 or 6); NaN where none were logged."""
    missing = np.full((len(values), 3), np.nan)
    return values[:, :3], values[:, 3:] if values.shape[1] == 6 else missing


def axis_of(label: str) -> str | None:
    """Return which of fx … tz a label such as ``Force X (N)``, ``Fx`` or ``Mz [N-m]`` names."""
    match = AXIS.fullmatch(label.strip().lower())
    return ("f" if match[1].startswith("f") else "t") + match[2] if match else None


def require_record(record: ForceRecord, file: object) -> None:
    """Raise RecordingError where ``record`` holds too few samples to be one."""
    if (held := len(record.time)) < FEWEST:
        first = ", ".join(f"{force:g}" for force in record.force[0])
        message = f"{held} sample(s), at least {FEWEST} are needed; the first is {first} N, "
        message += "which may be a line of settings below a header: record again"
        raise RecordingError(message, file=file)


def saturated(record: ForceRecord, full_scale: np.ndarray) -> np.ndarray:
    """Return (N,) whether any axis of a sample is at or beyond ``full_scale`` (3,) N or (6,) N and
    N·m; torques that were not logged are not.
    """
    values = np.hstack([record.force, record.torque])[:, : len(full_scale)]
    return np.any(np.abs(values) >= full_scale, axis=1)


def frozen(record: ForceRecord, longest: float) -> np.ndarray:
    """Return (N,) whether a sample is one of identical ones that last longer than ``longest`` (s).

    Noise keeps a working sensor from repeating all its axes for long; a program that reads faster
    than the sensor samples repeats a few.
    """
    values = np.hstack([record.force, np.nan_to_num(record.torque)])
    starts = np.flatnonzero(np.append(True, (values[1:] != values[:-1]).any(axis=1)))
    ends = np.append(starts[1:], len(values))
    lasting = record.time[ends - 1] - record.time[starts]
    return np.repeat(lasting > longest, ends - starts)


def sound_samples(
    record: ForceRecord,
    full_scale: np.ndarray | None,
    longest: float,
    share: float,
    *,
    file: object,
) -> tuple[np.ndarray, dict[str, int]]:
    """Return (N,) whether a sample was measured, and the numbers of saturated (where ``full_scale``
    is known) and frozen samples, if any. RecordingError where a fault is in more than the given
    ``share`` of the samples, and for too few samples.
    """
    require_record(record, file)
    faulty = {"frozen": (frozen(record, longest), "frozen_after")}
    if full_scale is not None:
        faulty["saturated"] = saturated(record, full_scale), "full_scale"
    for name, (samples, option) in faulty.items():
        if samples.mean() > share:
            first = f"the first at {record.time[samples][0]:.6g} s; a share of {share:g} may be"
            message = f"{samples.sum()} of {len(samples)} samples are {name}, {first}"
            raise RecordingError(message, file=file, key=f"{OPTION}.{option}")
    counts = {f"{name}_samples": int(found.sum()) for name, (found, _) in faulty.items()}
    sound = ~np.any([samples for samples, _ in faulty.values()], axis=0)
    return sound, {name: count for name, count in counts.items() if count}
