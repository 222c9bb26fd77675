"""The types of the configuration: what may stand in params.yaml and pipeline/conf, section by section.

Values, units and reasons stand in the option files; a key that is not here is refused. A dataset may lack any instrument: its
section is then null.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from omegaconf import MISSING

from pipeline.errors import ConfigError
from pipeline.schema_compute import Compute
from pipeline.schema_limits import Limits
from pipeline.schema_logs import ForceLog, JointLog


@dataclass
class Robot:
    urdf: str = MISSING  # path from the project's root
    joints: list[str] = MISSING  # the three joints of the planar chain, base to tip
    tool: str = MISSING  # URDF frame of the end-effector
    locked: dict[str, float] = field(default_factory=dict)  # rad, joints held still


@dataclass
class Motion:
    rate: float = MISSING  # 1/s, steps of the motion grid
    steps: int = MISSING  # M, steps of a take


@dataclass
class Pose:
    position: list[float] = MISSING  # m
    rpy: list[float] = MISSING  # rad, fixed axes x, y, z (URDF convention)


@dataclass
class Body:
    """A rigid body of the motion capture that is fixed to a link."""

    name: str = MISSING
    mount: Pose = field(default_factory=Pose)  # of the body's pivot in the segment's frame


@dataclass
class Mocap:
    training: str = MISSING  # glob of the training takes' files, .csv of Motive or .c3d
    test: str | None = None
    unit: str | None = None  # m, cm or mm, of lengths where the files do not say it
    base: Pose = field(default_factory=Pose)  # the arm's base in the motion-capture world
    markers: dict[str, dict[str, list[float]]] = MISSING  # link → marker name → position in the segment's frame, m
    bodies: dict[str, Body] = field(default_factory=dict)  # link → body whose poses carry the link's markers in place of their tracks
    gate: float = MISSING  # m, how far a marker may be from where it is predicted to be taken for it
    max_gap: int = MISSING  # frames, longest gap that is interpolated

    def __post_init__(self) -> None:
        if self.unit not in (None, "m", "cm", "mm"):
            raise ConfigError(f"unit: no unit {self.unit!r}; there are m, cm, mm", key="dataset.mocap.unit")


@dataclass
class Workspace:
    """What of the scene is the arm, in the frame of its plane (see :class:`pipeline.perception.segment.Crop`)."""

    half_depth: float = MISSING  # m
    girth: float = MISSING  # m
    column_half_width: float = MISSING  # m
    column_top: float = MISSING  # m
    floor: float = MISSING  # m
    min_pixels: int = MISSING
    max_points: int = MISSING


@dataclass
class Depth:
    """A depth camera's takes: folders of images or point clouds, with an index or with numbers in their names, or ROS bags."""

    takes: str = MISSING  # glob of the takes' folders or bags
    index: str | None = None  # index file in each folder; null where the frames' names are numbered, and for bags
    frames: str | None = None  # glob of the numbered frames in each folder
    topic: str | None = None  # of the images or clouds in a bag that has several
    camera_info: str | None = None  # topic of the intrinsics in a bag that has several, where there is no file of them
    intrinsics: str | None = None  # file of the images' calibration, from the recordings' folder; null for clouds and bags
    camera_matrix: str | None = None  # its key in that file, where that is unusual or there are several
    distortion: str | None = None  # likewise
    width: int | None = None  # px, of the images; null for clouds
    height: int | None = None  # px
    encoding: str = MISSING  # plain, rotated_bits (SUN RGB-D) or disparity (NYU Depth v2)
    units_per_metre: float = MISSING  # 1000 for millimetres, 5000 for TUM RGB-D, 1 for metres
    saturation: float | None = None  # stored value from which on there is no depth, as there is none at 0
    scale_key: str | None = None  # name of a factor in the description of each TIFF
    disparity: list[float] | None = None  # a and b of depth = a/(b - disparity), m
    rate: float = MISSING  # 1/s
    start: float | None = None  # s on the camera's clock as the motion capture starts; null: at its first frame
    clock_offset: float | None = None  # s to add to the camera's clock so started to read the motion capture's; null: estimated
    camera: Pose = field(default_factory=Pose)  # camera (x right, y down, z forward), or the clouds' frame, in the arm's base frame
    workspace: Workspace = field(default_factory=Workspace)
    search: float = MISSING  # s, the clocks' offset is looked for between -search and +search

    def __post_init__(self) -> None:
        if self.index is not None and self.frames is not None:
            raise ConfigError("index and frames exclude each other: the times come from the one or the other", key="dataset.depth.frames")


@dataclass
class Configuration:
    """One arrangement of the cooperating robots: what is known of each cable, and the bounds given for the model."""

    file: str = MISSING
    direction: list[float] = MISSING  # rad, mean direction of each cable
    tension: list[float] = MISSING  # N, mean tension of each cable
    direction_bounds: list[float] = MISSING  # rad


@dataclass
class Force:
    tare: float = MISSING  # s, unloaded at the start of each record
    tension_std: list[float] = MISSING  # N, of each robot
    kappa_bounds: list[float] = MISSING  # 1, the paper's σ_θ
    tension_std_bounds: list[float] = MISSING  # N
    tension_bounds: list[float] = MISSING  # N
    configurations: dict[str, Configuration] = MISSING
    log: ForceLog = field(default_factory=ForceLog)


@dataclass
class Dataset:
    name: str = MISSING
    recordings: str = MISSING  # folder of the raw files, from the project's root
    robot: Robot = field(default_factory=Robot)
    motion: Motion = field(default_factory=Motion)
    trajectory: str | None = None  # file of the commanded trajectory, where there is one
    mocap: Mocap | None = None
    joint_log: JointLog | None = None
    depth: Depth | None = None
    force: Force | None = None
    limits: Limits = field(default_factory=Limits)
    twin: Any = None  # the synthetic laboratory that records this dataset; typed by pipeline/twin


@dataclass
class Model:
    kind: str = MISSING


def _require_estimator(estimator: str, among: tuple[str, ...]) -> None:
    if estimator not in among:
        raise ConfigError(f"estimator: no estimator {estimator!r}; there are {', '.join(among)}", key="models.*.estimator")


@dataclass
class Additive(Model):
    estimator: str = MISSING

    def __post_init__(self) -> None:
        _require_estimator(self.estimator, ("paper", "shrinkage"))


@dataclass
class Wishart(Model):
    estimator: str = MISSING
    decomposition: str = MISSING
    left: list[list[float]] | None = None  # rows of J₁, of the decomposition given alone
    floor: float | None = None  # of the paper's estimator alone
    ratio_factor: float = 1.0  # on α₂/α₁ of the paper's estimator, which the noise at rest settles

    def __post_init__(self) -> None:
        _require_estimator(self.estimator, ("paper", "likelihood"))
        if self.estimator == "paper" and self.floor is None:
            raise ConfigError("the paper's estimator of a Wishart model needs a floor", key="models.*.floor")
        if (self.decomposition == "given") != (self.left is not None):
            raise ConfigError("the decomposition given, and no other, needs the rows of J1 as left", key="models.*.left")
        if self.left is not None and not (len(self.left) == 3 and all(len(row) == 3 for row in self.left)):
            raise ConfigError("left must hold the three rows of J1, three values each", key="models.*.left")


@dataclass
class Gaussian(Model):
    form: str = MISSING
    estimator: str = MISSING
    beta: float | None = None  # of the paper's estimator alone

    def __post_init__(self) -> None:
        _require_estimator(self.estimator, ("paper", "likelihood"))
        if self.form not in ("inverse", "forward"):
            raise ConfigError(f"form: no form {self.form!r}; there are inverse, forward", key="models.*.form")
        if self.form == "forward" and self.estimator == "paper":
            raise ConfigError(
                "the paper's estimator compares means and variances, which a step of the forward form does not have; choose likelihood",
                key="models.*.estimator",
            )
        if self.estimator == "paper" and self.beta is None:
            raise ConfigError("the paper's estimator of a Gaussian model needs a beta", key="models.*.beta")


@dataclass
class Scaled(Model):
    structure: str = MISSING

    def __post_init__(self) -> None:
        if self.structure not in ("diagonal", "full", "timing"):
            raise ConfigError(f"structure: no structure {self.structure!r}; there are diagonal, full, timing", key="models.*.structure")


@dataclass
class Student(Model):
    pass


MODELS = {"additive": Additive, "wishart": Wishart, "gaussian": Gaussian, "scaled": Scaled, "student": Student}


@dataclass
class Filter:
    scheme: str = MISSING
    threshold: float = MISSING
    particles: int = MISSING


@dataclass
class Articulation:
    gamma1: float = MISSING
    gamma2: float = MISSING
    length_range: float = MISSING  # share of the nominal length
    minimum_points: int = MISSING  # a frame with fewer points of the arm is a gap
    max_gap: int = MISSING  # frames in a row that may be gaps
    noise_window: int = MISSING  # frames on either side that the covariance of the Kinect noise is estimated over


@dataclass
class Wrench:
    agents: list[int] = MISSING
    kappa: list[float] = MISSING  # 1, the paper's σ_θ
    tension_std: list[float] = MISSING  # N
    tension: list[float] = MISSING  # N
    direction: list[float] = MISSING  # rad
    systems: int = MISSING
    test_systems: int = MISSING
    repeats: int = MISSING
    grid: int = MISSING


@dataclass
class Simulation:
    mode: str = MISSING
    realizations: int = MISSING


@dataclass
class Recovery:
    estimators: dict[str, Any] = field(default_factory=dict)  # name → option of a model, as in models
    dispersions: list[float] = MISSING  # σ_B of data drawn from the Wishart model
    takes: int = MISSING
    stride: int = MISSING
    datasets: int = MISSING


@dataclass
class Scale:
    name: str = MISSING
    training_takes: int = MISSING
    test_takes: int = MISSING
    depth_rate: float = MISSING  # 1/s
    realizations: int = MISSING
    particles: int = MISSING
    systems: int = MISSING
    test_systems: int = MISSING
    study_repeats: int = MISSING
    convex_checks: int = MISSING
    control_takes: int = MISSING
    sensitivity_takes: int = MISSING
    fault_takes: int = MISSING
    bootstrap_replicates: int = MISSING
    recovery_takes: int = MISSING
    recovery_stride: int = MISSING
    recovery_datasets: int = MISSING
    force_seconds: float = MISSING


@dataclass
class Config:
    seed: int = MISSING
    dataset: Dataset = field(default_factory=Dataset)
    models: dict[str, Any] = field(default_factory=dict)
    filter: Filter = field(default_factory=Filter)
    articulation: Articulation = field(default_factory=Articulation)
    wrench: Wrench = field(default_factory=Wrench)
    simulation: Simulation = field(default_factory=Simulation)
    recovery: Recovery = field(default_factory=Recovery)
    scale: Scale = field(default_factory=Scale)
    compute: Compute = field(default_factory=Compute)
