"""Scenes of the filter's contests and of the growth of its cost: an arm moved under the Wishart
model, and its joint angles measured. The youBot's planar arm is measured at every third step; a
UR5, an LWR4+ and arms of any number of joints have the whole pose of the tip as their task and are
measured after every step.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from sample_options import filter_options
from space_arms import LWR4, UR5, YOUBOT, revolute_arm

from pipeline.arm.chain import Chain, PlanarChain
from pipeline.arm.model import chain_of
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Posterior, Start, particle_filter
from pipeline.models.draws import draw_steps
from pipeline.models.model import MotionModel, open_loop
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel

DT = 0.01  # s
SIGMA_B = 0.25
# rad², covariance of a measurement by the depth camera and by encoders
DEPTH = np.diag([0.01, 0.015, 0.02]) ** 2
ENCODERS = 0.005**2
# robots, and poses in rad far from the limits and from singular poses
ROBOTS = {
    "youbot": (YOUBOT, [1.1, -1.0, 1.8]),
    "ur5": (UR5, [-0.4, -1.2, 1.5, -1.1, 0.9, 0.4]),
    "lwr4": (LWR4, [0.2, 0.8, 0.3, 1.2, 0.3, 0.9, 0.2]),
}


class Scene(NamedTuple):
    """An arm of n joints and m task rows, its law of motion and start, and its measurement."""

    chain: Chain
    model: MotionModel
    start: Start
    sensor: np.ndarray  # (n, n) rad², covariance of a measurement
    every: int  # steps from a measurement to the next


@cache
def scene(arm: str | int) -> Scene:
    """Scene of one of the robots, or of an arm of so many joints."""
    if arm in ROBOTS:
        robot, angles = ROBOTS[arm]
        chain = chain_of(robot)
        pose = np.array(angles)
    else:
        chain, pose = many_joints(arm)
    identity = np.eye(len(pose))
    start = Start(pose, 1e-5 * identity)
    if isinstance(chain, PlanarChain):
        model = WishartModel(SIGMA_B, Decomposition("pivoted_lu"))
        return Scene(chain, model, start, DEPTH, every=3)
    model = WishartModel(SIGMA_B, Decomposition("qr_transposed"))
    return Scene(chain, model, start, ENCODERS * identity, every=1)


def many_joints(n: int) -> tuple[Chain, np.ndarray]:
    """An arm of ``n`` revolute joints and at most as many rows of the tip's pose, and of many poses
    (n,) the farthest from singular ones.
    """
    arm = revolute_arm(n)
    free = np.full(n, np.inf)
    chain = replace(arm, task=arm.task[:n], lower=-free, upper=free, max_speed=free)
    rng = np.random.default_rng(n)
    poses = rng.uniform(-np.pi, np.pi, (200, n))
    values = np.linalg.svd(chain.jacobian(poses), compute_uv=False)
    least = values[:, -1]
    return chain, poses[least.argmax()]


@dataclass(frozen=True)
class Take:
    """A motion of ``len(steps)`` steps and its measurements."""

    scene: Scene
    # (M, m) commanded steps, or (M, m + n) of more joints than task rows
    steps: np.ndarray
    measurements: Measurements

    def filtered(self, particles: int, rng: np.random.Generator) -> Posterior:
        """Our filter's posterior."""
        chain, model, start, *_ = self.scene
        commands = open_loop(self.steps)
        options = filter_options(particles)
        return particle_filter(
            model,
            chain,
            commands,
            DT,
            start,
            self.measurements,
            options,
            rng,
        )

    def plain(self) -> dict:
        """The same in plain values, as arguments of the takes in peers/."""
        chain = self.scene.chain
        start = self.scene.start
        if isinstance(chain, PlanarChain):
            arm = {"links": chain.links, "signs": chain.signs}
        else:
            arm = {"placements": chain.placements}
        return arm | {
            "sigma_b": SIGMA_B,
            "steps": self.steps,
            "start_mean": start.mean,
            "start_covariance": start.covariance,
            "seen": np.round(self.measurements.t / DT).astype(int).tolist(),
            "y": self.measurements.y,
            "covariance": self.scene.sensor,
        }


def swing(steps: int, middle: np.ndarray) -> np.ndarray:
    """(steps + 1, n) poses in rad: each joint swings by a quarter of a radian on its own phase."""
    phases = np.arange(float(len(middle)))
    angles = 0.02 * np.arange(steps + 1)[:, None] + phases
    return middle + 0.25 * (np.sin(angles) - np.sin(phases))


def take(steps: int, arm: str | int = "youbot") -> Take:
    """The steps command :func:`swing`; the measurements are of a path drawn from the model."""
    chain, model, start, sensor, every = stage = scene(arm)
    rng = np.random.default_rng(2017)
    path = [start.mean]
    commanded = []
    for pose in swing(steps, start.mean)[1:]:
        # back to the swing from the end of the last step, so that the arm stays within its limits
        # for any number of steps
        dq = pose - path[-1]
        command = chain.jacobian(path[-1]) @ dq
        if len(chain.task) < len(dq):
            command = np.concatenate([command, dq])
        commanded.append(command)
        moved, _ = draw_steps(model, chain, path[-1], command, rng)
        path.append(moved)

    k = np.arange(every, steps + 1, every)
    errors = rng.multivariate_normal(np.zeros(len(sensor)), sensor, len(k))
    y = errors + np.array(path)[k]
    noise = np.tile(sensor, (len(k), 1, 1))
    measurements = Measurements("take", k * DT, y, np.zeros_like(y), noise)
    return Take(stage, np.array(commanded), measurements)


def drawn_takes(
    stage: Scene,
    count: int,
    steps: int,
    noise: float,
    rng: np.random.Generator,
    rest: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Poses (count, steps + 1, n) in rad that the scene's model draws along the swing, at rest in
    the first steps, measured with white ``noise`` in rad; and the commands (steps, m).
    """
    chain, model, start, *_ = stage
    path = swing(steps, start.mean)
    path[:rest] = path[rest]
    v = np.matvec(chain.jacobian(path[:-1]), np.diff(path, axis=0))
    q = np.tile(path[0], (count, steps + 1, 1))
    for k in range(steps):
        q[:, k + 1] = draw_steps(model, chain, q[:, k], v[k], rng)[0]
    return q + noise * rng.standard_normal(q.shape), v


def distance(means: np.ndarray, posterior: Posterior) -> float:
    """Root mean square distance of posterior ``means`` (M+1, n) from ``posterior``'s, in its
    standard deviations.
    """
    variances = np.diagonal(posterior.covariance, axis1=1, axis2=2)
    return float(np.sqrt(np.mean((means - posterior.mean) ** 2 / variances)))
