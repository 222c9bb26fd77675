"""Options of a dataset: a robot, its motion, and the instruments that saw it; null for none."""

from dataclasses import field
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from pipeline.core.bounds import Reading
from pipeline.core.columns import PLANE, SPACE
from pipeline.core.options.analysis import Count, NotNegative, Positive, Whole
from pipeline.core.options.instruments import Depth, Encoders, Force, JointLogSection, Mocap
from pipeline.core.validation import Fault, options

Limit = NotNegative | None


@options()
class Robot:
    urdf: str  # path from the project's root
    # the moving joints, base to tip, as the URDF names them
    joints: Annotated[list[str], Field(min_length=1)]
    tool: str | None = None  # URDF frame of the tip; null: the only last link beyond the joints
    base: str | None = None  # URDF link whose axes the task has; null: the root
    # rad, m of prismatic joints: joints held still; 0 where not named
    locked: dict[str, float] = field(default_factory=dict)
    plane: bool = False  # whether the task is of the plane of parallel joints, not of space
    # any rows of x, z, phi in a plane, else of x, y, z, rx, ry, rz; null: all of them
    task: list[str] | None = None
    length: Positive = 1.0  # m by which radians of the task are multiplied, so that it has one unit

    @model_validator(mode="after")
    def _task_of_the_joints(self) -> Self:
        rows = PLANE if self.plane else SPACE
        task = list(rows if self.task is None else self.task)
        if not task or len({*task}) < len(task) or not {*task} <= {*rows}:
            raise Fault("task", f"{task} must name rows of {', '.join(rows)}, each once")
        if len({*self.joints}) < len(self.joints):
            raise Fault("joints", "must name each joint once")
        if len(task) > len(self.joints):
            found = f"{len(task)} rows are more than {len(self.joints)} joints can move"
            raise Fault("task", f"{found}; leave rows out")
        return self


@options()
class Motion:
    rate: Positive  # 1/s, steps of the motion grid
    steps: Count  # M, steps of a take
    # rad, standard deviation of a measured joint angle; null: as the steps at rest show it
    pose_noise: Positive | None = None


@options()
class Limits:
    """Greatest value of each measure of the table ``takes`` for a take to stay; null: no limit."""

    missing_share: Limit = None  # of the samples of the labelled markers
    longest_gap: Whole | None = None  # frames in a row without joint angles, up to mocap.max_gap
    relabelled_share: Limit = None  # of the samples of the labelled markers
    residual_rms: Limit = None  # m, of the rigid-body fits
    dropped_share: Limit = None  # of the depth frames
    clock_offset_standard_error: Limit = None  # s, where the offset is estimated
    clock_drift: Limit = None  # s/s, likewise
    lag_behind_command: Limit = None  # s, of a joint log, whose section has its other limits


@options()
class About:
    """Text of a datasheet; no stage reads it."""

    subject: str  # robot, instruments, motion
    source: str  # who recorded it, and where it comes from
    licence: str  # terms on which others may use it


@options()
class Dataset:
    name: str
    recordings: str  # folder of the raw files, from the project's root
    robot: Robot | None  # null where forces alone were recorded
    motion: Motion | None  # likewise
    trajectory: str | None = None  # file of the commanded trajectory, where there is one
    mocap: Mocap | None = None
    joint_log: JointLogSection | None = None
    encoders: Encoders | None = None
    depth: Depth | None = None
    force: Force | None = None
    # what the filter weighs particles by: depth (joint angles from the depth camera), encoders, or
    # tip (the pose of the tool, which the motion capture follows)
    measurement: Literal["depth", "encoders", "tip"] = "depth"
    limits: Limits = field(default_factory=Limits)
    reading: Reading = field(default_factory=Reading)
    # the synthetic laboratory that records this dataset; typed by pipeline/laboratory
    laboratory: Any = None

    @model_validator(mode="after")
    def _instruments_of_the_robot(self) -> Self:
        if self.robot is None or self.motion is None:
            parts = ("robot", "motion", "trajectory", "mocap", "joint_log", "encoders", "depth")
            if there := [name for name in parts if getattr(self, name) is not None]:
                raise Fault(there[0], f"without a robot and its motion there is no {there[0]}")
            if self.force is None:
                raise Fault("robot", "a dataset has a robot or a force transducer")
            return self
        task = self.robot.task
        if self.depth is not None and task is not None and not {"x", "z"} <= {*task}:
            message = "the depth camera follows the tip by commanded x and z; keep both rows"
            raise Fault("robot.task", message)
        if self.joint_log is None:
            return self
        arm, log = self.robot.joints, self.joint_log
        if absent := [name for name in arm if name not in log.joints]:
            found = f"{', '.join(absent)} of robot.joints is not logged"
            raise Fault("joint_log.joints", f"{found}; the log holds {', '.join(log.joints)}")
        if len(log.start) != len(arm):
            found = f"must hold {len(arm)} values, one for each of robot.joints"
            raise Fault("joint_log.start", f"{found}, got {len(log.start)}")
        return self
