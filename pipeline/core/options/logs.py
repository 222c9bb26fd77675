"""The types of the configuration for plain logs: those of a force transducer and those of a robot's
controller.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum, auto
from math import isfinite
from typing import Any

from omegaconf import MISSING

from pipeline.core.errors import ConfigError


class AngleUnit(StrEnum):
    rad = auto()
    deg = auto()


class TimeUnit(StrEnum):
    s = auto()
    ms = auto()
    us = auto()
    ns = auto()


class Clock(StrEnum):
    """What becomes of rows that the times put unevenly."""

    rows = auto()  # they follow each other at the rate all the same
    times = auto()  # they were measured at these times


class Disturbed(StrEnum):
    """What becomes of a repetition that was disturbed."""

    leave_out = auto()
    refuse = auto()


@dataclass
class JointLog:
    """The controller's own logs: a folder or a file a movement, and which of the commanded motions
    in them is analysed.
    """

    # glob of the movements' folders, or files where a movement is one file
    movements: str = MISSING
    # file of measured angles in each folder; null where a movement is one file
    actual: str | None = None
    target: str | None = None  # file of commanded angles
    # file of commanded speeds; without any, the speed is the step of the commanded angles
    speed: str | None = None
    # names of the logged joints in their order; those of the arm as its URDF has them
    joints: list[str] = MISSING
    # actual, target, speed → label, or number from 0, of each joint's column; ARRAY:COLUMN of a
    # NumPy archive, or ARRAY alone; where another format says itself what it holds, none
    signals: dict[str, list[Any]] = field(default_factory=dict)
    # other signals of the joints, as currents or torques, that show a disturbance: signal → its
    # file in each folder, or where a movement is one file its columns, as those of signals
    others: dict[str, Any] = field(default_factory=dict)
    # column of the time, likewise; null: the rows follow each other at dataset.motion.rate
    time: Any = 0
    # of rows that the times put unevenly: rows, which follow each other at the rate all the same,
    # or times, at which they were measured; null: such a log is refused
    clock: Clock | None = None
    # of cells: comma, semicolon, tab, or a blank for any number of them; null: as found
    separator: str | None = None
    decimal: str | None = None  # point or comma; null: as found
    angle_unit: AngleUnit = AngleUnit.rad  # also of the speeds
    time_unit: TimeUnit = TimeUnit.s
    # by which commanded angles and speeds are multiplied beyond the unit: one number, or one of
    # each logged joint
    target_factor: Any = 1.0
    # s by which the command is early on the measured angles' clock, to the nearest row: one number,
    # or one of each movement by its name
    target_delay: Any = 0.0
    # of a joint's motion, by which the measured angles may miss the commanded ones (0.9 quantile
    # over the rows)
    mismatch: float = 0.05
    start: list[float] = MISSING  # rad, commanded angles of robot.joints before the motion
    end: list[float] = MISSING  # rad, and after it
    # steps at rest kept on either side, of dataset.motion.steps; 0: the motion starts and ends in
    # passing, as in a command that repeats without rest
    rest: int = MISSING
    rest_speed: float = 1e-4  # rad/s, up to which a commanded speed is rest
    tolerance: float = MISSING  # rad, how exactly commands must repeat
    disturbed: Disturbed = Disturbed.leave_out
    # robust standard deviations of its residual from the median over the repetitions
    disturbed_beyond: float = 6.0
    # rad, measured minus commanded angle that no undisturbed repetition reaches
    residual_limit: float | None = None

    def __post_init__(self) -> None:
        if not self.mismatch > 0:
            raise ConfigError("mismatch is positive", key="dataset.joint_log.mismatch")
        if self.rest != MISSING and self.rest < 0:
            raise ConfigError("rest is not negative", key="dataset.joint_log.rest")
        if MISSING in (self.joints, self.start, self.end):
            return
        if len(self.start) != len(self.end) or len(set(self.joints)) != len(self.joints):
            raise ConfigError(
                "start and end hold a value for each of robot.joints, joints a name for each "
                "logged joint",
                key="dataset.joint_log",
            )
        _require_numbers("target_factor", self.target_factor, len(self.joints))
        _require_numbers("target_delay", self.target_delay)
        if wrong := [
            name
            for name, columns in self.signals.items()
            if len(columns) not in (1, len(self.joints)) or name not in SIGNALS
        ]:
            message = (
                f"{', '.join(wrong)}: signals name {len(self.joints)} columns, or one array, for "
                f"each of {', '.join(SIGNALS)}"
            )
            raise ConfigError(message, key="dataset.joint_log.signals")
        if wrong := [
            name
            for name, place in self.others.items()
            if name in (*SIGNALS, "residuals") or not isinstance(place, str | list)
        ]:
            raise ConfigError(
                f"{', '.join(wrong)}: others name a file or columns, and are none of "
                f"{', '.join(SIGNALS)}",
                key="dataset.joint_log.others",
            )


@dataclass
class Encoders:
    """The controller's logs beside the motion capture: what the filter may weigh particles by.
    Those of the training takes say how far a reading is off.
    """

    training: str = MISSING  # glob of the logs, one of each training take, of its name
    test: str = MISSING  # glob of the logs, one of each test take, of its name
    # label, or number from 0, of the column of each of robot.joints' measured angles
    actual: list[Any] = MISSING
    time: Any = 0  # column of the time, likewise
    angle_unit: AngleUnit = AngleUnit.rad
    time_unit: TimeUnit = TimeUnit.s
    start: float = 0.0  # s on the log's clock when the motion capture starts


SIGNALS = ("actual", "target", "speed")


def _require_numbers(name: str, value: Any, joints: int | None = None) -> None:
    """ConfigError where the option is neither a number nor, of target_factor, one of each of the
    ``joints``, of target_delay one of each movement.
    """
    held = [value]
    if isinstance(value, list) and len(value) == joints:
        held = value
    if isinstance(value, dict) and joints is None:
        held = list(value.values())
    if not all(type(number) in (int, float) and isfinite(number) for number in held):
        several = "a list of one for each joint" if joints else "one for each movement"
        raise ConfigError(f"{name} is a number, or {several}", key=f"dataset.joint_log.{name}")


@dataclass
class ForceLog:
    """How the force logs are written; null where they say so themselves."""

    # daqft or netft, as ATI's programs write, bag of ROS, table: any other, or the option of a
    # FORMAT in pipeline/formats/force
    format: str = "daqft"
    # t, fx, fy, fz, tx, ty, tz → label, or number from 0
    columns: dict[str, Any] = field(default_factory=dict)
    # of cells: comma, semicolon, tab, or a blank for any number of them
    separator: str | None = None
    decimal: str | None = None  # point or comma
    force_unit: str | None = None
    torque_unit: str | None = None
    time_unit: str | None = None
    rate: float | None = None  # Hz
    counts: bool | None = None  # whether a Net F/T log holds counts (true) or units (false)
    topic: str | None = None  # of a bag with more than one WrenchStamped
    calibration: str | None = None  # the transducer's .cal file, from the recordings' folder
    # N, and N·m if there are six; null: the calibration's ratings
    full_scale: list[float] | None = None
    frozen_after: float = 0.5  # s, identical samples for longer than this are no measurement
    # share of saturated, or of frozen, samples that may be left out; beyond it a record is refused
    max_faulty: float = 0.01

    def __post_init__(self) -> None:
        axes = ("t", "fx", "fy", "fz", "tx", "ty", "tz")
        if wrong := [
            axis
            for axis, name in self.columns.items()
            if axis not in axes or not isinstance(name, str | int)
        ]:
            message = (
                f"{', '.join(map(str, wrong))}: columns name {', '.join(axes)} by "
                "label or by number from 0"
            )
            raise ConfigError(message, key="dataset.force.log.columns")
        if self.full_scale is not None and (
            len(self.full_scale) not in (3, 6) or min(self.full_scale) <= 0
        ):
            raise ConfigError(
                "three positive forces, and three torques or none",
                key="dataset.force.log.full_scale",
            )
        if (
            (self.rate is not None and not self.rate > 0)
            or not self.frozen_after > 0
            or not 0 <= self.max_faulty < 1
        ):
            raise ConfigError(
                "rate and frozen_after must be positive, max_faulty between 0 and 1",
                key="dataset.force.log",
            )
