"""Logs of one movement of a robot, paired row by row on an even clock: measured and commanded."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.angles import TURN, apart, unwrapped, whole_turns
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.instruments import SIGNALS, JointLogSection
from pipeline.formats import joints as joint_formats
from pipeline.formats.format import Kind, format_of, formats_in, is_bag
from pipeline.formats.joints.log import OPTION, TABLE, JointLog, LogOptions
from pipeline.recordings.commands import named_joints
from pipeline.recordings.pairing import delayed, require_pair
from pipeline.recordings.repetitions import REACH, commanded_speeds

UNITS = {"clock_jitter": "s", "command_delay": "s"}  # of counts that are none
CLOCK_TOLERANCE = 0.1  # of a step, up to which the rows are taken as even
JITTER = 0.5  # of a step, beyond which a row is missing, or one too many
RATE_TOLERANCE = 0.01  # of the rate, which the rows keep on average
UNWRAPPED = "unwrapped_jumps"  # count of jumps of whole turns that were removed
FASTER = 1.05  # of a joint's velocity limit, up to which a step is the joint's own
STEP_NOISE = 1e-3  # rad by which noise and rounding of two rows may add to a step
MOST_TURNS = 4  # no joint of an arm turns farther from its zero: angles beyond have another unit


def read_movement(
    files: Mapping[Path, LogOptions], rate: float, clock: str | None = None
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Read the signals (N, joints) of the logs ``files`` of one movement, as many rows as the
    shortest log has, and their counts. Rows uneven by a tenth to half of a step are taken row by
    row by the ``clock`` rows, or interpolated by a cubic spline by times; None refuses them. Raises
    RecordingError for clocks that disagree or do not keep to ``rate`` (1/s).
    """
    from scipy.interpolate import CubicSpline

    logs = {file: read_log(file, options) for file, options in files.items()}
    length = min(len(log.time) for log in logs.values())
    first, time = next((file, log.time[:length]) for file, log in logs.items())
    uneven = _uneven_rows(time, rate, first)
    total, signals = Counter(), {}
    for file, log in logs.items():
        if (np.abs(log.time[:length] - time) * rate > CLOCK_TOLERANCE).any():
            message = f"the times are not those of {first.name}; take logs of one recording"
            raise RecordingError(message, file=file)
        total.update(log.counts | {"rows_without_partner": len(log.time) - length})
        signals |= {name: rows[:length] for name, rows in log.signals.items()}
    counts: dict[str, float] = dict(total)
    if not uneven:
        return signals, counts
    jitter = float(np.diff(time).std())
    if clock is None:
        smoother = smoothness_by_rows(time, np.hstack([*signals.values()]), rate)
        message = f"{uneven} rows are uneven by their times, which jitter by {1e3 * jitter:.3g} ms:"
        message += " do they follow each other at the rate (rows), or were they measured at those"
        message += f" times (times)? row by row the angles are {smoother:.3g} times as smooth"
        raise RecordingError(message, file=first, key=f"{OPTION}.clock")
    counts |= {"uneven_rows": uneven, "clock_jitter": jitter}
    if clock == "times":
        grid = time[0] + np.arange(int((time[-1] - time[0]) * rate + CLOCK_TOLERANCE) + 1) / rate
        signals = {name: CubicSpline(time, rows)(grid) for name, rows in signals.items()}
        counts["resampled_rows"] = len(grid)
    return signals, counts


def smoothness_by_rows(time: np.ndarray, angles: np.ndarray, rate: float) -> float:
    """Return the roughness of ``angles`` (N, joints) over the ``time`` (N,) s over that by rows."""
    roughness = []
    for clock in (time, np.arange(len(time)) / rate):
        derivative = angles
        for order in (1, 2, 3):
            derivative = np.diff(derivative, axis=0) / (clock[order:] - clock[:-order])[:, None]
        roughness.append(float(np.sqrt(np.median((derivative**2).sum(axis=1)))))
    return roughness[0] / roughness[1] if roughness[1] else np.inf


def _uneven_rows(time: np.ndarray, rate: float, file: Path) -> int:
    """Number of uneven steps; RecordingError where they cannot be a log's at that rate."""
    steps = np.diff(time)
    if not len(steps):
        return 0
    off, mean, key = np.abs(steps * rate - 1), (time[-1] - time[0]) / len(steps), None
    another = abs(mean * rate - 1) > RATE_TOLERANCE
    if off.max() > JITTER and not (another and np.median(off) > JITTER):
        row = int(np.argmax(off > JITTER))
        found = f"{steps[row]:.6g} s at {time[row] - time[0]:.6g} s from its start"
        cause = "samples are missing" if steps[row] * rate > 1 else "rows are too close"
    elif another:
        found, key = f"{mean:.6g} s on average", "dataset.motion.rate"
        cause = f"is its rate {1 / mean:.6g} 1/s, and its time_unit right?"
    else:
        return int((off > CLOCK_TOLERANCE).sum())
    message = f"the log steps by {found}, not by 1/{rate:g} s: {cause}"
    raise RecordingError(message, file=file, key=key)


def read_log(file: Path, options: LogOptions) -> JointLog:
    """Read the log in ``file`` in whichever format it begins, else as a plain table; signals times
    their factors, angles without jumps of whole turns. Raises RecordingError for other joints,
    angles beyond four turns, and jumps of no whole turns.
    """
    chosen = format_of(file, formats_in(joint_formats, Kind.JOINTS)) or TABLE
    log = chosen.read(file, options)
    names, signals, jumps = options.names or log.joints, {}, 0
    if log.joints and options.names and log.joints != tuple(options.names):
        message = f"the log states its joints as {', '.join(log.joints)}"
        raise RecordingError(message, file=file, key=f"{OPTION}.joints")
    for name in (each for each in log.signals if each in (options.signals or log.signals)):
        rows = log.signals[name] * np.asarray(options.factors.get(name, 1.0))
        if rows.shape[1] != options.joints:
            message = f"the log holds {rows.shape[1]} joints, not {options.joints}"
            raise RecordingError(message, file=file, key=f"{OPTION}.joints")
        if name in SIGNALS:
            if options.angle_unit == "deg":
                rows = np.where(options.circular, rows, np.degrees(rows))
            greatest = np.where(options.circular, np.abs(rows), 0.0).max(axis=1, initial=0.0)
            if greatest.max() > MOST_TURNS * TURN:
                at = log.time[greatest.argmax()] - log.time[0]
                message = f"{name}: {greatest.max():.6g} rad, or rad/s, at {at:.6g} s from start"
                message += f" is not a joint of an arm: is the angle_unit {options.angle_unit}?"
                raise RecordingError(message, file=file, key=f"{OPTION}.angle_unit")
        if name in SIGNALS[:2]:
            where = {"circular": options.circular, "signal": name, "file": file}
            rows, removed = unwrapped(rows, log.time, names, **where)
            jumps += removed
        signals[name] = rows
    return replace(log, signals=signals, counts=log.counts | ({UNWRAPPED: jumps} if jumps else {}))


def require_speeds(
    time: np.ndarray,
    angles: Mapping[str, np.ndarray],
    names: Sequence[str],
    urdf: str,
    **evidence: object,
) -> None:
    """Raise RecordingError where ``angles`` (N, joints) step beyond a speed limit of ``urdf``."""
    known = named_joints(urdf, names)
    limits = [((joint and joint.limits) or {}).get("velocity", 0.0) or np.inf for joint in known]
    for signal, rows in angles.items():
        steps, seconds = np.abs(np.diff(rows, axis=0)), np.diff(time)[:, None]
        beyond = steps > FASTER * np.array(limits) * seconds + STEP_NOISE
        if beyond.any():
            row, column = np.argwhere(beyond)[0].tolist()
            unit = "m" if known[column].kind == "prismatic" else "rad"
            at, step = round(float(time[row + 1] - time[0]), 6), steps[row, column]
            speed, limit = (f"{v:.4g} {unit}/s" for v in (step / seconds[row, 0], limits[column]))
            message = f"{names[column]} ({signal}) steps by {step:.4g} {unit} at {at:g} s from the"
            message += f" start: {speed}, where the robot's URDF allows {limit}; leave this part of"
            message += " the log out, or correct the velocity limit of the joint in the URDF"
            raise RecordingError(message, **evidence, joint=names[column], time=at)


class LoggedMovement(NamedTuple):
    """Rows of a movement, of all its logged joints."""

    joints: Sequence[str]
    actual: np.ndarray  # (N, joints) rad, measured
    target: np.ndarray  # (N, joints) rad, commanded
    speed: np.ndarray  # (N, joints) rad/s, commanded
    others: Mapping[str, np.ndarray]  # (N, joints) each, other signals in any unit
    counts: Mapping[str, float]  # of rows, but for those of UNITS
    circular: np.ndarray  # (joints,) which joints turn

    def require_held(self, rows: slice, locked: Mapping[str, float], **evidence: object) -> None:
        """RecordingError for joints not within 0.01 rad of their ``locked`` angle in ``rows``."""
        for joint in sorted({*locked} & {*self.joints}):
            angle, column = locked[joint], self.joints.index(joint)
            measured = self.actual[rows, column]
            if np.abs(apart(measured, angle, self.circular[column])).max() > REACH:
                message = f"{joint} is held at {angle:.4g} rad, and was logged from"
                message += f" {measured.min():.4g} to {measured.max():.4g} rad: lock it there, or"
                message += " choose a motion in which it does not move"
                raise RecordingError(message, **evidence, key=f"dataset.robot.locked.{joint}")


def read_logged_movement(
    name: str,
    movement: Path,
    options: JointLogSection,
    rate: float,
    circular: np.ndarray | bool = True,
) -> LoggedMovement:
    """Read the ``movement`` of that name, a folder of logs or one file, at ``rate`` rows a second;
    ``circular``: which joints turn. Raises RecordingError for logs that are no pair on an even
    clock; ConfigError where the options do not name their columns or delay.
    """
    circular = np.broadcast_to(circular, len(options.joints))
    single = movement.is_file() or is_bag(movement)
    wanted: dict[Path, dict] = {movement: {**options.signals}} if single else {}
    for signal in () if single else SIGNALS:
        if file := getattr(options, signal):
            wanted.setdefault(movement / file, {})[signal] = options.signals.get(signal)
    for signal, place in options.others.items():
        file, columns = (movement / place, None) if isinstance(place, str) else (movement, place)
        # beside angles that the file names itself
        angles = dict.fromkeys(SIGNALS[:2]) if file == movement else {}
        wanted[file] = (wanted.get(file) or angles) | {signal: columns}
    keys = ("time", "separator", "decimal", "angle_unit", "time_unit")
    common = {key: getattr(options, key) for key in keys}
    common |= {"rate": rate, "circular": circular, "joints": len(circular), "names": options.joints}
    common["factors"] = dict.fromkeys(SIGNALS[1:], options.target_factor)
    files = {file: LogOptions(**common, signals=signals) for file, signals in wanted.items()}
    signals, counts = read_movement(files, rate, options.clock) if files else ({}, {})
    if missing := [signal for signal in SIGNALS[:2] if signal not in signals]:
        where = "signals" if single else " and ".join(missing)
        message = f"nothing says where {name} holds the {' and '.join(missing)} angles"
        raise ConfigError(message, key=f"{OPTION}.{where}")
    delay = options.target_delay
    if isinstance(delay, Mapping):
        if name not in delay:
            message = f"no delay for the movement {name}; there are {', '.join(delay)}"
            raise ConfigError(message, key=f"{OPTION}.target_delay")
        delay = delay[name]
    early = round(delay * rate)
    actual, target = delayed(signals["actual"], signals["target"], early)
    if early:
        counts |= {"command_delay": early / rate, "rows_beside_the_delay": abs(early)}
    turns = whole_turns(target, actual, circular)
    if turns.any():
        actual = actual + TURN * turns
        counts |= {"joints_moved_by_whole_turns": np.count_nonzero(turns)}
    require_pair(actual, target, rate, limit=options.mismatch, joints=options.joints, file=movement)
    if "speed" in signals:
        _, speed = delayed(signals["actual"], signals["speed"], early)
    else:
        speed = commanded_speeds(target, rate, options.rest_speed)
        counts |= {"speed_from_angles": 1}
    others = {name: delayed(signals[name], signals["target"], early)[0] for name in options.others}
    return LoggedMovement(options.joints, actual, target, speed, others, counts, circular)
