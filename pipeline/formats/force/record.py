"""Records of one force/torque transducer: options and units of logs, faulty samples, tables of
forces with columns and units by options, labels or header, and WrenchStamped messages of ROS bags,
in N and N·m by definition.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats import rosbag
from pipeline.formats.delimited import (
    UNITS,
    bare,
    is_rowlike,
    plain_unit,
    separator_of,
    spelled,
    split_line,
)
from pipeline.formats.force.calibration import Calibration
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.number_sheet import Sheet, read_sheet

FORCES = ("fx", "fy", "fz")
TORQUES = ("tx", "ty", "tz")
KINDS = {
    **dict.fromkeys(FORCES, "force"),
    **dict.fromkeys(TORQUES, "torque"),
    "t": "time",
}
OPTION = "dataset.force.log"
KEY = f"{OPTION}.columns"
HEADER_LINES = 40  # lines in which the labels of a table of forces are looked for
# least number of samples; fewer rows may be settings that look like numbers
FEWEST = 10
AXIS = re.compile(
    r"(?:.*[./]|.*_(?=force|torque))?(f|force|t|torque|m|moment)[ _./-]?([xyz])"
    r"\s*(?:[(\[].*[)\]])?",
)
TIMES = re.compile(r"t|x_value|time[ _-]?(stamp)?", re.IGNORECASE)
NUMBERS = re.compile(
    r"(sample|(rdt )?sequence|packet)( ?(number|no\.?|#))?",
    re.IGNORECASE,
)
WRENCH = ("geometry_msgs/msg/WrenchStamped",)
# share of equal neighbours; more are of a sensor of coarse resolution
EQUAL_PAIRS = 0.1
JITTER = 0.1  # greatest deviation of an even step, over the median step


@dataclass(frozen=True)
class ForceRecord:
    """N samples of one transducer in the transducer's frame."""

    time: np.ndarray  # (N,) s since the first recorded sample
    force: np.ndarray  # (N, 3) N
    torque: np.ndarray  # (N, 3) N·m, NaN if the log has no torques
    rate: float  # Hz, nominal
    serial: str = ""
    started: str = ""  # start time as printed in the log
    counts: Mapping[str, int] = field(default_factory=dict)  # see the reader
    # quantity → unit stated in the log
    units: Mapping[str, str] = field(default_factory=dict)
    # separator and decimal of a table
    marks: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ForceLogOptions:
    """Facts that a force log does not state (section dataset.force.log); None if it does."""

    # t, fx … tz → column label, or column number from 0
    columns: Mapping[str, str | int] = field(default_factory=dict)
    separator: str | None = None
    decimal: str | None = None
    force_unit: str | None = None
    torque_unit: str | None = None
    time_unit: str | None = None
    rate: float | None = None  # Hz
    counts: bool | None = None  # whether a Net F/T log holds counts
    calibration: Calibration | None = None
    topic: str | None = None  # topic of a bag


NO_OPTIONS = ForceLogOptions()


def si_factor(
    quantity: str,
    stated: str | None,
    options: ForceLogOptions,
    **where: object,
) -> float:
    """Return the factor to N, N·m or s of a ``quantity`` (KINDS), from the unit ``stated`` in the
    log, else in the options, else in the calibration. RecordingError for no known unit, and where
    log and options differ.
    """
    kind = KINDS[quantity]
    units = UNITS[kind]
    option = getattr(options, f"{kind}_unit")
    calibrated = getattr(options.calibration, f"{kind}_unit", None)
    plain = spelled if kind == "time" else plain_unit
    words = [word for word in (stated, option, calibrated) if word]
    factors = [units.get(plain(word)) for word in words]
    differ = stated and option and factors[0] != factors[1]
    if not factors or factors[0] is None or differ:
        raise RecordingError(
            f"{quantity} has no known unit: {stated!r} in the log, {option!r} by the option; set "
            f"{kind}_unit to one of {', '.join(units)}",
            key=f"{OPTION}.{kind}_unit",
            **where,
        )
    return factors[0]


def repeats(values: np.ndarray) -> dict[str, int]:
    """Return ``repeated_rows`` (equal to the row before) and ``zero_rows`` of (N, axes) values."""
    repeated = (values[1:] == values[:-1]).all(axis=1)
    zero = (values == 0).all(axis=1)
    return {"repeated_rows": int(repeated.sum()), "zero_rows": int(zero.sum())}


def axis_of(label: str) -> str | None:
    """Return the axis, fx to tz, of a label such as ``Force X (N)``, ``Fx`` or ``Mz [N-m]``."""
    match = AXIS.fullmatch(label.strip().lower())
    if match is None:
        return None
    quantity = "f" if match[1].startswith("f") else "t"
    return quantity + match[2]


def require_record(record: ForceRecord, file: object) -> None:
    """Raise RecordingError where ``record`` has fewer than FEWEST samples."""
    count = len(record.time)
    if count < FEWEST:
        raise RecordingError(
            f"{count} sample(s), at least {FEWEST} are required; the first is {record.force[0]} N, "
            "which may be a line of settings: record again",
            file=file,
        )


def sound_samples(
    record: ForceRecord,
    full_scale: np.ndarray | None,
    longest: float,
    share: float,
    *,
    file: object,
) -> tuple[np.ndarray, dict[str, int]]:
    """Return the mask (N,) of sound samples, and the numbers of frozen samples (constant for longer
    than ``longest`` s) and saturated samples (an axis at or beyond ``full_scale``, (3,) N or (6,) N
    and N·m, or on a :func:`plateau`). RecordingError where more than a ``share`` of the samples is
    frozen or saturated, and for fewer than FEWEST samples.
    """
    require_record(record, file)
    values = np.hstack([record.force, np.nan_to_num(record.torque)])
    changed = (values[1:] != values[:-1]).any(axis=1)
    starts = np.flatnonzero(np.append(True, changed))
    ends = np.append(starts[1:], len(values))
    lasting = record.time[ends - 1] - record.time[starts]
    saturated = plateau(values)
    if full_scale is not None:
        loads = np.abs(values[:, : len(full_scale)])
        saturated |= (loads >= full_scale).any(axis=1)
    faulty = {
        "frozen": np.repeat(lasting > longest, ends - starts),
        "saturated": saturated,
    }
    limits = {"frozen": "frozen_after", "saturated": "full_scale"}  # fault → option
    sound = np.ones(len(values), bool)
    counts = {}
    for name, samples in faulty.items():
        number = int(samples.sum())
        if samples.mean() > share:
            raise RecordingError(
                f"{number} of {len(samples)} samples are {name}, the first at "
                f"{record.time[samples][0]:.6g} s; a share of {share:g} is allowed",
                file=file,
                key=f"{OPTION}.{limits[name]}",
            )
        sound &= ~samples
        if number:
            counts[f"{name}_samples"] = number
    return sound, counts


def plateau(values: np.ndarray) -> np.ndarray:
    """Return the mask (N,) of samples at the greatest or least value of an axis of ``values`` (N,
    axes), where an amplifier cuts them: the extreme occurs at least FEWEST times in pairs of equal
    neighbours, while at most EQUAL_PAIRS of the other neighbours are equal, so that the
    resolution is not coarse.
    """
    cut = np.zeros(len(values), bool)
    same = values[1:] == values[:-1]
    for extreme in (values.max(axis=0), values.min(axis=0)):
        at_extreme = values == extreme
        pairs = (same & at_extreme[1:]).sum(axis=0)
        elsewhere = len(same) - at_extreme[1:].sum(axis=0)
        equal_elsewhere = same.sum(axis=0) - pairs
        is_fine = equal_elsewhere <= EQUAL_PAIRS * elsewhere
        is_cut = (elsewhere > 0) & is_fine & (pairs >= FEWEST)
        cut |= (at_extreme & is_cut).any(axis=1)
    return cut


def timed_record(
    time: np.ndarray,
    values: np.ndarray,
    place: str,
    rows: Sequence[int],
    file: Path,
    **more: Any,
) -> ForceRecord:
    """Return the record of ``values`` (N, axes) at ``time`` (N,) s, and ``more`` of its fields.
    Counts are added: :func:`repeats`, ``doubled_rows`` (sample and time equal to the row before;
    left out), ``equal_times`` (only the time equal; kept), ``uneven_steps`` (off the median step by
    more than JITTER of it) and ``missing_samples`` (in long steps). RecordingError, with the entry
    of ``rows`` (N,) as ``place``, where the time decreases or most steps are 0.
    """
    time = time - time[0] if len(time) else time
    steps = np.diff(time)
    equal = (values[1:] == values[:-1]).all(axis=1)
    distinct = np.append(True, (steps != 0) | ~equal)
    clock_steps = np.diff(time[distinct])
    median = float(np.median(clock_steps)) if len(clock_steps) else np.nan
    back = steps < 0
    if back.any():
        row = int(np.argmax(back)) + 1
        message = f"the time goes back to {time[row]:.9g} s: rows are swapped or of two recordings"
        raise RecordingError(message, file=file, **{place: rows[row]})
    if median == 0:
        message = "most samples have the same time as the sample before: no clock"
        raise RecordingError(message, file=file, **{place: rows[0]})
    uneven = np.abs(clock_steps - median) > JITTER * median
    long = clock_steps[clock_steps > 1.5 * median]
    counts = more.pop("counts", {}) | {
        "doubled_rows": int((~distinct).sum()),
        "equal_times": int(np.sum(clock_steps == 0)),
        "uneven_steps": int(np.sum(uneven)),
        "missing_samples": int(np.sum(np.rint(long / median) - 1)),
    }
    more = {"rate": 1 / median} | more
    return _record(time[distinct], values[distinct], counts, **more)


def _record(
    time: np.ndarray,
    values: np.ndarray,
    counts: Mapping[str, int],
    **more: Any,
) -> ForceRecord:
    torque = np.full((len(values), 3), np.nan)
    if values.shape[1] == 6:
        torque = values[:, 3:]
    counts = repeats(values) | {**counts}
    return ForceRecord(time, values[:, :3], torque, counts=counts, **more)


def read_force_table(file: Path, options: ForceLogOptions) -> ForceRecord:
    """Return the record in ``file``, in N, N·m and s, from the columns named in options or labels:
    fx, fy, fz, and optionally t, tx, ty, tz. Without t, samples are equally spaced at the option
    ``rate``. ``counts`` are ``repeated_rows`` and ``zero_rows`` (both kept), the counts of
    :func:`read_sheet` and :meth:`Sheet.samples`, and with t the counts of :func:`timed_record`.
    Raises RecordingError, with the line and the option, where no axis or unit is known, the time
    decreases or a row is malformed.
    """
    sheet = read_sheet(
        file,
        separator=options.separator,
        decimal=options.decimal,
        key=OPTION,
    )
    columns, factors, units = axis_factors(sheet, options)
    return sheet_record(sheet, options, columns, factors, units=units)


def axis_factors(
    sheet: Sheet,
    options: ForceLogOptions,
    stated: Mapping[str, str | None] | None = None,
) -> tuple[list[int], np.ndarray, dict[str, str]]:
    """Return the columns of the forces, and of the torques if present, by options or labels, their
    factors to N and N·m, and kind → unit, from the units ``stated``, else from the header.
    """
    named = dict(options.columns)
    doubled = ""
    named.pop("t", None)
    if not options.columns:
        for column, label in enumerate(sheet.labels):
            axis = axis_of(label)
            if axis in named:
                doubled = label
            if axis:
                named[axis] = column
    wanted = FORCES if {*TORQUES}.isdisjoint(named) else FORCES + TORQUES
    where = {"file": sheet.file, "line": sheet.label_line}
    if doubled or {*wanted} != {*named}:
        axes = ", ".join(sorted(named)) or "none"
        twice = f", two columns {doubled}" if doubled else ""
        raise RecordingError(
            f"the named axes are {axes}{twice} (labels: {', '.join(sheet.labels) or 'none'}); fx, "
            "fy and fz, and all or none of tx, ty, tz are required once each; name them in columns",
            **where,
            key=KEY,
        )
    columns = sheet.columns({axis: named[axis] for axis in wanted}, KEY)
    units = {}
    factors = []
    for axis, column in columns.items():
        units[axis] = stated[KINDS[axis]] if stated else sheet.unit(column)
        factors.append(si_factor(axis, units[axis], options, **where))
    unit_of_kind = {}
    for axis in ("fx", "tx"):
        if units.get(axis):
            unit_of_kind[KINDS[axis]] = units[axis]
    return [*columns.values()], np.array(factors), unit_of_kind


def sheet_record(
    sheet: Sheet,
    options: ForceLogOptions,
    columns: list[int],
    factors: np.ndarray,
    rate: Callable[[], float | None] | None = None,
    **more: Any,
) -> ForceRecord:
    """Return the record of the ``columns`` times ``factors`` (axes,) or (axes, columns) to N and
    N·m, and ``more`` of its fields, at the times of a column of times or sample numbers, else
    equally spaced at ``rate()`` in Hz (default the option).
    """
    clock = _clock_column(sheet, options)
    if clock is None:
        samples = sheet.samples(columns)
        ticks = samples.rows
        values = samples.values
    else:
        samples = sheet.samples([clock, *columns], clock)
        ticks = samples.values[:, 0]
        values = samples.values[:, 1:]
    values = values * factors if factors.ndim == 1 else values @ factors.T
    more["counts"] = sheet.counts | samples.counts | more.get("counts", {})
    more["marks"] = {"separator": sheet.separator, "decimal": sheet.decimal}
    ticks = ticks - ticks[0]
    if clock is not None and not _counts_samples(sheet, clock):
        where = {"file": sheet.file, "line": sheet.label_line}
        time = ticks * si_factor("t", sheet.unit(clock, "time"), options, **where)
    else:
        steady = rate() if rate else options.rate
        if not steady:
            message = "the samples have no time: name a column t, or set rate in Hz"
            raise RecordingError(message, file=sheet.file, key=f"{OPTION}.rate")
        time = ticks / steady
        more["rate"] = steady
    if clock is None:
        return _record(time, values, **more)
    lines = [sheet.lines[row] for row in samples.rows]
    return timed_record(time, values, "line", lines, sheet.file, **more)


def _clock_column(sheet: Sheet, options: ForceLogOptions) -> int | None:
    """Return the column of times, else of sample numbers, by option or label; None for no such."""
    clocks: list[str | int] = []
    if options.columns:
        clocks += [name for axis, name in options.columns.items() if axis == "t"]
    else:
        labels = [bare(label) for label in sheet.labels]
        for kind in (TIMES, NUMBERS):
            clocks += [n for n, label in enumerate(labels) if kind.fullmatch(label)]
    if not clocks:
        return None
    return sheet.columns({"t": clocks[0]}, KEY)["t"]


def _counts_samples(sheet: Sheet, column: int) -> bool:
    """Return whether a ``column`` has sample numbers, by its label."""
    if not sheet.labels:
        return False
    return NUMBERS.fullmatch(bare(sheet.labels[column])) is not None


def read_force_bag(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record of the option ``topic`` (default the only WrenchStamped topic) in the bag
    ``file``, at the times of the message headers; ``counts`` as in :func:`read_force_table`.

    Raises RecordingError for an unreadable bag, for no topic or several; with the sample number
    (from 0), where a value is not finite or the time decreases.
    """
    topic = rosbag.choose_topic(file, WRENCH, options.topic)
    samples = np.array([*rosbag.messages(file, topic, _sample)])
    finite = np.isfinite(samples).all(axis=1)
    if not finite.all():
        raise RecordingError(
            "a force or torque is not finite",
            file=file,
            topic=topic,
            sample=int(np.argmin(finite)),
        )
    numbers = range(len(samples))
    return timed_record(samples[:, 0], samples[:, 1:], "sample", numbers, file)


def _sample(message: object) -> list[float]:
    sample = [rosbag.seconds(message)]
    for vector in (message.wrench.force, message.wrench.torque):
        sample += [vector.x, vector.y, vector.z]
    return sample


def _begins(head: Head) -> bool:
    """Return whether labels of three axes of forces, and of few other columns, are above a row."""
    for number, line in enumerate(head.lines[:HEADER_LINES], start=1):
        cells = split_line(line, separator_of(line))
        axes = [axis for axis in map(axis_of, cells) if axis]
        if {*FORCES} <= {*axes} and 2 * len(axes) >= len(cells):
            return any(map(is_rowlike, head.lines[number : number + 2]))
    return False


FORMAT = (
    Format("forces in a ROS bag", Kind.FORCE, read_force_bag, option="bag"),
    Format("table of forces", Kind.FORCE, read_force_table, _begins, option="table"),
)
