"""A hexapod on one motion: the covariance of its next pose by each motion model, from the exact law
of the steps of its legs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from pipeline.core.errors import ConfigError
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.model import MotionModel, frobenius
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.randommatrix.wishart import largest_dispersion
from pipeline.studies.outlook.platform import LEGS, Hexapod, pose_of

DECOMPOSITIONS = ("qr_transposed", "qr")  # those that no order of the rows changes
SAME_POSE = 1e-6  # m


@dataclass(frozen=True)
class PlatformMotion:
    """Commanded steps ``v`` (K, 6) in m of a hexapod from poses with legs ``q`` (K, 6) in m;
    ``inverse`` (K, 6, 6) is J⁻¹ there.
    """

    robot: Hexapod
    q: np.ndarray
    v: np.ndarray
    inverse: np.ndarray

    def noise_share(self, model: MotionModel) -> float:
        """Noise of the legs over their step, each root mean square over the motion."""
        covariance = model.covariance(self.robot, self.q, self.v)
        steps = np.matvec(self.inverse, self.v)
        traces = np.trace(covariance, axis1=-2, axis2=-1)
        return float(np.sqrt(traces.mean() / np.mean(np.sum(steps**2, axis=-1))))


def straight(robot: Hexapod, start: np.ndarray, end: np.ndarray, places: int) -> PlatformMotion:
    """Return the motion from pose ``start`` (12,) to ``end`` (12,) at constant velocity and angular
    velocity, in ``places`` equal steps.

    Raises ConfigError if a leg is beyond its limits or the legs lead from home to other poses, and
    SingularJacobianError if they do not hold the platform.
    """
    way = robot.displacement(start, end)
    share = np.linspace(0, 1, places)[:, None]
    turned = pose_of(np.zeros((places, 3)), share * way[3:] / robot.length)[:, 3:]
    rotation = turned.reshape(-1, 3, 3) @ start[3:].reshape(3, 3)
    pose = np.hstack([start[:3] + share * way[:3], rotation.reshape(-1, 9)])
    q, _ = robot.legs(pose)
    if not np.all(robot.within_limits(q)):
        raise ConfigError(
            f"legs must be {robot.lower[0]:g} to {robot.upper[0]:g} m long, the motion needs "
            f"{q.min():.4g} to {q.max():.4g} m; choose other ends or legs",
            key="legs",
        )
    robot.require_regular(q, what="place")
    if np.abs(robot.displacement(pose, robot.pose(q))).max() > SAME_POSE:
        raise ConfigError("the motion passes a singular pose; choose a smaller turn", key="turn")
    return PlatformMotion(robot, q, np.broadcast_to(way / places, q.shape), robot.inverse_at(pose))


def equal_models(motion: PlatformMotion, noise: float, bound: float) -> dict[str, MotionModel]:
    """Return every model by name, its one free parameter such that the noise of the legs is
    ``noise`` times their step; ``bound`` is u over the greatest norm of J⁻¹.

    Raises ConfigError if no Wishart model has that noise.
    """
    steps = np.matvec(motion.inverse, motion.v)
    variance = noise**2 * np.mean(np.sum(steps**2, axis=-1)) / LEGS
    u = bound * frobenius(motion.inverse).max()
    models: dict[str, MotionModel] = {
        "additive": ScaledModel(variance * np.eye(LEGS)),
        "gaussian": GaussianModel(noise / motion.noise_share(GaussianModel(1.0, u)), u),
    }
    limit = largest_dispersion(LEGS, inverse_moments=2)
    for name in DECOMPOSITIONS:
        decomposition = Decomposition(name)

        def excess(sigma_b: float, decomposition: Decomposition = decomposition) -> float:
            return motion.noise_share(WishartModel(sigma_b, decomposition)) - noise

        ends = (1e-3 * limit, 0.999 * limit)
        if not excess(ends[0]) < 0 < excess(ends[1]):
            raise ConfigError(f"noise: no Wishart model has {noise:g} of the step", key="noise")
        models[name] = WishartModel(brentq(excess, *ends, xtol=1e-14), decomposition)
    return models


def platform_covariance(model: MotionModel, motion: PlatformMotion) -> np.ndarray:
    """(K, 6, 6) covariance J Cov(q_{k+1}|q_k) Jᵀ of the next pose in m², rotations times the
    length: exact in the legs, of first order in their noise.
    """
    jacobian = np.linalg.inv(motion.inverse)
    covariance = model.covariance(motion.robot, motion.q, motion.v)
    return jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)


def hexapod_rows(motion: PlatformMotion, models: dict[str, MotionModel]) -> pd.DataFrame:
    """The table ``hexapod``."""
    least = np.linalg.svd(motion.inverse, compute_uv=False)[:, -1]
    parts = []
    for name, model in models.items():
        legs = model.covariance(motion.robot, motion.q, motion.v)
        variances = np.diagonal(platform_covariance(model, motion), axis1=-2, axis2=-1)
        columns = {
            "place": np.linspace(0, 1, len(motion.q)),
            "least_singular_value": least,
            "legs": np.sqrt(np.trace(legs, axis1=-2, axis2=-1)),
            "position": np.sqrt(variances[:, :3].sum(axis=-1)),
            "rotation": np.sqrt(variances[:, 3:].sum(axis=-1)) / motion.robot.length,
        }
        parts.append(pd.DataFrame({"model": name} | columns))
    return pd.concat(parts, ignore_index=True)
