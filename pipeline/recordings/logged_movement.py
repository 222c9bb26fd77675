"""Measured and commanded angles of one movement in a controller's logs, as the dataset's options
have them: in rad, row by row, and a pair.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.core.angles import TURN, apart, turns_apart, whole_turns
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.instruments import SIGNALS, JointLog
from pipeline.formats.format import is_bag
from pipeline.formats.joints.log import LogOptions
from pipeline.recordings.movement import read_movement
from pipeline.recordings.pairing import delayed, require_pair
from pipeline.recordings.repetitions import REACH, commanded_speeds, stretch


@dataclass(frozen=True)
class LoggedMovement:
    """The rows of a movement, of all its logged joints."""

    joints: Sequence[str]
    actual: np.ndarray  # (N, joints) rad, measured
    target: np.ndarray  # (N, joints) rad, commanded
    speed: np.ndarray  # (N, joints) rad/s, commanded
    others: Mapping[str, np.ndarray]  # (N, joints) each, other signals in any unit
    counts: Mapping[str, float]  # of rows, but for those of UNITS

    def require_held(self, rows: slice, locked: Mapping[str, float], **evidence: object) -> None:
        """RecordingError with ``evidence`` where a logged joint is not within 0.01 rad of where it
        is ``locked`` (rad) during the ``rows``.
        """
        for joint in sorted({*locked} & {*self.joints}):
            angle, measured = locked[joint], self.actual[rows, self.joints.index(joint)]
            if np.abs(apart(measured, angle)).max() > REACH:
                raise RecordingError(
                    f"{joint} is held at {angle:.4g} rad, and was logged from "
                    f"{measured.min():.4g} to {measured.max():.4g} rad: lock it where it stood, or "
                    "choose a motion in which it does not move",
                    **evidence,
                    key=f"dataset.robot.locked.{joint}",
                )


@dataclass(frozen=True)
class Take:
    """A repetition, and the movement that it was found in."""

    movement: LoggedMovement
    name: str  # of the movement
    chain: list[int]  # columns of the chain's joints
    first: int  # row at which the repetition starts

    def beside(self, angles: np.ndarray) -> Take:
        """The take with its chain's joints moved by the whole turns that take the command of its
        first row nearest to ``angles`` (n,) in rad.
        """
        turns = TURN * turns_apart(angles, self.target[self.first])
        if not turns.any():
            return self
        moved = np.zeros(self.movement.actual.shape[1])
        moved[self.chain] = turns
        rows = self.movement
        return replace(
            self, movement=replace(rows, actual=rows.actual + moved, target=rows.target + moved)
        )

    @property
    def actual(self) -> np.ndarray:
        """(N, n) rad, measured angles of the chain."""
        return self.movement.actual[:, self.chain]

    @property
    def target(self) -> np.ndarray:
        """(N, n) rad, commanded angles of the chain."""
        return self.movement.target[:, self.chain]

    def logged(self, start: float, length: int) -> dict[str, np.ndarray]:
        """(length, joints) residuals in rad of all logged joints, as RESIDUALS, and the other
        logged signals, from ``start`` on.
        """
        held = {RESIDUALS: self.movement.actual - self.movement.target} | self.movement.others
        return {name: stretch(rows, start, length) for name, rows in held.items()}


RESIDUALS = "residuals"
UNITS = {"clock_jitter": "s", "command_delay": "s"}  # of counts that are none


def read_logged_movement(
    name: str,
    movement: Path,
    options: JointLog,
    rate: float,
    sliding: Collection[str] = (),
) -> LoggedMovement:
    """The ``movement`` of that name, a folder of logs or one file, at ``rate`` rows a second;
    joints named in ``sliding`` have coordinates in m.

    Raises RecordingError for logs that cannot be read or whose clock is not even, and for a command
    that is none of the measured angles; ConfigError where the options do not say where both stand.
    """
    single = movement.is_file() or is_bag(movement)
    wanted: dict[Path, dict] = {movement: {**options.signals}} if single else {}
    if not single:
        for signal in SIGNALS:
            if file := getattr(options, signal):
                columns = wanted.setdefault(movement / file, {})
                columns[signal] = options.signals.get(signal)
    for signal, place in options.others.items():
        file = movement / place if isinstance(place, str) else movement
        columns = None if isinstance(place, str) else place
        # beside angles that the file names itself
        angles = dict.fromkeys(SIGNALS[:2]) if file == movement else {}
        wanted[file] = (wanted.get(file) or angles) | {signal: columns}
    common = LogOptions(
        options.time,
        rate,
        options.separator,
        options.decimal,
        options.angle_unit,
        options.time_unit,
        len(options.joints),
        options.joints,
        {} if options.target_factor == 1 else dict.fromkeys(SIGNALS[1:], options.target_factor),
    )
    common = replace(common, sliding=sliding)
    files = {file: replace(common, signals=signals) for file, signals in wanted.items()}
    signals, counts = read_movement(files, rate, options.clock) if files else ({}, {})
    if missing := [signal for signal in ("actual", "target") if signal not in signals]:
        where = "signals" if single else " and ".join(missing)
        raise ConfigError(
            f"nothing says where {name} holds the {' and '.join(missing)} angles",
            key=f"dataset.joint_log.{where}",
        )
    early = round(_delay(options.target_delay, name) * rate)
    actual, target = delayed(signals["actual"], signals["target"], early)
    if early:
        counts |= {"command_delay": early / rate, "rows_beside_the_delay": abs(early)}
    turns = whole_turns(target, actual)
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
    return LoggedMovement(options.joints, actual, target, speed, others, counts)


def _delay(option: float | Mapping[str, float], movement: str) -> float:
    """s by which the command of a ``movement`` is early; ConfigError where the option names others
    alone.
    """
    if not isinstance(option, Mapping):
        return option
    if movement not in option:
        raise ConfigError(
            f"no delay for the movement {movement}; there are {', '.join(option)}",
            key="dataset.joint_log.target_delay",
        )
    return option[movement]
