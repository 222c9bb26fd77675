"""The serial chain by NumPy alone, for what is loaded where there is no compiler: slower than
:mod:`pipeline.arm.batches`, and the same numbers but for rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.serial import LEAST_SINGULAR, SerialChain


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
