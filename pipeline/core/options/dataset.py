"""Options of a dataset: a robot, its motion, and the instruments that saw it; null for none."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from omegaconf import MISSING

from pipeline.core.options.depth_camera import Depth
from pipeline.core.options.force import Force
from pipeline.core.options.limits import Limits
from pipeline.core.options.logs import JointLog
from pipeline.core.options.motion_capture import Mocap


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
class Elimination:
    """In which order LU without pivoting eliminates the Jacobian, where the natural one meets a
    small pivot on this motion: names of the task rows, and of the joints.
    """

    rows: list[str] | None = None  # of x, z, phi
    order: list[str] | None = None  # of robot.joints


@dataclass
class Dataset:
    name: str = MISSING
    recordings: str = MISSING  # folder of the raw files, from the project's root
    robot: Robot = field(default_factory=Robot)
    motion: Motion = field(default_factory=Motion)
    elimination: Elimination = field(default_factory=Elimination)
    trajectory: str | None = None  # file of the commanded trajectory, where there is one
    mocap: Mocap | None = None
    joint_log: JointLog | None = None
    depth: Depth | None = None
    force: Force | None = None
    limits: Limits = field(default_factory=Limits)
    # the synthetic laboratory that records this dataset; typed by pipeline/laboratory
    laboratory: Any = None
