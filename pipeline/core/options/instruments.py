"""Options of the instruments that saw a robot: motion capture, depth camera, logs, transducer."""

from dataclasses import field
from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, FiniteFloat, model_validator

from pipeline.core.options.analysis import Bounds, Count, NotNegative, Positive, Whole
from pipeline.core.validation import Fault, options

Column = int | str  # number from 0, or label
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
Signal = Literal["actual", "target", "speed"]
ForceSignal = Literal["t", "fx", "fy", "fz", "tx", "ty", "tz"]
SIGNALS = ("actual", "target", "speed")
AngleUnit = StrEnum("AngleUnit", ["rad", "deg"])
TimeUnit = StrEnum("TimeUnit", ["s", "ms", "us", "ns"])


@options()
class Pose:
    position: Triple  # m
    rpy: Triple  # rad, fixed axes x, y, z (URDF convention)


@options()
class Body:
    """A rigid body of the motion capture that is fixed to a link."""

    name: str
    mount: Pose  # of the body's pivot in the link's frame


@options(kw_only=True)
class Mocap:
    training: str  # glob of the training takes' files, .csv of Motive or .c3d
    test: str | None = None
    unit: Literal["m", "cm", "mm"] | None = None  # of lengths where the files do not say it
    base: Pose  # the arm's base in the motion-capture world
    # link of the URDF, or segment of a planar arm → marker → position in the link's frame, m
    markers: dict[str, dict[str, Triple]]
    # link → body whose poses carry the link's markers in place of their tracks
    bodies: dict[str, Body] = field(default_factory=dict)
    gate: float  # m, how far a marker may be from where it is predicted to be taken for it
    deviation: float | None = None  # m, std of a coordinate, for the filter by the tip's pose
    # rad, about where the joints start, where the links leave postures or whole turns open
    posture: list[float] | None = None
    max_gap: int  # frames, longest gap that is interpolated


@options()
class Workspace:
    """The part of the scene that is the arm: distances in m, in the frame of its plane."""

    half_depth: float  # |y| of the arm's surface at most, the sensor's noise included
    girth: float  # how far the arm's surface may lie beyond the reach of its nodes
    column_half_width: float  # the turntable: |x − x(O1)| at most, …
    column_top: float  # … and z − z(O1) at most
    floor: float  # z of what the arm stands on
    min_pixels: int  # a connected patch of fewer, or points of a cloud, is no part of the arm
    max_points: int  # points a frame is thinned to


@options(kw_only=True)
class Depth:
    """A depth camera's takes: folders of images or clouds, indexed or numbered, or ROS bags."""

    takes: str  # glob of the takes' folders or bags
    index: str | None = None  # index file in each folder; null for numbered frames and bags
    frames: str | None = None  # glob of the numbered frames in each folder
    topic: str | None = None  # of the images or clouds in a bag that has several
    camera_info: str | None = None  # topic of the intrinsics in a bag that has several
    intrinsics: str | None = None  # file of the images' calibration; null for clouds and bags
    camera_matrix: str | None = None  # its key in that file, where it is unusual or one of several
    distortion: str | None = None  # likewise
    width: Count | None = None  # px, of the images; null for clouds
    height: Count | None = None  # px
    # rotated_bits as in SUN RGB-D, disparity as in NYU Depth v2
    encoding: Literal["plain", "rotated_bits", "disparity"]
    units_per_metre: Positive  # 1000 for millimetres, 5000 for TUM RGB-D, 1 for metres
    saturation: float | None = None  # stored value from which on there is no depth, as at 0
    scale_key: str | None = None  # name of a factor in the description of each TIFF
    disparity: Bounds | None = None  # a and b of depth = a/(b - disparity), m
    rate: Positive  # 1/s
    start: float | None = None  # s on its clock as the motion capture starts; null: first frame
    # s to add to the camera's clock so started to read the motion capture's; null: estimated
    clock_offset: float | None = None
    camera: Pose  # of x right, y down, z forward, or of the clouds' frame, in the arm's base frame
    workspace: Workspace
    search: NotNegative  # s, the clocks' offset is looked for between -search and +search

    @model_validator(mode="after")
    def _one_source_of_times_and_depths(self) -> Self:
        if self.index is not None and self.frames is not None:
            raise Fault("frames", "index and frames exclude each other: both give the times")
        if (self.disparity is not None) != (self.encoding == "disparity"):
            message = "the encoding disparity, and no other, needs [a, b] of depth = a/(b − δ)"
            raise Fault("disparity", message)
        return self


@options(kw_only=True)
class JointLogSection:
    """The controller's own logs, a folder or a file a movement, and the motion to analyse."""

    movements: str  # glob of the movements' folders, or files where a movement is one file
    actual: str | None = None  # file of measured angles in each folder; null: one file in all
    target: str | None = None  # file of commanded angles
    speed: str | None = None  # file of commanded speeds; null: the steps of the commanded angles
    joints: list[str]  # names of the logged joints in their order, as the URDF has them
    # signal → column of each joint, ARRAY:COLUMN or ARRAY of a NumPy archive; none where the
    # format says itself what it holds
    signals: dict[Signal, list[Column]] = field(default_factory=dict)
    # currents, torques … that show a disturbance: signal → its file in each folder, or its columns
    others: dict[str, str | list[Column]] = field(default_factory=dict)
    time: Column | None = 0  # null: the rows follow each other at dataset.motion.rate
    # of uneven times: rows at the rate, or measured at their times; null: such a log is refused
    clock: Literal["rows", "times"] | None = None
    separator: str | None = None  # comma, semicolon, tab, or a blank for any number; null: as found
    decimal: str | None = None  # point or comma; null: as found
    angle_unit: AngleUnit = AngleUnit.rad  # also of the speeds
    time_unit: TimeUnit = TimeUnit.s
    # of commanded angles and speeds beyond the unit: one, or one of each logged joint
    target_factor: FiniteFloat | list[FiniteFloat] = 1.0
    # s by which the command is early on the measured angles' clock: one, or one of each movement
    target_delay: FiniteFloat | dict[str, FiniteFloat] = 0.0
    mismatch: Positive = 0.05  # greatest 0.9 quantile of a joint's tracking error over its motion
    start: list[float]  # rad, commanded angles of robot.joints before the motion
    end: list[float]  # rad, and after it
    rest: Whole  # steps at rest kept on either side, of motion.steps; 0: it starts in passing
    rest_speed: float = 1e-4  # rad/s, up to which a commanded speed is rest
    tolerance: float  # rad, how exactly commands must repeat
    disturbed: Literal["leave_out", "refuse"] = "leave_out"  # of a disturbed repetition
    disturbed_beyond: float = 6.0  # robust standard deviations from the median repetition
    residual_limit: float | None = None  # rad of measured minus commanded angle, likewise

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
    """The controller's logs beside the motion capture, which the filter may weigh particles by."""

    training: str  # glob of the logs, one of each training take, of its name
    test: str  # glob of the logs, one of each test take, of its name
    actual: list[Column]  # column of the measured angles of each of robot.joints
    time: Column | None = 0  # column of the time
    angle_unit: AngleUnit = AngleUnit.rad
    time_unit: TimeUnit = TimeUnit.s
    start: float = 0.0  # s on the log's clock when the motion capture starts


@options()
class ForceLog:
    """Format of the force logs; null where they say it themselves."""

    format: str = "daqft"  # daqft, netft (ATI's programs), bag, table, or one of formats/force
    columns: dict[ForceSignal, Column] = field(default_factory=dict)
    separator: str | None = None  # of cells, as of a joint log
    decimal: str | None = None  # point or comma
    force_unit: str | None = None
    torque_unit: str | None = None
    time_unit: str | None = None
    rate: Positive | None = None  # Hz
    counts: bool | None = None  # whether a Net F/T log holds counts (true) or units (false)
    topic: str | None = None  # of a bag with more than one WrenchStamped
    calibration: str | None = None  # the transducer's .cal file, from the recordings' folder
    full_scale: list[Positive] | None = None  # N, then N·m; null: the calibration's ratings
    frozen_after: Positive = 0.5  # s, identical samples for longer than this are no measurement
    # share of saturated, or frozen, samples beyond which a record is refused
    max_faulty: Annotated[float, Field(ge=0, lt=1)] = 0.01

    @model_validator(mode="after")
    def _full_scale_of_all_axes(self) -> Self:
        if self.full_scale is not None and len(self.full_scale) not in (3, 6):
            raise Fault("full_scale", "must be three forces, and three torques or none")
        return self


@options()
class Arrangement:
    """One arrangement of the cooperating robots: known quantities of each cable, model's bounds."""

    file: str
    direction: list[float]  # rad, mean direction of each cable; in space its azimuth
    tension: list[float]  # N, mean tension of each cable
    direction_bounds: Bounds  # rad
    # rad, mean elevation of each cable above the x-y plane; null: the cables lie in it
    elevation: list[float] | None = None
    elevation_bounds: Bounds | None = None  # rad
    # m, end of each cable from the point of the moments; null: all there, forces alone are modelled
    attachment: list[list[float]] | None = None
    attachment_bounds: Bounds | None = None  # m, of each coordinate

    @model_validator(mode="after")
    def _one_value_a_cable(self) -> Self:
        cables, axes = len(self.direction), 2 if self.elevation is None else 3
        if len(self.tension) != cables:
            raise Fault("tension", f"must hold {cables} values, one a cable as direction")
        for name, rows in (("elevation", self.elevation), ("attachment", self.attachment)):
            if (rows is None) != (getattr(self, f"{name}_bounds") is None):
                raise Fault(name, f"{name} and {name}_bounds go together")
            if rows is not None and len(rows) != cables:
                raise Fault(name, f"must hold one {name} for each of {cables} cables")
        if any(len(place) != axes for place in self.attachment or []):
            raise Fault("attachment", f"each attachment must have {axes} coordinates")
        return self


@options(kw_only=True)
class Force:
    tare: NotNegative  # s, unloaded at the start of each record
    tension_std: list[float]  # N, of each robot, or of the first of them where fewer pull
    kappa_bounds: Bounds  # 1, the paper's σ_θ
    tension_std_bounds: Bounds  # N
    tension_bounds: Bounds  # N
    configurations: dict[str, Arrangement]
    # m, the point that moments are taken about, in the transducer's axes from its origin
    point: Triple = field(default_factory=lambda: [0.0, 0.0, 0.0])
    length: Positive = 1.0  # m by which moments are divided where they stand beside forces
    log: ForceLog = field(default_factory=ForceLog)
