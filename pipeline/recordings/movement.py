"""Measured and commanded angles in the logs of one movement, paired by row at a constant rate."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter, uniform_filter1d

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

UNITS = {
    "clock_jitter": "s",
    "command_delay": "s",
}  # units of quality rows that are no counts
CLOCK_TOLERANCE = 0.1  # greatest deviation of an even row, in steps
JITTER = 0.5  # greatest deviation of a step; beyond, and if it lasts, rows are missing or too close
LASTING = 41  # rows of the medians before and after a deviation that lasts
RATE_TOLERANCE = 0.01  # greatest relative error of the mean rate of the rows
UNWRAPPED = "unwrapped_jumps"  # count of removed jumps of whole turns
DAMAGED = 5  # rows of the median that omits damaged cells
PACE, MOVING, HELD = (
    0.1,
    0.1,
    0.3,
)  # s; share of the greatest pace; greatest share of held rows


def read_movement(
    files: Mapping[Path, LogOptions], rate: float, clock: str | None = None
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return the signals (N, joints) of the logs ``files`` of one movement, with the number of rows
    of the shortest log, and the counts.

    If times deviate from even rows by CLOCK_TOLERANCE to JITTER, ``clock`` "rows" ignores the times
    and "times" interpolates by a cubic spline; None raises RecordingError. Raises RecordingError
    also where the clocks of two logs differ, or the rate is not ``rate`` (Hz).
    """
    from scipy.interpolate import CubicSpline

    logs = {file: read_log(file, options) for file, options in files.items()}
    length, first = min(len(log.time) for log in logs.values()), next(iter(logs))
    time, counts, signals = logs[first].time[:length], Counter(), {}
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
        message = f"the times of {uneven} rows are uneven; the jitter is {1e3 * jitter:.3g} ms. Set"
        message += (
            " clock to rows if rows were measured at the rate, or to times. With rows"
        )
        message += f" the angles are {smoother:.3g} times as smooth"
        raise RecordingError(message, file=first, key=f"{OPTION}.clock")
    counts.update({"uneven_rows": uneven, "clock_jitter": jitter})
    if clock == "times":
        grid = (
            time[0]
            + np.arange(int((time[-1] - time[0]) * rate + CLOCK_TOLERANCE) + 1) / rate
        )
        signals = {
            name: CubicSpline(time, rows)(grid) for name, rows in signals.items()
        }
        counts["resampled_rows"] = len(grid)
    return signals, dict(counts)


def smoothness_by_rows(time: np.ndarray, angles: np.ndarray, rate: float) -> float:
    """Return the third derivative of ``angles`` over ``time``, relative to even rows."""
    from scipy.interpolate import CubicSpline

    clocks = time, np.arange(len(time)) / rate
    derivatives = (CubicSpline(clock, angles)(clock[:-1], 3) for clock in clocks)
    by_time, by_rows = (np.median((each**2).sum(axis=1)) for each in derivatives)
    return float(np.sqrt(by_time / by_rows)) if by_rows else np.inf


def _uneven_rows(time: np.ndarray, rate: float, file: Path) -> int:
    """Return the number of uneven steps; RecordingError for missing rows and another rate."""
    steps = np.diff(time)
    if not len(steps):
        return 0
    off, mean, key = np.abs(steps * rate - 1), (time[-1] - time[0]) / len(steps), None
    another = abs(mean * rate - 1) > RATE_TOLERANCE
    # a loaded computer's clock is late, and then on time again; missing rows shift it for good
    shift = median_filter(time * rate - np.arange(len(time)), LASTING, mode="nearest")
    rows, half = np.arange(len(steps)), LASTING // 2
    after, before = np.minimum(rows + half + 1, len(steps)), np.maximum(rows - half, 0)
    beyond = (off > JITTER) & (np.abs(shift[after] - shift[before]) > JITTER)
    if beyond.any() and not (another and np.median(off) > JITTER):
        row = int(np.argmax(beyond))
        found = f"{steps[row]:.6g} s at {time[row] - time[0]:.6g} s from the start"
        cause = f"rows are {'missing' if steps[row] * rate > 1 else 'too close'}; resample the log"
    elif another:
        found, key = f"{mean:.6g} s on average", "dataset.motion.rate"
        cause = f"set the rate to {1 / mean:.6g}, or correct time_unit"
    else:
        return int((off > CLOCK_TOLERANCE).sum())
    message = f"the time step of the log is {found}, not 1/{rate:g} s: {cause}"
    raise RecordingError(message, file=file, key=key)


def read_log(file: Path, options: LogOptions) -> JointLog:
    """Return the log in ``file``, with signals multiplied by their factors and without jumps of
    whole turns. A file of no known format is read as a plain table. Raises RecordingError for other
    joints, angles beyond MOST_TURNS, and other jumps.
    """
    chosen = format_of(file, formats_in(joint_formats, Kind.JOINTS)) or TABLE
    log = chosen.read(file, options)
    names, signals, jumps = options.names or log.joints, {}, 0
    stated = match_joints(log.joints, options.names) if log.joints else []
    if {*stated} == {*options.names} and stated != [*options.names]:
        message = f"the joints of the log are {', '.join(log.joints)}"
        raise RecordingError(message, file=file, key=f"{OPTION}.joints")
    for name in (
        name for name in log.signals if name in (options.signals or log.signals)
    ):
        rows = log.signals[name] * np.asarray(options.factors.get(name, 1.0))
        if rows.shape[1] != options.joints:
            message = f"the log holds {rows.shape[1]} joints, not {options.joints}"
            raise RecordingError(message, file=file, key=f"{OPTION}.joints")
        if name in SIGNALS:
            if options.angle_unit == "deg":
                rows = np.where(options.circular, rows, np.degrees(rows))
            where = {"signal": name, "lines": log.lines, "file": file}
            require_plausible(
                rows, log.time, names, options.circular, options.angle_unit, **where
            )
        if name in SIGNALS[:2]:
            rows, removed = unwrap(
                rows, log.time, names, circular=options.circular, **where
            )
            jumps += removed
        signals[name] = rows
    return replace(
        log, signals=signals, counts=log.counts | ({UNWRAPPED: jumps} if jumps else {})
    )


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
    limit, sizes = MOST_TURNS * TURN, np.where(circular, np.abs(angles), 0.0)
    if not (beyond := sizes > limit).any():
        return
    row, joint = np.argwhere(beyond)[0].tolist()
    name = names[joint] if len(names) == angles.shape[1] else f"joint {joint + 1}"
    message = f"{name} ({signal}) is {angles[row, joint]:.6g} rad, or rad/s, at "
    message += (
        f"{time[row] - time[0]:.6g} s from the start: beyond four turns, which is not "
    )
    if (without_damage(sizes) > limit).any():
        message += f"plausible: check that the angle_unit is {unit}"
        raise RecordingError(message, **where, key=f"{OPTION}.angle_unit")
    where |= {"line": lines[row]} if len(lines) else {}
    message += "plausible and no angle: correct the cell, or leave the row out"
    raise RecordingError(message, **where)


def require_fresh(
    actual: np.ndarray, target: np.ndarray, rate: float, **where: object
) -> None:
    """Raise RecordingError where more than HELD of the rows in motion of ``actual`` and ``target``
    (N, joints) rad equal the row before: a logger that is faster than the controller. Rows of a
    motion by less than the resolution of the angles are also equal, and no fault.
    """
    steps = np.abs(np.diff(np.hstack([actual, target]), axis=0)).max(
        axis=1, initial=0.0
    )
    pace = uniform_filter1d(steps, max(round(PACE * rate), 1)) if len(steps) else steps
    moving = steps[pace > MOVING * pace.max(initial=0.0)]
    changed = moving[moving > 0]
    share = 1 - len(changed) / max(len(moving), 1)
    if share > HELD and np.median(changed) > 2 * changed.min():
        message = f"{share:.0%} of the rows in motion repeat the angles of the row before, at other"
        message += f" times: the values change {rate * (1 - share):.4g} times a second; write each"
        raise RecordingError(f"{message} sample once, with its own time", **where)


def require_speeds(
    time: np.ndarray,
    angles: Mapping[str, np.ndarray],
    names: Sequence[str],
    urdf: str,
    **where,
) -> None:
    """Raise RecordingError where ``angles`` (N, joints) exceed a velocity limit in ``urdf``."""
    known, seconds = commands.named_joints(urdf, names), np.diff(time)[:, None]
    limits = [
        ((joint and joint.limits) or {}).get("velocity") or np.inf for joint in known
    ]
    for signal, rows in angles.items():
        steps = np.abs(np.diff(rows, axis=0))
        for row, column in np.argwhere(
            commands.beyond_speed(steps, np.array(limits), seconds)
        ):
            unit = "m" if known[column].kind == "prismatic" else "rad"
            at, step = round(float(time[row + 1] - time[0]), 6), steps[row, column]
            message = f"{names[column]} ({signal}) steps by {step:.4g} {unit} at {at:g} s from the"
            message += (
                f" start: {step / seconds[row, 0]:.4g} {unit}/s, where the robot's URDF"
            )
            message += f" allows {limits[column]:.4g} {unit}/s; check the unit of this joint, leave"
            message += (
                " this part of the log out, or correct the velocity limit in the URDF"
            )
            raise RecordingError(message, **where, joint=names[column], time=at)


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
        actual, target, circular = (
            self.actual[:, places],
            self.target[:, places],
            self.circular,
        )
        spans = [target[max(run.first - 1, 0) : run.last + 1] for run in self.motions]
        far = [np.ptp(span, axis=0).max(initial=0.0) > REACH for span in spans]
        motions = [run for run, moves in zip(self.motions, far, strict=True) if moves]
        return LoggedMovement(
            joints, actual, target, motions, self.counts, circular[places]
        )


def read_logged_movement(
    name: str,
    movement: Path,
    options: JointLogSection,
    rate: float,
    urdf: str = commands.UNFILLED,
) -> LoggedMovement:
    """Return the ``movement``, a folder of logs or one file, at ``rate`` (Hz); its ``name`` selects
    the delay.

    Raises RecordingError for an uneven clock, angles that do not follow the command and steps
    beyond the velocity limits in ``urdf``; ConfigError where options name no columns or delay.
    """
    joints, circular = options.joints, commands.circular_joints(urdf, options.joints)
    keys = ("time", "separator", "decimal", "angle_unit", "time_unit")
    common = {key: getattr(options, key) for key in keys}
    common |= {
        "rate": rate,
        "circular": circular,
        "joints": len(joints),
        "names": joints,
    }
    common["factors"] = dict.fromkeys(SIGNALS[1:], options.target_factor)
    files = _files_of_signals(movement, options, common)
    single = [*files] == [movement]
    signals, counts = read_movement(files, rate, options.clock) if files else ({}, {})
    if missing := [signal for signal in SIGNALS[:2] if signal not in signals]:
        where = "signals" if single else " and ".join(missing)
        message = f"no option names the {' and '.join(missing)} angles of {name}"
        if is_bag(movement):
            unread = rosbag.summary(movement).passed_over
            message += "".join(f"; {topic}: {why}" for topic, why in unread.items())
        raise ConfigError(message, key=f"{OPTION}.{where}")
    delay = options.target_delay
    delays = delay if isinstance(delay, Mapping) else {name: delay}
    if name not in delays:
        message = f"no delay for the movement {name}, only for {', '.join(delays)}"
        raise ConfigError(message, key=f"{OPTION}.target_delay")
    early = round(delays[name] * rate)
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
        speed = commands.shift_rows(signals["actual"], signals["speed"], early)[1]
    else:
        counts |= {"speed_from_angles": 1}
    read = LoggedMovement(joints, actual, target, [], counts, circular)
    if fault := commands.standing_arm(actual, target):
        raise RecordingError(fault, file=movement)
    standing = commands.standing_joints(actual, target)
    follow = read.of(np.array(joints)[~standing].tolist())
    pair = follow.actual, follow.target, rate, options.mismatch, follow.joints
    commands.require_pair(*pair, file=movement)
    angles = {"actual": actual, "target": target}
    require_speeds(np.arange(len(actual)) / rate, angles, joints, urdf, file=movement)
    return read._replace(motions=excursions(target, speed, options.rest_speed))


def _files_of_signals(
    movement: Path, options: JointLogSection, common: Mapping[str, object]
) -> dict[Path, LogOptions]:
    """Return file → what to read of it: the ``movement`` if it is one file of all signals, else one
    table per signal in its folder, or beside it with the words of ``options`` in their names.
    """
    if (movement.is_file() or is_bag(movement)) and options.actual is None:
        return {movement: LogOptions(**common, signals={**options.signals})}
    names = {name: getattr(options, name) for name in (*SIGNALS, "time")}
    places = {}
    for name, text in names.items():
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
    return {
        file: LogOptions(**common, signals=signals) for file, signals in wanted.items()
    }


def _place_of(movement: Path, actual: str, text: str) -> Path:
    """Return the file ``text`` in the folder ``movement``; beside a file of measured angles, the
    file with ``text`` in place of ``actual`` in its name.
    """
    if movement.is_dir():
        return movement / text
    return movement.parent / movement.name.replace(actual, text, 1)
