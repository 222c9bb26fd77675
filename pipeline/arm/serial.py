"""The serial chain of any revolute and prismatic joints: pose, Jacobian and its inverse, for whole
batches, by :mod:`pipeline.arm.kinematics`, or by NumPy alone where there is no compiler.

A pose is the tip's position (3, m) and rotation (9, row by row), in the base's axes. The Jacobian
is the geometric one: rows of the tip's velocity and angular velocity in the base's axes, the
latter times the task's characteristic length, so that metres and radians have one unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arm.interface import INVERSE, JACOBIAN, POSE, SINGULAR, Arm, Chain, joint_frames

# The least singular value of the Jacobian at a pose whose inverse is trusted, as a share of the
# greatest entry that the Jacobian can have (see :meth:`SerialChain.scale`). Below it a step of a
# thousandth of the arm's size asks for a radian of some joint: no step that the linear model
# describes. Above it J⁺ is exact to 1e-12 of its size.
LEAST_SINGULAR = 1e-3
# rows of the velocity, then of the angular velocity, by their names; phi is the angle about the
# normal of a task in a plane, which is the y axis of the plane's frame
ROWS = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5, "phi": 4}


@dataclass(frozen=True)
class SerialChain(Chain):
    """A chain of n joints with a task of m rows; from a URDF by
    :func:`pipeline.arm.model.chain_of`.
    """

    task: tuple[str, ...]  # m of ROWS
    length: float  # m by which angular rows are multiplied
    # (n + 1, 12) rotation (9, row by row) and translation (3, m) of each joint's frame, whose z
    # axis is the joint's, in the frame before it, the first in the base's; last the tip's
    placements: np.ndarray
    sliding: np.ndarray  # (n,) whether a joint is prismatic
    lower: np.ndarray  # (n,) joint limits, rad or m; infinite where a joint has none
    upper: np.ndarray  # (n,)
    max_speed: np.ndarray  # (n,) rad/s or m/s, likewise

    @property
    def lengths(self) -> np.ndarray:
        """(n,) distances in m from each joint's frame to the next one's, the tip's last."""
        return np.linalg.norm(self.placements[1:, 9:], axis=1)

    @property
    def scale(self) -> float:
        """What no entry of the Jacobian is beyond while sliding joints are at zero, m: the reach
        from the first joint on for a velocity (1 at least where a joint slides), the characteristic
        length for an angular velocity.
        """
        rows = self._rows()
        reach = self.lengths.sum()
        reach = max(reach, 1.0) if self.sliding.any() else reach
        return float(max(reach * np.any(rows < 3), self.length * np.any(rows >= 3)))

    def pose(self, q: np.ndarray) -> np.ndarray:
        """(..., 12) pose of the tip."""
        return np.moveaxis(self._computed(q, POSE, 12), 0, -1)

    def displacement(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(..., m) from the poses ``start`` (..., 12) to ``end`` (..., 12): the way between their
        positions, and the rotation vector of R_end·R_startᵀ times the length.
        """
        from pipeline.arm.kinematics import displacements  # here, as it loads the compiler

        start, end = np.broadcast_arrays(np.asarray(start, float), np.asarray(end, float))
        result = np.zeros((start.size // 12, len(self.task)))
        pairs = (np.array(poses.reshape(-1, 12), order="C") for poses in (start, end))
        displacements(self.numbers(), *pairs, result)
        return result.reshape(*start.shape[:-1], len(self.task))

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(..., m, n) J(q): m/rad (1 for a prismatic joint), angular rows times the length."""
        return self._matrices(q, JACOBIAN)

    def singular(self, q: np.ndarray) -> np.ndarray:
        """(...,) whether the least singular value of J(q) is below :data:`LEAST_SINGULAR` of its
        scale, or ``q`` is not finite.
        """
        return self._computed(q, SINGULAR, 1)[0] > 0

    def inverse_jacobian(self, q: np.ndarray, *, what: str = "pose") -> np.ndarray:
        """(..., n, m) J⁺; raises :class:`SingularJacobianError` naming the first singular
        ``what``.
        """
        self.require_regular(q, what=what)
        return np.swapaxes(self._matrices(q, INVERSE), -1, -2)

    def numbers(self) -> Arm:
        """What compiled code needs of the chain."""
        return self._numbers

    @cached_property
    def _numbers(self) -> Arm:
        rows = self._rows()
        return Arm(
            plane=np.empty(0),
            frames=joint_frames(self.placements),
            sliding=self.sliding.astype(float),
            rows=rows,
            units=np.where(rows < 3, 1.0, self.length),
            least=LEAST_SINGULAR * self.scale,
        )

    def _rows(self) -> np.ndarray:
        return np.array([ROWS[name] for name in self.task])

    def _matrices(self, q: np.ndarray, part: int) -> np.ndarray:
        """(..., m, n) what :func:`kinematics` says of ``part``."""
        m, n = len(self.task), len(self.sliding)
        entries = self._computed(q, part, m * n)
        return np.moveaxis(entries.reshape(m, n, *np.shape(q)[:-1]), (0, 1), (-2, -1))

    def _computed(self, q: np.ndarray, part: int, rows: int) -> np.ndarray:
        """(rows, ...) of ``part`` of :func:`kinematics`; the batch last, as it computes."""
        from pipeline.arm.kinematics import kinematics  # here, as it loads the compiler

        q = np.asarray(q, dtype=float)
        result = np.empty((rows, q.size // len(self.sliding)))
        columns = np.array(q.reshape(-1, len(self.sliding)).T, order="C")
        kinematics(self.numbers(), columns, part, result)
        return result.reshape(rows, *q.shape[:-1])


@dataclass(frozen=True)
class PlainChain(SerialChain):
    """A serial chain whose kinematics needs no compiler."""

    def pose(self, q: np.ndarray) -> np.ndarray:
        """(..., 12) pose of the tip."""
        _, _, turn, tip = self._frames(q)
        return np.concatenate([tip, turn.reshape(*turn.shape[:-2], 9)], axis=-1)

    def displacement(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(..., m) from the poses ``start`` (..., 12) to ``end`` (..., 12)."""
        start, end = np.broadcast_arrays(np.asarray(start, float), np.asarray(end, float))
        before, after = (x[..., 3:].reshape(*x.shape[:-1], 3, 3) for x in (start, end))
        way = np.concatenate([end - start, _rotation_vector(after @ before.swapaxes(-1, -2))], -1)
        rows = self._rows()
        return way[..., np.where(rows < 3, rows, rows + 9)] * self.numbers().units

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(..., m, n) J(q): the velocity e × (tip − p) and angular velocity e of a joint that turns
        about the axis e through p, the velocity e of one that slides along it.
        """
        axes, points, _, tip = self._frames(q)
        sliding = self.sliding[:, None]
        turning = np.cross(axes, tip[..., None, :] - points)
        velocity = np.where(sliding, axes, turning)
        columns = np.concatenate([velocity, np.where(sliding, 0.0, axes)], axis=-1)
        return columns[..., self._rows()].swapaxes(-1, -2) * self.numbers().units[:, None]

    def singular(self, q: np.ndarray) -> np.ndarray:
        """(...,) whether J(q) has no inverse to be trusted, or ``q`` is not finite."""
        finite = np.isfinite(q).all(axis=-1)
        known = self.jacobian(np.where(finite[..., None], q, 0.0))
        least = np.linalg.svd(known, compute_uv=False)[..., -1]
        return ~(finite & (least >= LEAST_SINGULAR * self.scale))

    def inverse_jacobian(self, q: np.ndarray, *, what: str = "pose") -> np.ndarray:
        """(..., n, m) J⁺; raises :class:`SingularJacobianError` naming the first singular
        ``what``.
        """
        self.require_regular(q, what=what)
        return np.linalg.pinv(self.jacobian(q))

    def _frames(self, q: np.ndarray) -> tuple[np.ndarray, ...]:
        """Axes (..., n, 3) and points (..., n, 3) of the joints, rotation (..., 3, 3) and position
        (..., 3) of the tip, in the base's axes.
        """
        q = np.asarray(q, dtype=float)
        turn, point = (
            np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3)),
            np.zeros((*q.shape[:-1], 3)),
        )
        axes, points = [], []
        for j, placement in enumerate(self.placements):
            point = point + turn @ placement[9:]
            turn = turn @ placement[:9].reshape(3, 3)
            if j == q.shape[-1]:
                break
            axes.append(turn[..., 2])
            points.append(point)
            angle = q[..., j]
            if self.sliding[j]:
                point = point + angle[..., None] * turn[..., 2]
            else:
                turn = turn @ _about_z(angle)
        return np.stack(axes, axis=-2), np.stack(points, axis=-2), turn, point


def _about_z(angle: np.ndarray) -> np.ndarray:
    """(..., 3, 3) rotations by ``angle`` (...) in rad."""
    sine, cosine, zero = np.sin(angle), np.cos(angle), np.zeros_like(angle)
    rows = [[cosine, -sine, zero], [sine, cosine, zero], [zero, zero, zero + 1.0]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """(..., 3) axis times angle in rad, of less than half a turn, of ``rotation`` (..., 3, 3)."""
    skew = (rotation - rotation.swapaxes(-1, -2)) / 2
    vector = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
    sine = np.linalg.norm(vector, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (np.trace(rotation, axis1=-2, axis2=-1)[..., None] - 1) / 2)
    return vector * np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 1.0)
