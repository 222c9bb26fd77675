"""Measured and commanded angles in the logs of one movement, paired by row at a constant rate."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter, uniform_filter1d

from pipeline.arm.urdf import Joint
from pipeline.core.angles import MOST_TURNS, TURN, unwrap, whole_turns
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import SIGNALS, JointLogSection
from pipeline.formats import joints as joint_formats
from pipeline.formats import rosbag
from pipeline.formats.format import Kind, format_of, formats_in, is_bag
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions
from pipeline.formats.joints.names import match_joints
from pipeline.formats.joints.table import FORMAT as TABLE
from pipeline.formats.joints.table import read_clock
from pipeline.recordings import commands
from pipeline.recordings.lags import REACH
from pipeline.recordings.repetitions import Excursion, excursions

# units of quality rows that are not counts
UNITS = {"clock_jitter": "s", "command_delay": "s"}
CLOCK_TOLERANCE = 0.1  # greatest deviation of an even row, in steps
JITTER = 0.5  # greatest deviation of a step; beyond, and if it lasts, rows are missing or too close
LASTING = 41  # rows of the medians before and after a deviation that lasts
MOST_APART = 5.0  # greatest interpolated distance of two rows, in steps of the rate
RATE_TOLERANCE = 0.01  # greatest relative error of the mean rate of the rows
OTHER_RATE = (
    2.0  # greatest factor between the rate and the median rate of resampled rows
)
UNWRAPPED = "unwrapped_jumps"  # count of removed jumps of whole turns
DAMAGED = 5  # rows of the median that omits damaged cells
# s; share of the greatest pace; greatest share of held rows
PACE = 0.1
MOVING = 0.1
HELD = 0.3


def read_movement(
    files: Mapping[Path, LogOptions],
    rate: float,
    clock: str | None = None,
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return the signals (N, joints) of the logs ``files`` of one movement, with the number of rows
    of the shortest log, and the counts.

    If the times deviate from even rows, ``clock`` "rows" ignores the times and "times" resamples by
    :func:`_resampled`; None raises RecordingError. Raises RecordingError also where the clocks of
    two logs differ, rows are missing, or the rate is not ``rate`` (Hz).
    """
    logs = {file: read_log(file, options) for file, options in files.items()}
    length = min(len(log.time) for log in logs.values())
    first = next(iter(logs))
    time = logs[first].time[:length]
    counts = Counter()
    signals = {}
    if clock == "times":
        uneven = _rows_to_resample(time, rate, first)
    else:
        uneven = _uneven_rows(time, rate, first)
    for file, log in logs.items():
        if (np.abs(log.time[:length] - time) * rate > CLOCK_TOLERANCE).any():
            message = f"the times differ from the times of {first.name}; use logs of one recording"
            raise RecordingError(message, file=file)
        counts.update(log.counts | {"rows_without_partner": len(log.time) - length})
        signals |= {name: rows[:length] for name, rows in log.signals.items()}
    if not uneven:
        return signals, dict(counts)

    jitter = float(np.diff(time).std())
    if clock is None:
        smoother = smoothness_by_rows(time, np.hstack([*signals.values()]), rate)
        raise RecordingError(
            f"the times of {uneven} rows are uneven; the jitter is {1e3 * jitter:.3g} ms. "
            "Set clock to rows if rows were measured at the rate, or to times. With rows the "
            f"angles are {smoother:.3g} times as smooth",
            file=first,
            key=f"{OPTION}.clock",
        )
    counts.update({"uneven_rows": uneven, "clock_jitter": jitter})
    if clock == "times":
        signals = _resampled(time, signals, rate)
        counts["resampled_rows"] = len(signals["actual"])
    return signals, dict(counts)


def _resampled(
    time: np.ndarray,
    signals: Mapping[str, np.ndarray],
    rate: float,
) -> dict[str, np.ndarray]:
    """Return the ``signals`` (N, joints) at ``time`` (N,) s interpolated on even times at ``rate``
    (Hz): by a cubic spline, or linearly if :func:`lasting_deviations` show that rows are far apart
    or close, where a spline amplifies the noise of the angles.
    """
    from scipy.interpolate import CubicSpline

    steps = int((time[-1] - time[0]) * rate + CLOCK_TOLERANCE)
    grid = time[0] + np.arange(steps + 1) / rate
    linear = lasting_deviations(time, rate).any()
    resampled = {}
    for name, rows in signals.items():
        if linear:
            columns = [np.interp(grid, time, column) for column in rows.T]
            resampled[name] = np.column_stack(columns)
        else:
            resampled[name] = CubicSpline(time, rows)(grid)
    return resampled


def smoothness_by_rows(time: np.ndarray, angles: np.ndarray, rate: float) -> float:
    """Return the third derivative of ``angles`` over ``time``, relative to even rows."""
    from scipy.interpolate import CubicSpline

    def roughness(clock: np.ndarray) -> float:
        derivatives = CubicSpline(clock, angles)(clock[:-1], 3)
        return np.median((derivatives**2).sum(axis=1))

    by_rows = roughness(np.arange(len(time)) / rate)
    return float(np.sqrt(roughness(time) / by_rows)) if by_rows else np.inf


def _uneven_rows(time: np.ndarray, rate: float, file: Path) -> int:
    """Return the number of uneven steps; RecordingError for missing rows and another rate."""
    steps = np.diff(time)
    if not len(steps):
        return 0
    off = np.abs(steps * rate - 1)
    mean = (time[-1] - time[0]) / len(steps)
    is_other_rate = abs(mean * rate - 1) > RATE_TOLERANCE
    beyond = lasting_deviations(time, rate)

    if beyond.any() and not (is_other_rate and np.median(off) > JITTER):
        row = int(np.argmax(beyond))
        key = None
        stated = f"{steps[row]:.6g} s at {time[row] - time[0]:.6g} s from the start"
        fault = "missing" if steps[row] * rate > 1 else "too close"
        cause = f"rows are {fault}; resample the log"
    elif is_other_rate:
        key = "dataset.motion.rate"
        stated = f"{mean:.6g} s on average"
        cause = f"set the rate to {1 / mean:.6g}, or correct time_unit"
    else:
        return int((off > CLOCK_TOLERANCE).sum())
    message = f"the time step of the log is {stated}, not 1/{rate:g} s: {cause}"
    raise RecordingError(message, file=file, key=key)


def lasting_deviations(time: np.ndarray, rate: float) -> np.ndarray:
    """Return the mask (N − 1,) of the steps of ``time`` (N,) s that deviate by more than JITTER and
    shift the later rows for good: a loaded computer's clock is late, and then on time again.
    """
    steps = np.diff(time)
    late = median_filter(time * rate - np.arange(len(time)), LASTING, mode="nearest")
    rows = np.arange(len(steps))
    half = LASTING // 2
    after = np.minimum(rows + half + 1, len(steps))
    before = np.maximum(rows - half, 0)
    lasts = np.abs(late[after] - late[before]) > JITTER
    return (np.abs(steps * rate - 1) > JITTER) & lasts


def _rows_to_resample(time: np.ndarray, rate: float, file: Path) -> int:
    """Return the number of uneven steps of ``time`` (N,) s; RecordingError for rows that are more
    than MOST_APART steps of the ``rate`` (Hz) apart, and for a rate beyond OTHER_RATE.
    """
    steps = np.diff(time) * rate
    usual = float(np.median(steps)) if len(steps) else 1.0
    if not 1 / OTHER_RATE <= usual <= OTHER_RATE:
        raise RecordingError(
            f"the median time step of the log is {usual / rate:.6g} s, not 1/{rate:g} s: set the "
            f"rate to {rate / usual:.6g}, or correct time_unit",
            file=file,
            key="dataset.motion.rate",
        )
    far = steps > MOST_APART * max(usual, 1.0)
    if far.any():
        row = int(np.argmax(far))
        raise RecordingError(
            f"rows are missing: two are {steps[row] / rate:.6g} s apart at "
            f"{time[row] - time[0]:.6g} s from the start, more than {MOST_APART:g} steps of "
            f"1/{rate:g} s; write the parts of the log before and after to a file of their own",
            file=file,
        )
    return int((np.abs(steps - 1) > CLOCK_TOLERANCE).sum())


def read_log(file: Path, options: LogOptions) -> JointLog:
    """Return the log in ``file``, with signals multiplied by their factors and without jumps of
    whole turns. A file of no known format is read as a plain table. Raises RecordingError for other
    joints, angles beyond MOST_TURNS, and other jumps.
    """
    chosen = format_of(file, formats_in(joint_formats, Kind.JOINTS)) or TABLE
    log = chosen.read(file, options)
    names = options.names or log.joints
    signals = {}
    jumps = 0
    key = f"{OPTION}.joints"
    stated = match_joints(log.joints, options.names) if log.joints else []
    if {*stated} == {*options.names} and stated != [*options.names]:
        message = f"the joints of the log are {', '.join(log.joints)}"
        raise RecordingError(message, file=file, key=key)

    for name, logged in log.signals.items():
        if options.signals and name not in options.signals:
            continue
        rows = logged * np.asarray(options.factors.get(name, 1.0))
        if rows.shape[1] != options.joints:
            message = f"the log holds {rows.shape[1]} joints, not {options.joints}"
            raise RecordingError(message, file=file, key=key)
        where = {"signal": name, "lines": log.lines, "file": file}
        circular = options.circular
        unit = options.angle_unit
        if name in SIGNALS:
            if unit == "deg":
                rows = np.where(circular, rows, np.degrees(rows))
            require_plausible(rows, log.time, names, circular, unit, **where)
        if name in SIGNALS[:2]:
            rows, removed = unwrap(rows, log.time, names, circular=circular, **where)
            jumps += removed
        signals[name] = rows
    counts = log.counts | {UNWRAPPED: jumps} if jumps else log.counts
    return replace(log, signals=signals, counts=counts)


def without_damage(angles: np.ndarray) -> np.ndarray:
    """Return running medians (N, joints) of five rows, which two damaged cells do not change."""
    if len(angles) < DAMAGED:
        return angles
    beside = np.pad(angles, ((DAMAGED // 2,) * 2, (0, 0)), mode="reflect")
    return np.median(sliding_window_view(beside, DAMAGED, axis=0), axis=-1)


def require_plausible(
    angles: np.ndarray,
    time: np.ndarray,
    names: Sequence[str],
    circular: np.ndarray | bool,
    unit: str,
    *,
    signal: str,
    lines: Sequence[int] = (),
    **where: object,
) -> None:
    """Raise RecordingError where a ``signal`` (N, joints) in rad or rad/s exceeds MOST_TURNS: with
    the line if it is a damaged cell, else with the option of the ``unit``.
    """
    limit = MOST_TURNS * TURN
    sizes = np.where(circular, np.abs(angles), 0.0)
    beyond = sizes > limit
    if not beyond.any():
        return
    row, joint = np.argwhere(beyond)[0].tolist()
    name = names[joint] if len(names) == angles.shape[1] else f"joint {joint + 1}"
    fault = (
        f"{name} ({signal}) is {angles[row, joint]:.6g} rad, or rad/s, at "
        f"{time[row] - time[0]:.6g} s from the start: beyond four turns, which is not "
        "plausible"
    )
    if (without_damage(sizes) > limit).any():
        message = f"{fault}: check that the angle_unit is {unit}"
        raise RecordingError(message, **where, key=f"{OPTION}.angle_unit")
    if len(lines):
        where["line"] = lines[row]
    message = f"{fault} and no angle: correct the cell, or leave the row out"
    raise RecordingError(message, **where)


def require_fresh(
    actual: np.ndarray,
    target: np.ndarray,
    rate: float,
    **where: object,
) -> None:
    """Raise RecordingError where more than HELD of the rows in motion of ``actual`` and ``target``
    (N, joints) rad equal the row before: a logger that is faster than the controller. Rows of a
    motion by less than the resolution of the angles are also equal, and no fault.
    """
    steps = np.abs(np.diff(np.hstack([actual, target]), axis=0)).max(
        axis=1,
        initial=0.0,
    )
    pace = uniform_filter1d(steps, max(round(PACE * rate), 1)) if len(steps) else steps
    moving = steps[pace > MOVING * pace.max(initial=0.0)]
    changed = moving[moving > 0]
    share = 1 - len(changed) / max(len(moving), 1)
    if share > HELD and np.median(changed) > 2 * changed.min():
        raise RecordingError(
            f"{share:.0%} of the rows in motion repeat the angles of the row before, at other "
            f"times: the values change {rate * (1 - share):.4g} times a second; write each "
            "sample once, with its own time",
            **where,
        )


def require_speeds(
    time: np.ndarray,
    angles: Mapping[str, np.ndarray],
    names: Sequence[str],
    urdf: str,
    **where,
) -> None:
    """Raise RecordingError where ``angles`` (N, joints) exceed a velocity limit in ``urdf``."""
    joints = commands.named_joints(urdf, names)
    seconds = np.diff(time)[:, None]
    limits = np.array([_velocity_limit(joint) for joint in joints])
    for signal, rows in angles.items():
        steps = np.abs(np.diff(rows, axis=0))
        beyond = commands.beyond_speed(steps, limits, seconds)
        if not beyond.any():
            continue
        row, column = np.argwhere(beyond)[0]
        unit = "m" if joints[column].kind == "prismatic" else "rad"
        at = round(float(time[row + 1] - time[0]), 6)
        step = steps[row, column]
        speed = step / seconds[row, 0]
        raise RecordingError(
            f"{names[column]} ({signal}) steps by {step:.4g} {unit} at {at:g} s from the "
            f"start: {speed:.4g} {unit}/s, where the robot's URDF allows "
            f"{limits[column]:.4g} {unit}/s; check the unit of this joint, leave this part "
            "of the log out, or correct the velocity limit in the URDF",
            **where,
            joint=names[column],
            time=at,
        )


def _velocity_limit(joint: Joint | None) -> float:
    """Return the limit of the ``joint``'s URDF in rad/s or m/s; infinite where none is stated."""
    if joint is None:
        return np.inf
    return joint.speed or np.inf


class LoggedMovement(NamedTuple):
    """N rows of a movement, with all logged joints."""

    joints: Sequence[str]
    actual: np.ndarray  # (N, joints) rad, measured
    target: np.ndarray  # (N, joints) rad, commanded
    motions: Sequence[Excursion]  # of the command
    counts: Mapping[str, float]  # numbers of rows; UNITS lists values with another unit
    circular: np.ndarray  # (joints,) whether a joint is circular

    def of(self, joints: Sequence[str]) -> Self:
        """Return the movement of the ``joints`` alone, in their order, with motions of theirs."""
        places = [self.joints.index(joint) for joint in joints]
        actual = self.actual[:, places]
        target = self.target[:, places]
        circular = self.circular[places]

        motions = []
        for run in self.motions:
            span = target[max(run.first - 1, 0) : run.last + 1]
            if np.ptp(span, axis=0).max(initial=0.0) > REACH:
                motions.append(run)
        return LoggedMovement(joints, actual, target, motions, self.counts, circular)


def read_logged_movement(
    name: str,
    movement: Path,
    options: JointLogSection,
    rate: float,
    urdf: str = commands.UNFILLED,
    recording: int | None = None,
) -> LoggedMovement:
    """Return the ``movement``, a folder of logs or one file, at ``rate`` (Hz); its ``name`` selects
    the delay, ``recording`` one of several in a file.

    Raises RecordingError for an uneven clock, angles that do not follow the command and steps
    beyond the velocity limits in ``urdf``; ConfigError where options name no columns or delay.
    """
    joints = options.joints
    circular = commands.circular_joints(urdf, options.joints)
    common = {
        "time": options.time,
        "separator": options.separator,
        "decimal": options.decimal,
        "angle_unit": options.angle_unit,
        "time_unit": options.time_unit,
        "rate": rate,
        "circular": circular,
        "joints": len(joints),
        "names": joints,
        "factors": dict.fromkeys(SIGNALS[1:], options.target_factor),
        "recording": recording,
    }
    files = _files_of_signals(movement, options, common)
    signals = {}
    counts = {}
    if files:
        signals, counts = read_movement(files, rate, options.clock)
    _require_angles(signals, name, movement, files)

    early = _delay_of(name, options, rate)
    actual, target = commands.shift_rows(signals["actual"], signals["target"], early)
    if early:
        counts |= {"command_delay": early / rate, "rows_beside_the_delay": abs(early)}
    require_fresh(actual, target, rate, file=movement)
    turns = whole_turns(target, actual, circular)
    if turns.any():
        actual = actual + TURN * turns
        counts |= {"joints_moved_by_whole_turns": np.count_nonzero(turns)}

    speed = rate
    if "speed" in signals:
        _, speed = commands.shift_rows(signals["actual"], signals["speed"], early)
    else:
        counts |= {"speed_from_angles": 1}

    fault = commands.standing_arm(actual, target)
    if fault:
        raise RecordingError(fault, file=movement)
    follow = ~commands.standing_joints(actual, target)
    commands.require_pair(
        actual[:, follow],
        target[:, follow],
        rate,
        options.mismatch,
        np.array(joints)[follow].tolist(),
        file=movement,
    )
    angles = {"actual": actual, "target": target}
    require_speeds(np.arange(len(actual)) / rate, angles, joints, urdf, file=movement)
    motions = excursions(target, speed, options.rest_speed)
    return LoggedMovement(joints, actual, target, motions, counts, circular)


def _require_angles(
    signals: Mapping[str, np.ndarray],
    name: str,
    movement: Path,
    files: Mapping[Path, LogOptions],
) -> None:
    """Raise ConfigError where no option names the measured or the commanded angles."""
    missing = [signal for signal in SIGNALS[:2] if signal not in signals]
    if not missing:
        return
    option = "signals" if [*files] == [movement] else " and ".join(missing)
    message = f"no option names the {' and '.join(missing)} angles of {name}"
    if is_bag(movement):
        unread = rosbag.summary(movement).passed_over
        message += "".join(f"; {topic}: {why}" for topic, why in unread.items())
    raise ConfigError(message, key=f"{OPTION}.{option}")


def _delay_of(name: str, options: JointLogSection, rate: float) -> int:
    """Return the rows by which the command of the movement ``name`` is early."""
    delay = options.target_delay
    delays = delay if isinstance(delay, Mapping) else {name: delay}
    if name not in delays:
        message = f"no delay for the movement {name}, only for {', '.join(delays)}"
        raise ConfigError(message, key=f"{OPTION}.target_delay")
    return round(delays[name] * rate)


def _files_of_signals(
    movement: Path,
    options: JointLogSection,
    common: Mapping[str, object],
) -> dict[Path, LogOptions]:
    """Return file → what to read of it: the ``movement`` if it is one file of all signals, else one
    table per signal in its folder, or beside it with the words of ``options`` in their names.
    """
    if (movement.is_file() or is_bag(movement)) and options.actual is None:
        return {movement: LogOptions(**common, signals={**options.signals})}
    places = {}
    for name in (*SIGNALS, "time"):
        text = getattr(options, name)
        if isinstance(text, str):
            places[name] = _place_of(movement, str(options.actual), text)
    if "time" in places and places["time"].is_file():
        clock = read_clock(places.pop("time"), LogOptions(**common))
        common = {**common, "time": None, "clock": clock}
    wanted: dict[Path, dict] = {}
    for signal in SIGNALS:
        if signal in places:
            columns = options.signals.get(signal)
            wanted.setdefault(places[signal], {})[signal] = columns
    read = {}
    for file, signals in wanted.items():
        read[file] = LogOptions(**common, signals=signals)
    return read


def _place_of(movement: Path, actual: str, text: str) -> Path:
    """Return the file ``text`` in the folder ``movement``; beside a file of measured angles, the
    file with ``text`` in place of ``actual`` in its name.
    """
    if movement.is_dir():
        return movement / text
    return movement.parent / movement.name.replace(actual, text, 1)
