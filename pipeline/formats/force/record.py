"""A record of one force/torque transducer, the options of its log, and its units; samples that the
sensor did not measure; tables of forces from any program: options or labels say which column is
which, options or the header in which unit.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.calibration import Calibration
from pipeline.formats.format import Format, Kind
from pipeline.formats.number_sheet import Sheet, read_sheet
from pipeline.formats.units import FORCE_UNITS, TIME_UNITS, TORQUE_UNITS, bare, plain_unit, spelled

FORCES, TORQUES = ("fx", "fy", "fz"), ("tx", "ty", "tz")
OPTION = "dataset.force.log"
KEY = f"{OPTION}.columns"
FEWEST = 10  # samples of a record; what holds fewer may be settings that look like numbers
AXIS = re.compile(
    r"(?:.*[./]|.*_(?=force|torque))?(f|force|t|torque|m|moment)[ _./-]?([xyz])\s*(?:[(\[].*[)\]])?"
)
TIMES = re.compile(r"t|time[ _-]?(stamp)?", re.IGNORECASE)
NUMBERS = re.compile(r"(sample|(rdt )?sequence|packet)( ?(number|no\.?|#))?", re.IGNORECASE)
JITTER = 0.1  # of the median step


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
    units: Mapping[str, str] = field(default_factory=dict)  # as the log states them
    marks: Mapping[str, str] = field(default_factory=dict)  # separator and decimal of a table


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
    """Return ``repeated_rows`` (equal to the row before) and ``zero_rows`` of (N, axes) values."""
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
    """Return (N,) whether a sample is one of identical ones that last longer than ``longest`` (s):
    noise keeps a working sensor from that, a program that reads faster repeats a few.
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


def read_force_table(file: Path, options: ForceLogOptions) -> ForceRecord:
    """Return the record in ``file``, in N, N·m and s, of the columns that ``options`` name: fx, fy,
    fz, and as there are t, tx, ty, tz; without any name, of those whose labels say what they are.
    Without a column t, samples follow each other at the option's rate.

    ``counts``: ``repeated_rows`` and ``zero_rows``, both kept; ``blank_rows``; ``cut_rows``; and
    with times those of :func:`read_clock`. Raises RecordingError, with the line and the option that
    settles it, for axes or units that nothing names, a time that goes back, and malformed rows.
    """
    sheet = force_sheet(file, options)

    def rate() -> float:
        if options.rate is None:
            message = "neither a column t nor a rate gives the samples a time; set rate to the "
            raise RecordingError(f"{message}samples a second", file=file, key=f"{OPTION}.rate")
        return options.rate

    return timed_record(sheet, axis_values(sheet, options), options, rate)


def force_sheet(file: Path, options: ForceLogOptions, **form: str) -> Sheet:
    """Return the table in ``file``; RecordingError where it has no sample or lacks a column."""
    form = {"separator": options.separator, "decimal": options.decimal} | form
    sheet = read_sheet(file, key=OPTION, **form)
    if not sheet.rows:
        message = "no whole sample below the labels: no line holds numbers; record again"
        raise RecordingError(message, file=file, line=sheet.header_lines[-1])
    sheet.require_cells()
    return sheet


def axis_values(
    sheet: Sheet,
    options: ForceLogOptions,
    stated: Mapping[str, str | None] | None = None,
    per_unit: np.ndarray | float = 1.0,
) -> np.ndarray:
    """Return (N, 3 or 6) forces in N and, where there are any, torques in N·m; units of the axes
    are those ``stated``, else those of the header, and ``per_unit`` numbers are one of them.
    """
    columns = axis_columns(sheet, options)
    stated = stated or {axis: sheet.unit(column) for axis, column in columns.items()}
    factors = si_factors(stated, options, file=sheet.file, line=sheet.label_line)
    return sheet.values([*columns.values()]) * (factors / per_unit)


def axis_columns(sheet: Sheet, options: ForceLogOptions) -> dict[str, int]:
    """Return the column of each axis, the three forces and, where there are any, the three torques:
    by the options, else by the labels.
    """
    named = {axis: column for axis, column in options.columns.items() if axis != "t"}
    message = ""
    if unknown := sorted({*named} - {*FORCES, *TORQUES}):
        message = f"no axis {', '.join(unknown)}; there are t, fx, fy, fz, tx, ty, tz"
    for column, label in enumerate(() if options.columns else sheet.labels):
        if (axis := axis_of(label)) in named:
            message = f"two columns are labelled {sheet.labels[named[axis]]}; name each axis by its"
            message += " number in columns"
        named |= {axis: column} if axis else {}
    wanted = [*FORCES, *(TORQUES if {*TORQUES} & {*named} else ())]
    if (missing := [axis for axis in wanted if axis not in named]) and not message:
        there = f", only {', '.join(sheet.labels)}" if sheet.labels else ""
        message = f"no column is named or labelled {', '.join(missing)}{there}; correct the labels,"
        message += " or name the forces and all torques or none in columns"
    if message:
        raise RecordingError(message, file=sheet.file, line=sheet.label_line, key=KEY)
    return sheet.columns({axis: named[axis] for axis in wanted}, KEY)


def timed_record(
    sheet: Sheet,
    values: np.ndarray,
    options: ForceLogOptions,
    rate: Callable[[], float],
) -> ForceRecord:
    """Return the record of ``values`` (N, axes), timed by a column of times or sample numbers, else
    by the ``rate``.
    """
    labels = [bare(label) for label in sheet.labels]
    fits = [n for kind in (TIMES, NUMBERS) for n, name in enumerate(labels) if kind.fullmatch(name)]
    named = options.columns.get("t") if options.columns else next(iter(fits), None)
    clocked: dict[str, int] = {}
    if named is None:
        frequency = rate()
        time = np.arange(len(values)) / frequency
    else:
        column = sheet.columns({"t": named}, KEY)["t"]
        numbered = bool(labels) and NUMBERS.fullmatch(labels[column]) is not None
        scale = rate() if numbered else _unit_of_time(sheet, column, options)
        ticks = sheet.values([column])[:, 0]
        time = (ticks - ticks[0]) / scale if numbered else (ticks - ticks[0]) * scale
        keep, clocked = read_clock(time, values, sheet.lines, place="line", file=sheet.file)
        time, values = time[keep], values[keep]
        frequency = scale if numbered else rate_of(time)
    counts = repeats(values) | sheet.counts | clocked
    marks = {"separator": sheet.separator, "decimal": sheet.decimal}
    return ForceRecord(time, *with_torque(values), frequency, "", "", counts, {}, marks)


def _unit_of_time(sheet: Sheet, column: int, options: ForceLogOptions) -> float:
    """Return the unit of the ``column`` of times in s, of the header, else of the option."""
    stated, option = sheet.unit(column), options.time_unit
    unit, message = spelled(stated) if stated else option, ""
    if unit not in TIME_UNITS:
        problem = f"the time has no known unit{f' ({unit!r})' if unit else ''}"
        message = f"{problem}: state one of {', '.join(TIME_UNITS)}"
    elif stated and option and unit != spelled(option):
        message = f"the time is in {unit} by the log and in {option} by the option"
    if message:
        where = {"file": sheet.file, "line": sheet.label_line, "key": f"{OPTION}.time_unit"}
        raise RecordingError(message, **where)
    return TIME_UNITS[unit]


def read_clock(
    time: np.ndarray, values: np.ndarray, places: list[int], *, place: str, file: object
) -> tuple[np.ndarray, dict[str, int]]:
    """Return which of N samples to keep (N,), and counts of what their ``time`` (N,) in s shows of
    ``values`` (N, axes).

    Counts: ``doubled_rows`` (the same sample at the same time, not kept), ``equal_times`` (another
    sample at the same time, kept), ``uneven_steps`` (off the median by more than a tenth of it:
    jitter) and ``missing_samples`` (that would fit into the longer steps). Raises RecordingError,
    with the number in ``places`` (N) of the ``place`` (line, sample) there, for a time that goes
    back, and for one that most samples share with the one before.
    """
    steps = np.diff(time)
    if (steps < 0).any():
        row = int(np.argmax(steps < 0)) + 1
        message = f"the time goes back to {time[row]:.9g} s: rows are swapped or of two recordings"
        raise RecordingError(message, file=file, **{place: places[row]})
    doubled = (steps == 0) & (values[1:] == values[:-1]).all(axis=1)
    keep = np.append(True, ~doubled)
    steps = np.diff(time[keep])
    median = float(np.median(steps)) if len(steps) else 0.0
    if len(steps) and median == 0:
        message = "most samples share their time with the one before: no clock"
        raise RecordingError(message, file=file, **{place: places[0]})
    return keep, {
        "doubled_rows": int(doubled.sum()),
        "equal_times": int(np.sum(steps == 0)),
        "uneven_steps": int(np.sum(np.abs(steps - median) > JITTER * median)),
        "missing_samples": int(np.sum(np.rint(steps[steps > 1.5 * median] / median) - 1)),
    }


def rate_of(time: np.ndarray) -> float:
    """Return samples a second by the median step of ``time`` (N,) in s; NaN of a single sample."""
    return float(1 / np.median(np.diff(time))) if len(time) > 1 else float("nan")


FORMAT = Format("table of forces", Kind.FORCE, read_force_table, option="table")
