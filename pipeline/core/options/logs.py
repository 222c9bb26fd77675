"""The types of the configuration for plain logs: those of a force transducer and those of a robot's
controller.
"""

from __future__ import annotations

from dataclasses import field
from enum import StrEnum, auto
from typing import Annotated, Literal, Self

from pydantic import Field, FiniteFloat, model_validator

from pipeline.core.options.analysis import Positive
from pipeline.core.validation import Fault, options

Column = int | str  # number from 0, or label
Axis = Literal["t", "fx", "fy", "fz", "tx", "ty", "tz"]
Signal = Literal["actual", "target", "speed"]
SIGNALS = ("actual", "target", "speed")


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


@options(kw_only=True)
class JointLog:
    """The controller's own logs: a folder or a file a movement, and which of the commanded motions
    in them is analysed.
    """

    # glob of the movements' folders, or files where a movement is one file
    movements: str
    # file of measured angles in each folder; null where a movement is one file
    actual: str | None = None
    target: str | None = None  # file of commanded angles
    # file of commanded speeds; without any, the speed is the step of the commanded angles
    speed: str | None = None
    # names of the logged joints in their order; those of the arm as its URDF has them
    joints: list[str]
    # actual, target, speed → label, or number from 0, of each joint's column; ARRAY:COLUMN of a
    # NumPy archive, or ARRAY alone; where another format says itself what it holds, none
    signals: dict[Signal, list[Column]] = field(default_factory=dict)
    # other signals of the joints, as currents or torques, that show a disturbance: signal → its
    # file in each folder, or where a movement is one file its columns, as those of signals
    others: dict[str, str | list[Column]] = field(default_factory=dict)
    # column of the time, likewise; null: the rows follow each other at dataset.motion.rate
    time: Column | None = 0
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
    target_factor: FiniteFloat | list[FiniteFloat] = 1.0
    # s by which the command is early on the measured angles' clock, to the nearest row: one number,
    # or one of each movement by its name
    target_delay: FiniteFloat | dict[str, FiniteFloat] = 0.0
    # most that a joint's tracking error may be, divided by the joint's motion: 0.9 quantile of rows
    mismatch: Positive = 0.05
    start: list[float]  # rad, commanded angles of robot.joints before the motion
    end: list[float]  # rad, and after it
    # steps at rest kept on either side, of dataset.motion.steps; 0: the motion starts and ends in
    # passing, as in a command that repeats without rest
    rest: Annotated[int, Field(ge=0)]
    rest_speed: float = 1e-4  # rad/s, up to which a commanded speed is rest
    tolerance: float  # rad, how exactly commands must repeat
    disturbed: Disturbed = Disturbed.leave_out
    # robust standard deviations of its residual from the median over the repetitions
    disturbed_beyond: float = 6.0
    # rad, measured minus commanded angle that no undisturbed repetition reaches
    residual_limit: float | None = None

    @model_validator(mode="after")
    def _fits_the_joints(self) -> Self:
        count = len(self.joints)
        if len(set(self.joints)) != count:
            raise Fault("joints", "must name each logged joint once")
        if len(self.start) != len(self.end):
            raise Fault("end", f"must hold {len(self.start)} values as start, got {len(self.end)}")
        if isinstance(self.target_factor, list) and len(self.target_factor) != count:
            raise Fault("target_factor", f"must be a number or a list of {count}, one a joint")
        for name, columns in self.signals.items():
            if len(columns) not in (1, count):
                raise Fault(f"signals.{name}", f"must name {count} columns or one array")
        if wrong := [name for name in self.others if name in (*SIGNALS, "residuals")]:
            raise Fault(f"others.{wrong[0]}", f"must have another name than {', '.join(SIGNALS)}")
        return self


@options()
class Encoders:
    """The controller's logs beside the motion capture: what the filter may weigh particles by.
    Those of the training takes say how far a reading is off.
    """

    training: str  # glob of the logs, one of each training take, of its name
    test: str  # glob of the logs, one of each test take, of its name
    # label, or number from 0, of the column of each of robot.joints' measured angles
    actual: list[Column]
    time: Column | None = 0  # column of the time, likewise
    angle_unit: AngleUnit = AngleUnit.rad
    time_unit: TimeUnit = TimeUnit.s
    start: float = 0.0  # s on the log's clock when the motion capture starts


@options()
class ForceLog:
    """How the force logs are written; null where they say so themselves."""

    # daqft or netft, as ATI's programs write, bag of ROS, table: any other, or the option of a
    # FORMAT in pipeline/formats/force
    format: str = "daqft"
    # t, fx, fy, fz, tx, ty, tz → label, or number from 0
    columns: dict[Axis, Column] = field(default_factory=dict)
    # of cells: comma, semicolon, tab, or a blank for any number of them
    separator: str | None = None
    decimal: str | None = None  # point or comma
    force_unit: str | None = None
    torque_unit: str | None = None
    time_unit: str | None = None
    rate: Positive | None = None  # Hz
    counts: bool | None = None  # whether a Net F/T log holds counts (true) or units (false)
    topic: str | None = None  # of a bag with more than one WrenchStamped
    calibration: str | None = None  # the transducer's .cal file, from the recordings' folder
    # N, and N·m if there are six; null: the calibration's ratings
    full_scale: list[Positive] | None = None
    frozen_after: Positive = 0.5  # s, identical samples for longer than this are no measurement
    # share of saturated, or of frozen, samples that may be left out; beyond it a record is refused
    max_faulty: Annotated[float, Field(ge=0, lt=1)] = 0.01

    @model_validator(mode="after")
    def _full_scale_of_all_axes(self) -> Self:
        if self.full_scale is not None and len(self.full_scale) not in (3, 6):
            raise Fault("full_scale", "must be three forces, and three torques or none")
        return self
