"""Options of a dataset: a robot, its motion, and the instruments that saw it; null for none."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from omegaconf import MISSING

from pipeline.core.errors import ConfigError
from pipeline.core.options.depth_camera import Depth
from pipeline.core.options.force import Force
from pipeline.core.options.limits import Limits
from pipeline.core.options.logs import Encoders, JointLog
from pipeline.core.options.motion_capture import Mocap
from pipeline.core.options.reading import Reading
from pipeline.core.task import PLANE, SPACE

MEASUREMENTS = ("depth", "encoders", "tip")


@dataclass
class Robot:
    urdf: str = MISSING  # path from the project's root
    joints: list[str] = MISSING  # the moving joints, base to tip, as the URDF names them
    tool: str | None = None  # URDF frame of the tip; null: the only last link beyond the joints
    base: str | None = None  # URDF link whose axes the task has; null: the root
    # rad, m of prismatic joints: joints held still; 0 where not named
    locked: dict[str, float] = field(default_factory=dict)
    plane: bool = False  # whether the task is of the plane of parallel joints, not of space
    # any rows of x, z, phi in a plane, else of x, y, z, rx, ry, rz; null: all of them
    task: list[str] | None = None
    length: float = 1.0  # m by which radians of the task are multiplied, so that it has one unit

    def __post_init__(self) -> None:
        rows = PLANE if self.plane else SPACE
        task = list(rows if self.task is None else self.task)
        if not task or len({*task}) < len(task) or not {*task} <= {*rows}:
            raise ConfigError(
                f"task: {task} must name rows of {', '.join(rows)}, each once",
                key="dataset.robot.task",
            )
        if not 0 < self.length < float("inf"):
            raise ConfigError(
                f"length: {self.length} must be a positive number of metres",
                key="dataset.robot.length",
            )
        if self.joints == MISSING:
            return
        if not self.joints or len({*self.joints}) < len(self.joints):
            raise ConfigError(
                "joints: name at least one joint, each once", key="dataset.robot.joints"
            )
        if len(task) > len(self.joints):
            raise ConfigError(
                f"task: {len(task)} rows are more than {len(self.joints)} joints can move; leave "
                "rows out",
                key="dataset.robot.task",
            )


@dataclass
class Motion:
    rate: float = MISSING  # 1/s, steps of the motion grid
    steps: int = MISSING  # M, steps of a take
    # rad, standard deviation of a measured joint angle, of a motion that never rests; null: as the
    # steps at rest show it
    pose_noise: float | None = None

    def __post_init__(self) -> None:
        if self.pose_noise is not None and not 0 < self.pose_noise < float("inf"):
            raise ConfigError(
                f"pose_noise: {self.pose_noise} must be a positive number of rad",
                key="dataset.motion.pose_noise",
            )


@dataclass
class Dataset:
    name: str = MISSING
    recordings: str = MISSING  # folder of the raw files, from the project's root
    robot: Robot | None = field(default_factory=Robot)  # null where forces alone were recorded
    motion: Motion | None = field(default_factory=Motion)  # likewise
    trajectory: str | None = None  # file of the commanded trajectory, where there is one
    mocap: Mocap | None = None
    joint_log: JointLog | None = None
    encoders: Encoders | None = None
    depth: Depth | None = None
    force: Force | None = None
    # what the filter weighs particles by: depth (joint angles from the depth camera), encoders, or
    # tip (the pose of the tool, which the motion capture follows)
    measurement: str = "depth"
    limits: Limits = field(default_factory=Limits)
    reading: Reading = field(default_factory=Reading)
    # the synthetic laboratory that records this dataset; typed by pipeline/laboratory
    laboratory: Any = None

    def __post_init__(self) -> None:
        if self.measurement not in MEASUREMENTS:
            raise ConfigError(
                f"measurement: no {self.measurement!r}; there are {', '.join(MEASUREMENTS)}",
                key="dataset.measurement",
            )
        if self.robot is None or self.motion is None:
            self._require_forces_alone()
            return
        task = self.robot.task
        if self.depth is not None and task is not None and not {"x", "z"} <= {*task}:
            raise ConfigError(
                "task: the depth camera follows the tip by commanded x and z; keep both rows",
                key="dataset.robot.task",
            )
        if self.joint_log is None:
            return
        arm, log = self.robot.joints, self.joint_log
        if absent := [name for name in arm if name not in log.joints]:
            raise ConfigError(
                f"{', '.join(absent)} of robot.joints is not logged; the log holds "
                f"{', '.join(log.joints)}",
                key="dataset.joint_log.joints",
            )
        if len(log.start) != len(arm):
            raise ConfigError(
                f"start and end hold {len(log.start)} values where robot.joints are {len(arm)}",
                key="dataset.joint_log.start",
            )

    def _require_forces_alone(self) -> None:
        parts = ("robot", "motion", "trajectory", "mocap", "joint_log", "encoders", "depth")
        if there := [name for name in parts if getattr(self, name) is not None]:
            raise ConfigError(
                f"without a robot or its motion there is nothing to see of {', '.join(there)}",
                key=f"dataset.{there[0]}",
            )
        if self.force is None:
            raise ConfigError("a dataset has a robot or a force transducer", key="dataset.robot")
