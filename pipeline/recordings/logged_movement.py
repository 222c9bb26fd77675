"""Measured and commanded angles of one movement in a controller's logs: in rad, and a pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.angles import TURN, apart, turns_apart, whole_turns
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.instruments import SIGNALS, JointLogSection
from pipeline.formats.format import is_bag
from pipeline.formats.joints.log import LogOptions
from pipeline.recordings.movement import read_movement
from pipeline.recordings.pairing import delayed, require_pair
from pipeline.recordings.repetitions import REACH, commanded_speeds

UNITS = {"clock_jitter": "s", "command_delay": "s"}  # of counts that are none


class LoggedMovement(NamedTuple):
    """Rows of a movement, of all its logged joints."""

    joints: Sequence[str]
    actual: np.ndarray  # (N, joints) rad, measured
    target: np.ndarray  # (N, joints) rad, commanded
    speed: np.ndarray  # (N, joints) rad/s, commanded
    others: Mapping[str, np.ndarray]  # (N, joints) each, other signals in any unit
    counts: Mapping[str, float]  # of rows, but for those of UNITS
    circular: np.ndarray | bool = True  # (joints,) whether a joint turns

    def require_held(self, rows: slice, locked: Mapping[str, float], **evidence: object) -> None:
        """Raise RecordingError where a logged joint is not within 0.01 rad of its ``locked`` angle
        (rad) during the ``rows``.
        """
        circular = np.broadcast_to(self.circular, len(self.joints))
        for joint in sorted({*locked} & {*self.joints}):
            angle, column = locked[joint], self.joints.index(joint)
            measured = self.actual[rows, column]
            if np.abs(apart(measured, angle, circular[column])).max() > REACH:
                message = (
                    f"{joint} is held at {angle:.4g} rad, and was logged from "
                    f"{measured.min():.4g} to {measured.max():.4g} rad: lock it where it stood, or "
                    "choose a motion in which it does not move"
                )
                raise RecordingError(message, **evidence, key=f"dataset.robot.locked.{joint}")


def beside(
    actual: np.ndarray,
    target: np.ndarray,
    row: int,
    angles: np.ndarray,
    circular: np.ndarray | bool = True,
) -> tuple[np.ndarray, np.ndarray]:
    """Return ``actual`` and ``target`` (N, n) moved by the whole turns of ``circular`` joints that
    take the command of the ``row`` nearest to ``angles`` (n,), all in rad.
    """
    turns = TURN * turns_apart(angles, target[row], circular)
    return actual + turns, target + turns


def read_logged_movement(
    name: str,
    movement: Path,
    options: JointLogSection,
    rate: float,
    circular: np.ndarray | bool = True,
) -> LoggedMovement:
    """Read the ``movement`` of that name, a folder of logs or one file, at ``rate`` rows a second;
    ``circular``: which joints turn. Raises RecordingError for logs that cannot be read, have no
    even clock or are no pair; ConfigError where the options do not say where both stand.
    """
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
    common = LogOptions(
        **{key: getattr(options, key) for key in keys},
        rate=rate,
        joints=len(options.joints),
        names=options.joints,
        factors={}
        if options.target_factor == 1
        else dict.fromkeys(SIGNALS[1:], options.target_factor),
        circular=circular,
    )
    files = {file: replace(common, signals=signals) for file, signals in wanted.items()}
    signals, counts = read_movement(files, rate, options.clock) if files else ({}, {})
    if missing := [signal for signal in SIGNALS[:2] if signal not in signals]:
        where = "signals" if single else " and ".join(missing)
        message = f"nothing says where {name} holds the {' and '.join(missing)} angles"
        raise ConfigError(message, key=f"dataset.joint_log.{where}")
    delay = options.target_delay
    if isinstance(delay, Mapping):
        if name not in delay:
            message = f"no delay for the movement {name}; there are {', '.join(delay)}"
            raise ConfigError(message, key="dataset.joint_log.target_delay")
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
