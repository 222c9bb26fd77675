"""Options of a dataset: robot, motion and recording instruments; null: not in the dataset."""

from dataclasses import field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, FiniteFloat, model_validator

from pipeline.core.bounds import Reading
from pipeline.core.columns import PLANE, SPACE
from pipeline.core.options.analysis import Bounds, Count, NotNegative, Positive, Whole
from pipeline.core.validation import Fault, options

Limit = NotNegative | None
Column = int | str  # number from 0, or label
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
Signal = Literal["actual", "target", "speed"]
ForceSignal = Literal["t", "fx", "fy", "fz", "tx", "ty", "tz"]
SIGNALS = ("actual", "target", "speed")
AngleUnit = StrEnum("AngleUnit", ["rad", "deg", "turn/1024", "turn/4096"])
TimeUnit = StrEnum("TimeUnit", ["s", "ms", "us", "ns"])


@options()
class Pose:
    position: Triple  # m
    rpy: Triple  # rad, fixed axes x, y, z (URDF convention)


@options()
class Body:
    """A rigid body of the motion capture, fixed to a link."""

    name: str
    mount: Pose  # of the body's pivot in the link's frame


@options(kw_only=True)
class Mocap:
    training: str  # glob of the training takes' files, .csv of Motive or .c3d
    test: str | None = None
    unit: Literal["m", "cm", "mm"] | None = None  # of lengths; null: the files state it
    base: Pose  # the arm's base in the motion-capture world
    # link of the URDF, or segment of a planar arm → marker → position in the link's frame, m
    markers: dict[str, dict[str, Triple]]
    # link → body whose poses replace the tracks of the link's markers
    bodies: dict[str, Body] = field(default_factory=dict)
    gate: float  # m, greatest distance of a marker from its predicted position
    # rad, approximate joint angles at the start, where the markers allow several postures
    posture: list[float] | None = None
    max_gap: int  # frames, longest gap that is interpolated


@options()
class Workspace:
    """Bounds of the arm in the scene, in m in the frame of its plane."""

    half_depth: float  # greatest |y| of the arm's surface, with the sensor's noise
    girth: float  # greatest distance of the arm's surface beyond the reach of its nodes
    column_half_width: float  # greatest |x − x(O1)| of the turntable
    column_top: float  # greatest z − z(O1) of the turntable
    floor: float  # z of the surface that carries the arm
    # least pixels of a connected patch of the arm, or points of a cloud
    min_pixels: int
    max_points: int  # points that a frame is thinned to


@options(kw_only=True)
class Depth:
    """Takes of a depth camera: folders of indexed or numbered images or clouds, or ROS bags."""

    takes: str  # glob of the takes' folders or bags
    # index file in each folder; null for numbered frames and bags
    index: str | None = None
    frames: str | None = None  # glob of the numbered frames in each folder
    topic: str | None = None  # of the images or clouds, in a bag with several
    camera_info: str | None = None  # topic of the intrinsics, in a bag with several
    # file of the images' calibration; null for clouds and bags
    intrinsics: str | None = None
    # its key in that file, if unusual or one of several
    camera_matrix: str | None = None
    distortion: str | None = None  # its key in that file, if unusual or one of several
    width: Count | None = None  # px, of the images; null for clouds
    height: Count | None = None  # px
    # rotated_bits as in SUN RGB-D, disparity as in NYU Depth v2
    encoding: Literal["plain", "rotated_bits", "disparity"]
    units_per_metre: Positive  # 1000 for millimetres, 5000 for TUM RGB-D, 1 for metres
    saturation: float | None = None  # least stored value that, like 0, means no depth
    scale_key: str | None = None  # name of a factor in the description of each TIFF
    disparity: Bounds | None = None  # a and b of depth = a/(b - disparity), m
    rate: Positive  # 1/s
    # s, camera's clock when motion capture starts; null: first frame
    start: float | None = None
    # s, motion capture's clock minus the camera's clock since its start; null: estimated
    clock_offset: float | None = None
    camera: Pose  # pose of the frame x right, y down, z forward (or clouds' frame) in the base
    workspace: Workspace
    search: NotNegative  # s, bound of the estimated offset of the clocks

    @model_validator(mode="after")
    def _one_source_of_times_and_depths(self) -> Self:
        if self.index is not None and self.frames is not None:
            raise Fault(
                "frames",
                "give index or frames, not both: each of them defines the times",
            )
        if (self.disparity is not None) != (self.encoding == "disparity"):
            message = "[a, b] of depth = a/(b − δ) is for the encoding disparity only, and required"
            raise Fault("disparity", message)
        return self


@options(kw_only=True)
class JointLogSection:
    """Logs of the controller, one folder or file per movement, and the motion to analyse."""

    # glob of the movements' folders, of files where a movement is one file, or of the files of
    # measured angles where the files of a movement differ in a word of their names
    movements: str
    # file of measured angles in each folder, or the word in the names of movements that the other
    # files replace by theirs; null: one file in all
    actual: str | None = None
    target: str | None = None  # file of commanded angles, or its word
    # file of commanded speeds, or its word; null: the steps of the commanded angles
    speed: str | None = None
    joints: list[str]  # names in the URDF of the logged joints, in the order of the log
    # signal → column of each joint, ARRAY:COLUMN or ARRAY of a NumPy archive; {} if the format
    # names the signals
    signals: dict[Signal, list[Column]] = field(default_factory=dict)
    # column of the times, or a file of one column as the files of the signals; null: rows at
    # dataset.motion.rate
    time: Column | None = 0
    # for uneven times: rows are at the rate, or at their logged times; null: an error
    clock: Literal["rows", "times"] | None = None
    # comma, semicolon, tab, or a blank for any number; null: detected
    separator: str | None = None
    decimal: str | None = None  # point or comma; null: detected
    angle_unit: AngleUnit = AngleUnit.rad  # also of the speeds
    time_unit: TimeUnit = TimeUnit.s
    # factor on commanded angles and speeds after their unit: a number, or one per logged joint
    target_factor: FiniteFloat | list[FiniteFloat] = 1.0
    # s, lead of the command on the measured angles' clock: a number, or a number per movement
    target_delay: FiniteFloat | dict[str, FiniteFloat] = 0.0
    # greatest 0.9 quantile of a joint's tracking error over its motion
    mismatch: Positive = 0.05
    start: list[float]  # rad, commanded angles of robot.joints before the motion
    end: list[float]  # rad, commanded angles of robot.joints after the motion
    rest: Whole  # steps at rest before and after, of motion.steps; 0: no rest
    rest_speed: Positive = 1e-4  # rad/s, greatest commanded speed at rest
    tolerance: Positive  # rad, greatest difference of repeated commands

    @model_validator(mode="after")
    def _fits_the_joints(self) -> Self:
        count = len(self.joints)
        if len(set(self.joints)) != count:
            raise Fault("joints", "must name each logged joint once")
        if len(self.start) != len(self.end):
            raise Fault(
                "end",
                f"must have {len(self.start)} values as start, got {len(self.end)}",
            )
        if isinstance(self.target_factor, list) and len(self.target_factor) != count:
            raise Fault(
                "target_factor",
                f"must be a number or a list of {count}, one per joint",
            )
        for name, columns in self.signals.items():
            if len(columns) not in (1, count):
                raise Fault(
                    f"signals.{name}",
                    f"must name {count} columns or one array",
                )
        return self


@options()
class Encoders:
    """Controller logs recorded during motion capture, for measurement: encoders."""

    training: str  # glob of the logs, one for each training take and with its name
    test: str  # glob of the logs, one for each test take and with its name
    actual: list[Column]  # column of the measured angles, for each of robot.joints
    time: Column | None = 0  # column of the time
    angle_unit: AngleUnit = AngleUnit.rad
    time_unit: TimeUnit = TimeUnit.s
    start: float = 0.0  # s on the log's clock when the motion capture starts


@options()
class ForceLog:
    """Format of the force logs; null where the files state it."""

    # daqft, netft (ATI's programs), bag, table, or one of formats/force
    format: str = "daqft"
    columns: dict[ForceSignal, Column] = field(default_factory=dict)
    separator: str | None = None  # comma, semicolon, tab, or a blank for any number
    decimal: str | None = None  # point or comma
    force_unit: str | None = None
    torque_unit: str | None = None
    time_unit: str | None = None
    rate: Positive | None = None  # Hz
    # whether a Net F/T log has counts (true) or units (false)
    counts: bool | None = None
    topic: str | None = None  # of a bag with more than one WrenchStamped
    # transducer's .cal file, relative to the recordings' folder
    calibration: str | None = None
    # N, then N·m; null: the calibration's ratings
    full_scale: list[Positive] | None = None
    frozen_after: Positive = 0.5  # s, identical samples for longer count as frozen
    # greatest share of saturated samples, and of frozen ones, in a record
    max_faulty: Annotated[float, Field(ge=0, lt=1)] = 0.01

    @model_validator(mode="after")
    def _full_scale_of_all_axes(self) -> Self:
        if self.full_scale is not None and len(self.full_scale) not in (3, 6):
            raise Fault("full_scale", "must be three forces, and three torques or none")
        return self


@options()
class Arrangement:
    """One arrangement of the cooperating robots: quantities of each cable, bounds of the model."""

    file: str
    direction: list[float]  # rad, mean direction of each cable; in space its azimuth
    tension: list[float]  # N, mean tension of each cable
    direction_bounds: Bounds  # rad
    # rad, mean elevation of each cable above the x-y plane; null: all cables are in the plane
    elevation: list[float] | None = None
    elevation_bounds: Bounds | None = None  # rad
    # m, end of each cable from the point of the moments; null: at this point, only forces modelled
    attachment: list[list[float]] | None = None
    attachment_bounds: Bounds | None = None  # m, of each coordinate

    @model_validator(mode="after")
    def _one_value_a_cable(self) -> Self:
        cables = len(self.direction)
        axes = 2 if self.elevation is None else 3
        if len(self.tension) != cables:
            raise Fault(
                "tension",
                f"must have {cables} values, one per cable as direction",
            )
        for name, rows in (
            ("elevation", self.elevation),
            ("attachment", self.attachment),
        ):
            if (rows is None) != (getattr(self, f"{name}_bounds") is None):
                raise Fault(name, f"give both {name} and {name}_bounds, or neither")
            if rows is not None and len(rows) != cables:
                raise Fault(name, f"must have one {name} for each of {cables} cables")
        if any(len(place) != axes for place in self.attachment or []):
            raise Fault("attachment", f"each attachment must have {axes} coordinates")
        return self


@options(kw_only=True)
class Force:
    tare: NotNegative  # s, unloaded at the start of each record
    # N, of each robot; a configuration with k robots uses the first k
    tension_std: list[float]
    kappa_bounds: Bounds  # 1, the paper's σ_θ
    tension_std_bounds: Bounds  # N
    tension_bounds: Bounds  # N
    configurations: dict[str, Arrangement]
    # m, point about which moments are taken, in the transducer's frame
    point: Triple = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # m by which moments are divided where they are compared with forces
    length: Positive = 1.0
    log: ForceLog = field(default_factory=ForceLog)


@options()
class Robot:
    urdf: str  # path from the project's root
    # the moving joints, base to tip, as the URDF names them
    joints: Annotated[list[str], Field(min_length=1)]
    # URDF frame of the tip; null: the only last link beyond the joints
    tool: str | None = None
    base: str | None = None  # URDF link in whose axes the task is; null: the root
    # rad or m: fixed positions of other joints; 0 if absent
    locked: dict[str, float] = field(default_factory=dict)
    # whether the task is in the plane of parallel joints, else in space
    plane: bool = False
    # rows of x, z, phi in a plane, else of x, y, z, rx, ry, rz; null: all
    task: list[str] | None = None
    # m by which radians of the task are multiplied, to have one unit
    length: Positive = 1.0

    @model_validator(mode="after")
    def _task_of_the_joints(self) -> Self:
        rows = PLANE if self.plane else SPACE
        task = list(rows if self.task is None else self.task)
        if not task or len({*task}) < len(task) or not {*task} <= {*rows}:
            raise Fault(
                "task",
                f"{task} must name rows of {', '.join(rows)}, each once",
            )
        if len({*self.joints}) < len(self.joints):
            raise Fault("joints", "must name each joint once")
        if len(task) > len(self.joints):
            rows = f"{len(task)} rows are more than {len(self.joints)} joints can move"
            raise Fault("task", f"{rows}; leave rows out")
        return self


@options()
class Motion:
    rate: Positive  # 1/s, steps of the motion grid
    steps: Count  # M, steps of a take
    # rad, standard deviation of a measured joint angle; null: estimated from the steps at rest
    pose_noise: Positive | None = None


UNSEEN = (
    "all takes late by the same time (the lag behind the command is printed); a commanded path "
    "that is shifted together with the arm; takes that are all copies of one take (printed as "
    "equal within the noise); the mean of several takes; a mirrored take; a copy with slow noise "
    "of its own"
)


@options()
class Limits:
    """Limits of the measures in the table ``takes``; a take beyond one is left out. null: none.

    UNSEEN names what no limit sees.
    """

    missing_share: Limit = None  # of the samples of the labelled markers
    # frames in a row without joint angles, up to mocap.max_gap
    longest_gap: Whole | None = None
    relabelled_share: Limit = None  # of the samples of the labelled markers
    residual_rms: Limit = None  # m, of the rigid-body fits
    dropped_share: Limit = None  # of the depth frames
    clock_offset_standard_error: Limit = None  # s, where the offset is estimated
    clock_drift: Limit = None  # s/s, where the offset is estimated
    # s, behind the median take: 7 times the laboratory's greatest
    lag_beside_others: Limit = 0.03
    # own take over others: ≤ 0.7 sound, ≥ 0.78 of another
    camera_residual_share: Limit = 0.75
    # robust standard deviations from the median take: ≤ 5 if sound
    disturbance: Limit = 6.0
    # distance of takes that are equal within the noise to the next take, in noise: ≤ 1.2 if sound
    likeness: Limit = 3.5
    lag_behind_command: Limit = None  # s


@options()
class About:
    """Text of a datasheet, which no stage reads."""

    subject: str  # robot, instruments, motion
    source: str  # who recorded it, and where it is published
    licence: str  # terms of use


@options()
class Dataset:
    name: str
    # folder of the raw files: in the project, beside it (../NAME) or absolute
    recordings: str
    # null where only forces were recorded, or logs without repetitions
    robot: Robot | None
    motion: Motion | None  # null where only forces were recorded
    trajectory: str | None = None  # file of the commanded trajectory
    mocap: Mocap | None = None
    joint_log: JointLogSection | None = None
    encoders: Encoders | None = None
    depth: Depth | None = None
    force: Force | None = None
    # measurement of the filter: joint angles from the depth camera or from encoders
    measurement: Literal["depth", "encoders"] = "depth"
    limits: Limits = field(default_factory=Limits)
    reading: Reading = field(default_factory=Reading)
    # synthetic laboratory that records this dataset; typed by its package
    laboratory: Any = None

    @model_validator(mode="after")
    def _instruments_of_the_robot(self) -> Self:
        if ".." in Path(self.recordings).parts[1:]:
            message = "must be in the project, beside it (../NAME) or an absolute path"
            raise Fault("recordings", f"{message}, got {self.recordings}")
        if (
            self.robot is None
            and self.motion is not None
            and self.joint_log is not None
        ):
            return self  # logs are analysed joint by joint, without a Jacobian
        if self.robot is None or self.motion is None:
            parts = (
                "robot",
                "motion",
                "trajectory",
                "mocap",
                "joint_log",
                "encoders",
                "depth",
            )
            if there := [name for name in parts if getattr(self, name) is not None]:
                raise Fault(there[0], f"{there[0]} requires a robot and its motion")
            if self.force is None:
                raise Fault("robot", "a dataset needs a robot or a force transducer")
            return self
        longest = self.limits.longest_gap or 0
        if self.mocap is not None and longest > (most := self.mocap.max_gap):
            message = (
                f"must be at most the {most} of dataset.mocap.max_gap, got {longest}"
            )
            raise Fault("limits.longest_gap", message)
        task = self.robot.task
        if self.depth is not None and task is not None and not {"x", "z"} <= {*task}:
            message = (
                "the depth camera follows the tip by commanded x and z; keep both rows"
            )
            raise Fault("robot.task", message)
        if self.joint_log is None:
            return self
        arm = self.robot.joints
        log = self.joint_log
        if absent := [name for name in arm if name not in log.joints]:
            message = f"{', '.join(absent)} of robot.joints is not logged; the log has "
            raise Fault("joint_log.joints", message + ", ".join(log.joints))
        if len(log.start) != len(arm):
            message = f"must have {len(arm)} values, one for each of robot.joints, got "
            raise Fault("joint_log.start", f"{message}{len(log.start)}")
        return self
