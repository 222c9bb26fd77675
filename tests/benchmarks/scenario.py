"""What the filter's contests and the growth of its cost are measured on: the youBot's arm moved
under the Wishart model, and seen by the depth camera at every third step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import Arm, load_arm
from pipeline.core.config import CONF
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Posterior, Start, particle_filter
from pipeline.models.commands import open_loop
from pipeline.models.draws import draw_steps
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel

ROOT = Path(__file__).parents[2]
DT = 0.01  # s
FRAME_EVERY = 3  # steps
SIGMA_B = 0.25
# the LU that the peers' libraries have
MODEL = WishartModel(SIGMA_B, Decomposition("pivoted_lu"))
SENSOR = np.diag([0.02, 0.03, 0.04]) ** 2  # rad²
# rad, far from the limits, the elbow bent at about a right angle
START = Start(np.array([1.1, -1.0, 1.8]), 1e-5 * np.eye(3))


@cache
def arm() -> Arm:
    """The arm of the synthetic dataset."""
    robot = OmegaConf.load(CONF / "dataset/youbot.yaml").robot
    return load_arm(ROOT / robot.urdf, list(robot.joints), robot.tool, dict(robot.locked))


def youbot() -> PlanarChain:
    """Its planar chain, the first and the last joint locked."""
    return arm().chain


@dataclass(frozen=True)
class Take:
    """A motion of ``len(steps)`` steps and what was seen of it."""

    steps: np.ndarray  # (M, 3) commanded steps in m, m, rad
    measurements: Measurements

    def filtered(self, particles: int, rng: np.random.Generator) -> Posterior:
        """Our filter's posterior."""
        options = FilterOptions(particles)
        return particle_filter(
            MODEL, youbot(), open_loop(self.steps), DT, START, self.measurements, options, rng
        )

    def unseen(self) -> Take:
        """The same motion in the dark."""
        return Take(
            self.steps,
            Measurements(
                "unseen", np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3, 3))
            ),
        )

    def told(self) -> dict:
        """The same in plain values, as arguments of peers/wishart_take.py."""
        return {
            "links": youbot().links,
            "signs": youbot().signs,
            "sigma_b": SIGMA_B,
            "steps": self.steps,
            "start_mean": START.mean,
            "start_covariance": START.covariance,
            "seen": np.round(self.measurements.t / DT).astype(int).tolist(),
            "y": self.measurements.y,
            "covariance": SENSOR,
        }


def swing(steps: int) -> np.ndarray:
    """(steps + 1, 3) poses in rad: each joint swings by a quarter of a radian on its own phase."""
    phases = np.array([0.0, 1.0, 2.0])
    return START.mean + 0.25 * (
        np.sin(0.02 * np.arange(steps + 1)[:, None] + phases) - np.sin(phases)
    )


def take(steps: int) -> Take:
    """The commanded steps are those of :func:`swing`, the measurements of a path drawn from the
    model.
    """
    rng = np.random.default_rng(2017)
    path, commanded = [START.mean], []
    for pose in swing(steps)[1:]:
        # back to the swing from wherever the last step ended, so that the arm stays within its
        # limits for any number of steps
        commanded.append(youbot().jacobian(path[-1]) @ (pose - path[-1]))
        path.append(draw_steps(MODEL, youbot(), path[-1], commanded[-1], rng)[0])
    k = np.arange(FRAME_EVERY, steps + 1, FRAME_EVERY)
    y = rng.multivariate_normal(np.zeros(3), SENSOR, len(k)) + np.array(path)[k]
    return Take(
        np.array(commanded),
        Measurements("take", k * DT, y, np.zeros_like(y), np.tile(SENSOR, (len(k), 1, 1))),
    )
