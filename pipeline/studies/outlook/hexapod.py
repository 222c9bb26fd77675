"""A hexapod (Gough 1962, Stewart 1965), a platform on six legs whose lengths are its joints, on one
motion: the covariance of its next pose by each motion model, from the exact law of the legs' steps.

From the pose the legs and J⁻¹ follow in closed form; where J⁻¹ is singular the legs do not hold the
platform (Gosselin and Angeles 1990). A pose (12,) has the platform's frame in the base's:
position (3, m) and rotation (9, row by row). The task's rows are its velocity and its angular
velocity in the base's axes, the latter times a characteristic length.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.arm.interface import Mechanism
from pipeline.core.columns import SPACE
from pipeline.core.errors import ConfigError, ModelDomainError
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.model import MotionModel, frobenius
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.studies.frame import joined

LEGS = 6
DECOMPOSITIONS = ("qr_transposed", "qr")  # those that no order of the rows changes
# Least singular value of J⁻¹ that is trusted, over its greatest possible entry: beyond it a leg
# that is off by a thousandth of the robot's size moves the platform by all of it.
LEAST_SINGULAR = 1e-3


@dataclass(frozen=True)
class Hexapod:
    """Joints of the legs on base and platform (6, 3) in m, each in its own frame, and the length in
    m by which angular rows are multiplied.
    """

    base: np.ndarray
    platform: np.ndarray
    length: float

    def legs(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the lengths (..., 6) of the legs in m and J⁻¹ (..., 6, 6) at the poses ``pose``
        (..., 12): row i is nᵢᵀ, (bᵢ × nᵢ)ᵀ over the length, nᵢ the unit vector from base to
        platform along leg i and bᵢ its joint on the platform from the platform's origin.
        """
        rotation = pose[..., 3:].reshape(*pose.shape[:-1], 3, 3)
        arms = np.einsum("...ij,kj->...ki", rotation, self.platform)
        legs = pose[..., None, :3] + arms - self.base
        lengths = np.linalg.norm(legs, axis=-1)
        n = legs / lengths[..., None]
        return lengths, np.concatenate([n, np.cross(arms, n) / self.length], axis=-1)


@dataclass(frozen=True)
class PlatformMotion(Mechanism):
    """Commanded steps ``v`` (K, 6) in m of a hexapod from K poses with legs ``q`` (K, 6) in m;
    ``inverse`` (K, 6, 6) is J⁻¹ there. As a mechanism it has these poses alone.
    """

    task: ClassVar[tuple[str, ...]] = SPACE
    robot: Hexapod
    q: np.ndarray
    v: np.ndarray
    inverse: np.ndarray

    def singular(self, q: np.ndarray) -> np.ndarray:
        """(K,) none: :func:`straight` refuses a motion to a singular pose."""
        return np.zeros(np.shape(q)[:-1], dtype=bool)

    def inverse_jacobian(self, q: np.ndarray, *, what: str = "pose") -> np.ndarray:
        """(K, 6, 6) J⁻¹ at the poses of the motion, whose legs ``q`` must be."""
        assert np.array_equal(q, self.q)
        return self.inverse

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(K, 6, 6) J at the poses of the motion."""
        return np.linalg.inv(self.inverse_jacobian(q))

    def covariances(self, model: MotionModel) -> tuple[np.ndarray, np.ndarray]:
        """Return the (K, 6, 6) covariances of the legs after one step and of the next pose in m²,
        J Cov(q_{k+1}|q_k) Jᵀ, rotations times the length: of first order in the legs' noise.
        """
        legs, jacobian = model.covariance(self, self.q, self.v), self.jacobian(self.q)
        return legs, jacobian @ legs @ np.swapaxes(jacobian, -1, -2)


def pose_of(position: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return the pose (12,) at ``position`` (3,) in m, turned by the rotation vector ``turn`` (3,)
    in rad.
    """
    return np.concatenate([position, Rotation.from_rotvec(turn).as_matrix().ravel()])


def straight(
    robot: Hexapod, start: np.ndarray, end: np.ndarray, limits: tuple[float, float], places: int
) -> PlatformMotion:
    """Return the motion from pose ``start`` (12,) to ``end`` (12,) at constant velocity and angular
    velocity, in ``places`` equal steps; ``limits`` in m are those of the legs.

    Raises ConfigError if a leg is beyond its limits, or if the legs do not hold the platform at a
    pose or in between.
    """
    before, after = (Rotation.from_matrix(pose[3:].reshape(3, 3)) for pose in (start, end))
    shift, turn = end[:3] - start[:3], (after * before.inv()).as_rotvec()
    share = np.linspace(0, 1, places)[:, None]
    turned = (Rotation.from_rotvec(share * turn) * before).as_matrix().reshape(-1, 9)
    q, inverse = robot.legs(np.hstack([start[:3] + share * shift, turned]))
    if q.min() < limits[0] or q.max() > limits[1]:
        message = f"legs must be {limits[0]:g} to {limits[1]:g} m long, the motion needs "
        message += f"{q.min():.4g} to {q.max():.4g} m; choose other ends or legs"
        raise ConfigError(message, key="legs")
    radius = np.linalg.norm(robot.platform, axis=1).max()
    least = np.linalg.svd(inverse, compute_uv=False)[:, -1].min()
    signs = np.sign(np.linalg.det(inverse))
    if least < LEAST_SINGULAR * max(1.0, radius / robot.length) or np.ptp(signs):
        message = "the motion comes to a pose at which the legs do not hold the platform; choose a "
        message += "smaller turn, or joints of base and platform that are not similar figures"
        raise ConfigError(message, key="turn")
    way = np.concatenate([shift, robot.length * turn])
    return PlatformMotion(robot, q, np.broadcast_to(way / places, q.shape), inverse)


def equal_models(motion: PlatformMotion, noise: float, bound: float) -> dict[str, MotionModel]:
    """Return every model by name, its one free parameter such that the noise of the legs is
    ``noise`` times their step, each root mean square over the motion; ``bound`` is u over the
    greatest norm of J⁻¹. Raises ConfigError if no Wishart model has that noise.
    """
    steps = np.matvec(motion.inverse, motion.v)
    trace = noise**2 * float(np.mean(np.vecdot(steps, steps)))
    models: dict[str, MotionModel] = {
        "additive": ScaledModel(trace / LEGS * np.eye(LEGS)),
        "gaussian": GaussianModel(1.0, bound * frobenius(motion.inverse).max()),
    } | {name: WishartModel(0.1, Decomposition(name)) for name in DECOMPOSITIONS}
    try:
        place = (motion, motion.q, motion.v, trace)
        return {name: model.with_trace(*place) for name, model in models.items()}
    except ModelDomainError as error:
        raise ConfigError(f"no Wishart model has {noise:g} of the step", key="noise") from error


def hexapod_rows(motion: PlatformMotion, models: dict[str, MotionModel]) -> pd.DataFrame:
    """Return the table ``hexapod``."""
    parts = []
    for name, model in models.items():
        legs, pose = motion.covariances(model)
        variances = np.diagonal(pose, axis1=-2, axis2=-1)
        columns = {
            "place": np.linspace(0, 1, len(motion.q)),
            "least_singular_value": np.linalg.svd(motion.inverse, compute_uv=False)[:, -1],
            "legs": np.sqrt(np.trace(legs, axis1=-2, axis2=-1)),
            "position": np.sqrt(variances[:, :3].sum(axis=-1)),
            "rotation": np.sqrt(variances[:, 3:].sum(axis=-1)) / motion.robot.length,
        }
        parts.append(pd.DataFrame({"model": name} | columns))
    return joined(parts)
