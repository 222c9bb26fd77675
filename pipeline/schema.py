"""The types of the configuration: what may stand in params.yaml and pipeline/conf, section by section.

Values, units and reasons stand in the option files; a key that is not here is refused. A dataset may lack any instrument: its
section is then null.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from omegaconf import MISSING

from pipeline.errors import ConfigError


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
class Mocap:
    training: str = MISSING  # glob of the training takes' files
    test: str | None = None
    base: Pose = field(default_factory=Pose)  # the arm's base in the motion-capture world
    markers: dict[str, dict[str, list[float]]] = MISSING  # link → marker name → position in the segment's frame, m
    gate: float = MISSING  # m, how far a marker may be from where it is predicted to be taken for it
    max_gap: int = MISSING  # frames, longest gap that is interpolated


@dataclass
class JointLog:
    """The controller's own logs: a folder a movement, and which of the commanded motions in them is analysed."""

    movements: str = MISSING  # glob of the movements' folders
    actual: str = MISSING  # file of measured angles in each
    target: str = MISSING  # file of commanded angles
    speed: str = MISSING  # file of commanded speeds
    joints: int = MISSING  # joints a row holds
    columns: list[int] = MISSING  # columns (from 1; 0 is time) of the chain's joints
    start: list[float] = MISSING  # rad, commanded angles of the chain at rest before the motion
    end: list[float] = MISSING  # rad, and after it
    rest: int = MISSING  # steps at rest kept on either side, of dataset.motion.steps
    tolerance: float = MISSING  # rad, how exactly commands must repeat

    def __post_init__(self) -> None:
        if any(len(values) != 3 for values in (self.columns, self.start, self.end)):
            raise ConfigError("columns, start and end must each hold three values, one a joint of the chain", key="dataset.joint_log")
        if not all(1 <= column <= self.joints for column in self.columns) or self.rest < 1:
            raise ConfigError(f"columns must lie between 1 and {self.joints}, and rest be at least 1", key="dataset.joint_log")


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
    takes: str = MISSING  # glob of the takes' folders
    index: str = MISSING  # index file in each
    intrinsics: str = MISSING  # file, from the recordings' folder
    width: int = MISSING  # px
    height: int = MISSING  # px
    units_per_metre: float = MISSING
    rate: float = MISSING  # 1/s
    camera: Pose = field(default_factory=Pose)  # camera (x right, y down, z forward) in the arm's base frame
    workspace: Workspace = field(default_factory=Workspace)
    search: float = MISSING  # s, the clocks' offset is looked for between -search and +search


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
    floor: float | None = None  # of the paper's estimator alone

    def __post_init__(self) -> None:
        _require_estimator(self.estimator, ("paper", "likelihood"))
        if self.estimator == "paper" and self.floor is None:
            raise ConfigError("the paper's estimator of a Wishart model needs a floor", key="models.*.floor")


@dataclass
class Gaussian(Model):
    estimator: str = MISSING
    beta: float | None = None  # of the paper's estimator alone

    def __post_init__(self) -> None:
        _require_estimator(self.estimator, ("paper", "likelihood"))
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
    force_seconds: float = MISSING


@dataclass
class Compute:
    workers: int = MISSING


@dataclass
class Config:
    seed: int = MISSING
    dataset: Dataset = field(default_factory=Dataset)
    models: dict[str, Any] = field(default_factory=dict)
    filter: Filter = field(default_factory=Filter)
    articulation: Articulation = field(default_factory=Articulation)
    wrench: Wrench = field(default_factory=Wrench)
    simulation: Simulation = field(default_factory=Simulation)
    scale: Scale = field(default_factory=Scale)
    compute: Compute = field(default_factory=Compute)
