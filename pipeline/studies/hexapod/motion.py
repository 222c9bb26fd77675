"""The platform on one motion: what each model says of its next pose, by the exact laws of the steps
of the legs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from pipeline.arm.hexapod import LEGS, Hexapod, pose_of
from pipeline.core.errors import ConfigError
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.model import MotionModel
from pipeline.models.norm import frobenius
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.randommatrix.wishart import largest_dispersion
from pipeline.studies.hexapod.options import Options, Pose

WISHART = ("qr_transposed", "qr")  # readings of the decomposition that no order of rows changes
MODELS = ("additive", "gaussian", *WISHART)
DENSITY_POINTS = 241
SAME_POSE = 1e-6  # m


@dataclass(frozen=True)
class Motion:
    """Commanded steps ``v`` (K, 6), m, from the poses ``pose`` (K, 12) of a hexapod, whose legs are
    there ``q`` (K, 6) long, m.
    """

    robot: Hexapod
    pose: np.ndarray
    q: np.ndarray
    v: np.ndarray

    def steps(self) -> np.ndarray:
        """(K, 6) commanded steps of the legs, J⁻¹v in m."""
        return np.matvec(self.robot.inverse_at(self.pose), self.v)


def straight(robot: Hexapod, start: Pose, end: Pose, places: int) -> Motion:
    """The way from ``start`` to ``end`` at constant velocity and angular velocity, in as many equal
    steps as poses ``places`` along it.

    Raises ConfigError where a leg would have to be shorter or longer than it can be, or where the
    legs lead from home to other poses, and SingularJacobianError where they do not hold the
    platform.
    """
    begun = start.vector()
    twist = robot.displacement(begun, end.vector()) / np.repeat([1, robot.length], 3)
    share = np.linspace(0, 1, places)[:, None]
    turned = pose_of(np.zeros((places, 3)), share * twist[3:])[:, 3:].reshape(-1, 3, 3)
    rotation = turned @ begun[3:].reshape(3, 3)
    pose = np.hstack([begun[:3] + share * twist[:3], rotation.reshape(-1, 9)])
    q, _ = robot.legs(pose)
    if not np.all(robot.within_limits(q)):
        place = int(np.argmin(robot.within_limits(q)))
        raise ConfigError(
            f"the motion needs legs of {q[place].min():.4g} to {q[place].max():.4g} m, beyond "
            "their limits; choose other ends or legs",
            key="legs",
            place=place,
        )
    robot.require_regular(q, what="place")
    if np.abs(robot.displacement(pose, robot.pose(q))).max() > SAME_POSE:
        raise ConfigError(
            "the motion passes a singular pose: from home its legs lead to other poses; choose "
            "ends on this side of it, or another home",
            key="end",
        )
    v = robot.displacement(begun, end.vector()) / places
    return Motion(robot, pose, q, np.broadcast_to(v, (places, 6)))


def leg_spread(model: MotionModel, motion: Motion) -> float:
    """Noise of the legs over their step, each root mean square over the motion."""
    covariance = model.covariance(motion.robot, motion.q, motion.v)
    traces = np.trace(covariance, axis1=-2, axis2=-1)
    return float(np.sqrt(traces.mean() / np.mean(np.sum(motion.steps() ** 2, axis=-1))))


def models_of(motion: Motion, options: Options) -> dict[str, MotionModel]:
    """Every model by its name, its one free parameter such that its :func:`leg_spread` is the
    option ``noise``; raises ConfigError where a Wishart model cannot be so wide.
    """
    share = options.noise
    bound = options.bound * frobenius(motion.robot.inverse_at(motion.pose)).max()
    variance = np.mean(np.sum(motion.steps() ** 2, axis=-1)) / LEGS
    unit = leg_spread(GaussianModel(1.0, bound), motion)
    models = {
        "additive": AdditiveModel(share**2 * variance * np.eye(LEGS)),
        "gaussian": GaussianModel(share / unit, bound),
    }
    for reading in WISHART:
        models[reading] = _wishart(motion, Decomposition(reading), share)
    return models


def _wishart(motion: Motion, reading: Decomposition, share: float) -> WishartModel:
    """The model of the σ_B that gives ``share``; the spread grows with σ_B."""
    limit = largest_dispersion(LEGS, inverse_moments=2)

    def excess(sigma_b: float) -> float:
        return leg_spread(WishartModel(sigma_b, reading), motion) - share

    ends = (1e-3 * limit, 0.999 * limit)
    if not excess(ends[0]) < 0 < excess(ends[1]):
        raise ConfigError("noise: no Wishart model has this share of the step", key="noise")
    return WishartModel(brentq(excess, *ends, xtol=1e-14), reading)


def platform_covariance(model: MotionModel, motion: Motion) -> np.ndarray:
    """(K, 6, 6) covariance of the next pose in m², rotations times the characteristic length:
    J·Cov(q_{k+1}|q_k)·Jᵀ, of the exact covariance of the legs to first order in their noise.
    """
    jacobian = motion.robot.jacobian(motion.q)
    covariance = model.covariance(motion.robot, motion.q, motion.v)
    return jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)


def motion_rows(models: dict[str, MotionModel], motion: Motion) -> pd.DataFrame:
    """The table ``hexapod_motion``: a row for each model and place."""
    inverse = motion.robot.inverse_at(motion.pose)
    place = np.linspace(0, 1, len(motion.q))
    tables = []
    for name, model in models.items():
        variances = np.diagonal(platform_covariance(model, motion), axis1=-2, axis2=-1)
        legs = np.diagonal(model.covariance(motion.robot, motion.q, motion.v), axis1=-2, axis2=-1)
        tables.append(
            pd.DataFrame(
                {
                    "model": name,
                    "place": place,
                    "least_singular_value": np.linalg.svd(inverse, compute_uv=False)[:, -1],
                    "legs": np.sqrt(legs.sum(axis=-1)),
                    "position": np.sqrt(variances[:, :3].sum(axis=-1)),
                    "rotation": np.sqrt(variances[:, 3:].sum(axis=-1)) / motion.robot.length,
                }
            )
        )
    return pd.concat(tables, ignore_index=True)


def density_rows(
    models: dict[str, MotionModel], motion: Motion, shares: Sequence[float]
) -> pd.DataFrame:
    """The table ``hexapod_density``: the exact density of steps of the legs along the commanded
    one, at the last place.
    """
    share = np.linspace(*shares, DENSITY_POINTS)
    q, v = motion.q[-1], motion.v[-1]
    reached = q + share[:, None] * motion.steps()[-1]

    def relative(density: Callable) -> np.ndarray:
        logarithm = density(motion.robot, q[None], v, reached)
        return np.exp(logarithm - logarithm.max())

    return pd.concat(
        [
            pd.DataFrame({"model": name, "share": share, "density": relative(model.log_density)})
            for name, model in models.items()
        ],
        ignore_index=True,
    )
