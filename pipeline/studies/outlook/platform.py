"""Kinematics of the hexapod (Gough 1962, Stewart 1965): a platform on six legs whose lengths are
its joints.

From the pose the legs and J⁻¹ follow in closed form; from the legs the pose follows by Newton's
method. Where J⁻¹ is singular the legs do not hold the platform (Gosselin and Angeles 1990).

A pose is that of the platform's frame in the base's: position (3, m) and rotation (9, row by row),
as of a serial chain. The task's rows are its velocity and its angular velocity in the base's axes,
the latter times a characteristic length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.arm.interface import Mechanism
from pipeline.core.columns import SPACE
from pipeline.core.errors import ConfigError, SolverError

LEGS = 6
# The least singular value of J⁻¹ at a pose that is trusted, as a share of the greatest entry that
# J⁻¹ can have: beyond it a leg that is off by a thousandth of the robot's size moves the platform
# by all of it.
LEAST_SINGULAR = 1e-3
ROUNDS = 100  # of Newton's method at most; near a singular pose it halves the error in each
TOLERANCE = 1e-12  # of a leg's length, as a share of the longest leg at home
# that a round turns the platform at most, rad, or moves it, as a share of the longest leg at home:
# the way from the start cannot leap into another assembly of the same legs
LONGEST_STEP = 0.2


@dataclass(frozen=True)
class Hexapod(Mechanism):
    """The geometry of a hexapod.

    Raises ConfigError where its legs do not hold the platform at home.
    """

    defect: ClassVar[str] = "the legs do not hold the platform at {where}, where J⁻¹ is singular"
    task: ClassVar[tuple[str, ...]] = SPACE
    base: np.ndarray  # (6, 3) joints of the legs on the base, in its frame, m
    platform: np.ndarray  # (6, 3) those on the platform, in its frame, m
    home: np.ndarray  # (12,) pose from which Newton's method sets out
    lower: np.ndarray  # (6,) shortest legs, m
    upper: np.ndarray  # (6,) longest legs, m
    max_speed: np.ndarray  # (6,) m/s
    length: float  # m by which angular rows are multiplied

    def __post_init__(self) -> None:
        if self._least(self.home) < self._trusted():
            raise ConfigError(
                "the hexapod's legs do not hold its platform at home; choose another home, or "
                "joints of base and platform that are not similar figures"
            )

    def arms(self, pose: np.ndarray) -> np.ndarray:
        """(..., 6, 3) bᵢ, from the platform's origin to its joints in the base's axes, m, at the
        poses ``pose`` (..., 12).
        """
        rotation = pose[..., 3:].reshape(*pose.shape[:-1], 3, 3)
        return np.einsum("...ij,kj->...ki", rotation, self.platform)

    def legs(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lengths (..., 6) in m and unit vectors nᵢ (..., 6, 3) from base to platform of the legs
        at the poses ``pose`` (..., 12): the inverse kinematics.
        """
        legs = pose[..., None, :3] + self.arms(pose) - self.base
        lengths = np.linalg.norm(legs, axis=-1)
        return lengths, legs / lengths[..., None]

    def inverse_at(self, pose: np.ndarray) -> np.ndarray:
        """(..., 6, 6) J⁻¹ at the poses ``pose`` (..., 12): row i is nᵢᵀ, (bᵢ × nᵢ)ᵀ over the
        length. Its transpose maps the thrusts of the legs to the wrench on the platform.
        """
        _, n = self.legs(pose)
        return np.concatenate([n, np.cross(self.arms(pose), n) / self.length], axis=-1)

    def pose(self, q: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
        """(..., 12) pose of the platform on legs of lengths ``q`` (..., 6) in m, by Newton's method
        from ``start`` (..., 12), home where there is none.

        The same legs hold other poses too: this is the one that Newton's short steps meet. Raises
        SolverError, naming the first, where the legs reach no pose.
        """
        q = np.asarray(q, dtype=float)
        begun = self.home if start is None else start
        poses = np.broadcast_to(begun, (*q.shape[:-1], 12)).reshape(-1, 12).copy()
        legs, left = q.reshape(-1, LEGS), np.arange(len(poses))
        size = self.legs(self.home)[0].max()
        # a step in m, rad: what a round may do to each
        reach = LONGEST_STEP * np.repeat([size, 1.0], 3)
        turn = np.repeat([1.0, 1 / self.length], 3)
        for _ in range(ROUNDS):
            missing = legs[left] - self.legs(poses[left])[0]
            # a pose that has arrived stays: none hangs on what others it is computed with
            off = ~(np.abs(missing).max(axis=-1) <= TOLERANCE * size)
            left, missing = left[off], missing[off]
            if len(left) == 0:
                break
            step = turn * np.matvec(np.linalg.pinv(self.inverse_at(poses[left])), missing)
            step /= np.maximum(np.abs(step / reach).max(axis=-1), 1.0)[:, None]
            poses[left] = _moved(poses[left], step)
        if len(left):
            index = tuple(int(i) for i in np.unravel_index(left[0], q.shape[:-1]))
            raise SolverError(
                f"the legs reach no pose at {len(left)} place(s): Newton's method did not arrive "
                f"in {ROUNDS} rounds; command lengths nearer to those of its start",
                index=index,
                q=legs[left[0]].round(4).tolist(),
                last_pose=poses[left[0]].round(4).tolist(),
                furthest_leg_m=float(f"{np.abs(missing[0]).max():.3g}"),
            )
        return poses.reshape(*q.shape[:-1], 12)

    def displacement(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(..., 6) from the poses ``start`` (..., 12) to ``end`` (..., 12): the way between their
        positions, and the rotation vector of R_end·R_startᵀ times the length.
        """
        start, end = np.broadcast_arrays(np.asarray(start, float), np.asarray(end, float))
        before, after = (_rotations(pose) for pose in (start, end))
        turn = (after * before.inv()).as_rotvec().reshape(*start.shape[:-1], 3)
        return np.concatenate([end[..., :3] - start[..., :3], self.length * turn], axis=-1)

    def singular(self, q: np.ndarray) -> np.ndarray:
        """(...,) whether the least singular value of J⁻¹ is below :data:`LEAST_SINGULAR` of its
        scale, or ``q`` is not finite; raises what :meth:`pose` does.
        """
        finite = np.isfinite(q).all(axis=-1)
        legs = np.where(finite[..., None], q, self.legs(self.home)[0])
        return ~finite | (self.least_singular_value(legs) < self._trusted())

    def least_singular_value(self, q: np.ndarray) -> np.ndarray:
        """(...,) of J⁻¹; raises what :meth:`pose` does."""
        return self._least(self.pose(q))

    def inverse_jacobian(self, q: np.ndarray, *, what: str = "pose") -> np.ndarray:
        """(..., 6, 6) J⁻¹ in closed form at the pose that the legs ``q`` (..., 6) in m hold; raises
        what :meth:`require_regular` does.
        """
        self.require_regular(q, what=what)
        return self.inverse_at(self.pose(q))

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(..., 6, 6) J(q): the platform's velocity, angular rows times the length, for those of
        the legs ``q`` (..., 6) in m; raises what :meth:`require_regular` does.
        """
        return np.linalg.inv(self.inverse_jacobian(q))

    def _least(self, pose: np.ndarray) -> np.ndarray:
        return np.linalg.svd(self.inverse_at(pose), compute_uv=False)[..., -1]

    def _trusted(self) -> float:
        return LEAST_SINGULAR * max(1.0, np.linalg.norm(self.platform, axis=1).max() / self.length)


def pose_of(position: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(..., 12) pose at ``position`` (..., 3) in m, turned by the rotation vector ``turn`` (..., 3)
    in rad.
    """
    rotation = Rotation.from_rotvec(np.reshape(turn, (-1, 3))).as_matrix()
    return np.concatenate([position, rotation.reshape(*np.shape(turn)[:-1], 9)], axis=-1)


def _rotations(pose: np.ndarray) -> Rotation:
    return Rotation.from_matrix(pose[..., 3:].reshape(-1, 3, 3))


def _moved(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(N, 12) ``pose`` (N, 12) after a ``step`` (N, 6) in m and rad in the base's axes."""
    turned = Rotation.from_rotvec(step[:, 3:]) * _rotations(pose)
    return np.concatenate([pose[:, :3] + step[:, :3], turned.as_matrix().reshape(-1, 9)], axis=1)
