"""Scenes of the filter's contests and of the growth of its cost: an arm moved under the Wishart
model, and its joint angles measured. The youBot's planar arm is measured at every third step; a
UR5, an LWR4+ and arms of any number of joints have the whole pose of the tip as their task and are
measured after every step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf

from pipeline.arm.chain import PlanarChain
from pipeline.arm.interface import Chain
from pipeline.arm.model import chain_of, load_arm
from pipeline.arm.serial import SerialChain
from pipeline.core.columns import SPACE
from pipeline.core.config import CONF
from pipeline.core.options.dataset import Robot
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Posterior, Start, particle_filter
from pipeline.models.draws import draw_steps
from pipeline.models.model import open_loop
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel

ROOT = Path(__file__).parents[2]
DT = 0.01  # s
FRAME_EVERY = 3  # steps
SIGMA_B = 0.25
SENSOR = np.diag([0.01, 0.015, 0.02]) ** 2  # rad²
# rad, far from the limits, the elbow bent at about a right angle
START = Start(np.array([1.1, -1.0, 1.8]), 1e-5 * np.eye(3))
ENCODER = 0.005  # rad
# rad, far from the limits and from singular poses
SPATIAL = {"ur5": [-0.4, -1.2, 1.5, -1.1, 0.9, 0.4], "lwr4": [0.2, 0.8, 0.3, 1.2, 0.3, 0.9, 0.2]}


@cache
def youbot() -> PlanarChain:
    """The planar chain of the synthetic dataset."""
    robot = OmegaConf.load(CONF / "dataset/youbot.yaml").robot
    return load_arm(ROOT / robot.urdf, list(robot.joints), robot.tool, dict(robot.locked)).chain


@dataclass(frozen=True)
class Scene:
    """An arm of n joints and m task rows: how it moves, from where, and how it is measured."""

    chain: Chain
    model: WishartModel
    start: Start
    sensor: np.ndarray  # (n, n) rad², covariance of a measurement
    every: int  # steps from a measurement to the next


@cache
def scene(arm: str) -> Scene:
    """Scene of the youBot or of one of :data:`SPATIAL`."""
    if arm == "youbot":
        model = WishartModel(SIGMA_B, Decomposition("pivoted_lu"))
        return Scene(youbot(), model, START, SENSOR, FRAME_EVERY)
    return in_space(chain_of(robot(arm)), np.array(SPATIAL[arm]))


def robot(arm: str) -> Robot:
    """The options of an arm of :data:`SPATIAL`, its URDF by its whole path."""
    options = Robot(**OmegaConf.load(CONF / f"dataset/{arm}.yaml").robot)
    return replace(options, urdf=str(ROOT / options.urdf))


def in_space(chain: Chain, pose: np.ndarray) -> Scene:
    """Scene of a ``chain`` from ``pose`` (n,) on."""
    one = np.eye(len(pose))
    model = WishartModel(SIGMA_B, Decomposition("qr_transposed"))
    return Scene(chain, model, Start(pose, 1e-5 * one), ENCODER**2 * one, 1)


def many_joints(n: int) -> Scene:
    """Scene of an arm of ``n`` revolute joints, each turned and 0.2 m from the one before, with
    as many rows of the tip's pose as it can hold, from far of singular poses on.
    """
    rng = np.random.default_rng(n)
    turns, ways = rng.standard_normal((n + 1, 3, 3)), rng.standard_normal((n + 1, 3))
    ways *= 0.2 / np.linalg.norm(ways, axis=1, keepdims=True)
    axes = [np.linalg.qr(turn)[0] for turn in turns]
    axes = [turn * np.sign(np.linalg.det(turn)) for turn in axes]
    placements = np.hstack([np.reshape(axes, (n + 1, 9)), ways])
    limit, sliding = np.full(n, np.inf), np.zeros(n, dtype=bool)
    chain = SerialChain(tuple(SPACE[:n]), 0.2, placements, sliding, -limit, limit, limit)
    poses = rng.uniform(-np.pi, np.pi, (200, n))
    farthest = np.linalg.svd(chain.jacobian(poses), compute_uv=False)[:, -1].argmax()
    return in_space(chain, poses[farthest])


@dataclass(frozen=True)
class Take:
    """A motion of ``len(steps)`` steps and what was measured of it."""

    scene: Scene
    steps: np.ndarray  # (M, m) commanded steps, or (M, m + n) of more joints than task rows
    measurements: Measurements

    def filtered(self, particles: int, rng: np.random.Generator) -> Posterior:
        """Our filter's posterior."""
        model, chain, start = self.scene.model, self.scene.chain, self.scene.start
        commands, options = open_loop(self.steps), FilterOptions(particles)
        return particle_filter(model, chain, commands, DT, start, self.measurements, options, rng)

    def unseen(self) -> Take:
        """The same motion without measurements."""
        n = len(self.scene.start.mean)
        none = np.empty((0, n)), np.empty((0, n)), np.empty((0, n, n))
        return replace(self, measurements=Measurements("unseen", np.empty(0), *none))

    def told(self) -> dict:
        """The same in plain values, as arguments of the takes in peers/."""
        chain, start = self.scene.chain, self.scene.start
        names = ("links", "signs") if isinstance(chain, PlanarChain) else ("placements",)
        return {name: getattr(chain, name) for name in names} | {
            "sigma_b": SIGMA_B,
            "steps": self.steps,
            "start_mean": start.mean,
            "start_covariance": start.covariance,
            "seen": np.round(self.measurements.t / DT).astype(int).tolist(),
            "y": self.measurements.y,
            "covariance": self.scene.sensor,
        }


def swing(steps: int, middle: np.ndarray = START.mean) -> np.ndarray:
    """(steps + 1, n) poses in rad: each joint swings by a quarter of a radian on its own phase."""
    phases = np.arange(float(len(middle)))
    return middle + 0.25 * (np.sin(0.02 * np.arange(steps + 1)[:, None] + phases) - np.sin(phases))


def take(steps: int, arm: Scene | str = "youbot") -> Take:
    """The commanded steps are those of :func:`swing`, the measurements of a path drawn from the
    model.
    """
    stage = scene(arm) if isinstance(arm, str) else arm
    chain, start = stage.chain, stage.start.mean
    rng = np.random.default_rng(2017)
    path, commanded = [start], []
    for pose in swing(steps, start)[1:]:
        # back to the swing from wherever the last step ended, so that the arm stays within its
        # limits for any number of steps
        dq = pose - path[-1]
        spare = [] if len(chain.task) == len(dq) else dq
        commanded.append(np.concatenate([chain.jacobian(path[-1]) @ dq, spare]))
        path.append(draw_steps(stage.model, chain, path[-1], commanded[-1], rng)[0])
    k = np.arange(stage.every, steps + 1, stage.every)
    y = rng.multivariate_normal(np.zeros(len(start)), stage.sensor, len(k)) + np.array(path)[k]
    covariance = np.tile(stage.sensor, (len(k), 1, 1))
    return Take(
        stage, np.array(commanded), Measurements("take", k * DT, y, np.zeros_like(y), covariance)
    )


def apart(means: np.ndarray, posterior: Posterior) -> float:
    """Root mean square distance of posterior ``means`` (M+1, n) from ``posterior``'s, in its
    standard deviations.
    """
    variances = np.diagonal(posterior.covariance, axis1=1, axis2=2)
    return float(np.sqrt(np.mean((means - posterior.mean) ** 2 / variances)))
