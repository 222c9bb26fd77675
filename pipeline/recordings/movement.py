"""The logs of one movement of a robot, paired row by row on an even clock."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.arm.urdf import read_urdf
from pipeline.core.angles import TURN, unwrapped
from pipeline.core.errors import RecordingError
from pipeline.core.options.instruments import SIGNALS
from pipeline.formats import joints as joint_formats
from pipeline.formats.format import Kind, format_of, formats_in
from pipeline.formats.joints import table
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions

CLOCK_TOLERANCE = 0.1  # of a step, up to which the rows are taken as even
JITTER = 0.5  # of a step, beyond which a row is missing, or one too many
RATE_TOLERANCE = 0.01  # of the rate, which the rows keep on average
ANGLES = ("actual", "target")  # signals that are angles of joints
UNWRAPPED = "unwrapped_jumps"  # count of jumps of whole turns that were removed
FASTER = 1.05  # of a joint's velocity limit, up to which a step is the joint's own
STEP_NOISE = 1e-3  # rad by which noise and rounding of two rows may add to a step
UNFILLED = "???"  # value of an option that is not filled in
# no joint of an arm turns farther from its zero than this, so that angles beyond are in another
# unit
MOST_TURNS = 4


def read_movement(
    files: Mapping[Path, LogOptions], rate: float, clock: str | None = None
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Signals (N, joints) of the logs ``files`` of one movement, row by row at the same times, as
    many as the shortest log has; of each the signals of its options, or all where these name none.

    Rows that their times put unevenly, by more than a tenth of a step and up to half of one, are
    counted as ``uneven_rows``, with the standard deviation of the steps in s as ``clock_jitter``;
    what becomes of them says ``clock``: taken row by row (``rows``), or interpolated by a cubic
    spline through the times (``times``) and counted as ``resampled_rows``. ``counts`` beside: those
    of the logs, and ``rows_without_partner`` that were left out because another log ends before
    them. Raises RecordingError for clocks that disagree, do not keep to ``rate`` (1/s), or are
    uneven where ``clock`` is None.
    """
    from scipy.interpolate import CubicSpline

    logs = {file: read_log(file, options) for file, options in files.items()}
    length = min(len(log.time) for log in logs.values())
    first, time = next((file, log.time[:length]) for file, log in logs.items())
    uneven = _uneven_rows(time, rate, first)
    for file, log in logs.items():
        if (np.abs(log.time[:length] - time) * rate > CLOCK_TOLERANCE).any():
            raise RecordingError(
                f"the times are not those of {first.name}; take logs of one recording", file=file
            )
    counts: Counter[str] = Counter()
    for log in logs.values():
        counts.update(log.counts | {"rows_without_partner": len(log.time) - length})
    signals = {
        name: values[:length] for log in logs.values() for name, values in log.signals.items()
    }
    if not uneven:
        return signals, dict(counts)
    jitter = float(np.diff(time).std())
    if clock is None:
        smoother = smoothness_by_rows(time, np.hstack([*signals.values()]), rate)
        raise RecordingError(
            f"{uneven} rows are uneven by their times, which jitter by {1e3 * jitter:.3g} ms: say "
            "whether the rows follow each other at the rate (rows) or were measured at those times "
            f"(times); row by row the angles are {smoother:.3g} times as smooth",
            file=first,
            key=f"{OPTION}.clock",
        )
    clocked: dict[str, float] = {"uneven_rows": uneven, "clock_jitter": jitter}
    if clock == "times":
        grid = time[0] + np.arange(int((time[-1] - time[0]) * rate + CLOCK_TOLERANCE) + 1) / rate
        signals = {name: CubicSpline(time, rows)(grid) for name, rows in signals.items()}
        clocked["resampled_rows"] = len(grid)
    return signals, dict(counts) | clocked


def smoothness_by_rows(time: np.ndarray, angles: np.ndarray, rate: float) -> float:
    """By how much smoother ``angles`` (N, joints) are as a function of the row, at ``rate``, than
    of the ``time`` (N,) in s: above 1 where the times jitter and the sampling does not, below 1
    where the rows were measured at their times. The ratio of the root mean square third derivatives
    (divided differences; medians over rows, so that a jump does not decide).
    """

    def roughness(clock: np.ndarray) -> float:
        derivative = angles
        for order in (1, 2, 3):
            derivative = np.diff(derivative, axis=0) / (clock[order:] - clock[:-order])[:, None]
        return float(np.sqrt(np.median((derivative**2).sum(axis=1))))

    by_rows = roughness(np.arange(len(time)) / rate)
    return roughness(time) / by_rows if by_rows else np.inf


def _uneven_rows(time: np.ndarray, rate: float, file: Path) -> int:
    """How many of the steps of ``time`` (N,) are not 1/``rate``; RecordingError where they cannot
    be those of a log at that rate.
    """
    steps = np.diff(time)
    off = np.abs(steps * rate - 1)
    mean = (time[-1] - time[0]) / max(len(time) - 1, 1)
    usual = float(np.median(steps)) if len(steps) else 1 / rate
    if len(time) > 1 and abs(usual * rate - 1) > JITTER:
        raise RecordingError(
            f"the log steps by {usual:.6g} s as a rule, not by 1/{rate:g} s: is its rate "
            f"{1 / usual:.6g} 1/s, and its time_unit right?",
            file=file,
            key="dataset.motion.rate",
        )
    if off.max(initial=0.0) > JITTER:
        row = int(np.argmax(off > JITTER))
        step = time[row + 1] - time[row]
        what = "samples are missing" if step * rate > 1 else "rows stand too close"
        raise RecordingError(
            f"the log steps by {step:.6g} s at {time[row] - time[0]:.6g} s from its start, not by "
            f"1/{rate:g} s; {what}",
            file=file,
        )
    if len(time) > 1 and abs(mean * rate - 1) > RATE_TOLERANCE:
        raise RecordingError(
            f"the log steps by {mean:.6g} s on average, not by 1/{rate:g} s: is its rate "
            f"{1 / mean:.6g} 1/s?",
            file=file,
            key="dataset.motion.rate",
        )
    return int((off > CLOCK_TOLERANCE).sum())


def read_log(file: Path, options: LogOptions) -> JointLog:
    """Return the log in ``file``, of whichever format it begins like, else as a plain table; its
    signals multiplied by the factors of ``options``, its angles without jumps of whole turns, which
    ``unwrapped_jumps`` counts.

    Raises RecordingError for another number of joints than the options say or other names, for
    angles beyond four turns, and for jumps that are no whole turns.
    """
    chosen = format_of(file, formats_in(joint_formats, Kind.JOINTS)) or table.FORMAT
    log = chosen.read(file, options)
    signals = {
        name: values
        for name, values in log.signals.items()
        if name in (options.signals or log.signals)
    }
    if wrong := {values.shape[1] for values in signals.values()} - {options.joints}:
        raise RecordingError(
            f"the log holds {wrong.pop()} joints, not {options.joints}",
            file=file,
            key=f"{OPTION}.joints",
        )
    if log.joints and options.names and log.joints != tuple(options.names):
        raise RecordingError(
            f"the log states its joints as {', '.join(log.joints)}",
            file=file,
            key=f"{OPTION}.joints",
        )
    signals = {
        name: rows * np.asarray(options.factors[name]) if name in options.factors else rows
        for name, rows in signals.items()
    }
    for name, rows in signals.items():
        if name not in SIGNALS:
            continue
        greatest = np.abs(rows).max(axis=1, initial=0.0)
        if greatest.max() > MOST_TURNS * TURN:
            raise RecordingError(
                f"{name}: {greatest.max():.6g} rad, or rad/s, at "
                f"{log.time[greatest.argmax()] - log.time[0]:.6g} s from the start is not a joint "
                f"of an arm: is the angle_unit {options.angle_unit}?",
                file=file,
                key=f"{OPTION}.angle_unit",
            )
    jumps = 0
    for name in filter(signals.__contains__, ANGLES):
        signals[name], removed = unwrapped(
            signals[name],
            log.time,
            options.names or log.joints,
            signal=name,
            sliding=options.sliding,
            file=file,
        )
        jumps += removed
    counts = log.counts | ({UNWRAPPED: jumps} if jumps else {})
    return replace(log, signals=signals, counts=counts)


def speed_limits(urdf: str) -> dict[str, float]:
    """Return the velocity limit in rad/s (m/s of a prismatic joint) of each joint that has one in
    the file ``urdf``, none where no file is named; ConfigError as
    :func:`pipeline.arm.urdf.read_urdf`.
    """
    if urdf == UNFILLED:
        return {}
    joints = read_urdf(Path(urdf)).joints
    stated = {name: joint.limits or {} for name, joint in joints.items()}
    return {name: limits["velocity"] for name, limits in stated.items() if "velocity" in limits}


def sliding_joints(urdf: str) -> frozenset[str]:
    """Return the names of the prismatic joints in the file ``urdf``, whose coordinates are no
    angles; errors as :func:`speed_limits`.
    """
    joints = {} if urdf == UNFILLED else read_urdf(Path(urdf)).joints
    return frozenset(name for name, joint in joints.items() if joint.kind == "prismatic")


def require_speeds(
    time: np.ndarray,
    angles: Mapping[str, np.ndarray],
    joints: Sequence[str],
    limits: Mapping[str, float],
    **evidence: object,
) -> None:
    """Raise RecordingError with ``evidence`` where an angle steps faster than its joint can.

    Args:
        time: (N,) s.
        angles: (N, joints) rad of each signal.
        joints: Names of the columns.
        limits: rad/s by the joint's name; 0, as some exporters write, stands for none.
        evidence: File of the angles.
    """
    for column, joint in enumerate(joints):
        if not (limit := limits.get(joint, 0.0)) > 0:
            continue
        for signal, rows in angles.items():
            steps, seconds = np.abs(np.diff(rows[:, column])), np.diff(time)
            beyond = steps > FASTER * limit * seconds + STEP_NOISE
            if beyond.any():
                row = int(np.argmax(beyond))
                at = round(float(time[row + 1] - time[0]), 6)
                raise RecordingError(
                    f"{joint} ({signal}) steps by {steps[row]:.4g} rad at {at:g} s from the start: "
                    f"{steps[row] / seconds[row]:.4g} rad/s, where the robot's URDF allows "
                    f"{limit:.4g} rad/s; leave this part of the log out, or correct the velocity "
                    "limit of the joint in the URDF",
                    **evidence,
                    joint=joint,
                    time=at,
                )
