"""Arms of any number of revolute joints and task rows, in plain NumPy, and commands for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.core.errors import SingularJacobianError

ROWS = ("x", "y", "z", "rx", "ry", "rz")
SIZES = [(2, 1), (2, 2), (3, 2), (4, 4), (5, 3), (6, 6), (7, 6), (8, 3)]  # of n joints and m rows


@dataclass(frozen=True)
class RandomArm:
    """A chain with the methods that the models need."""

    axes: np.ndarray  # (n, 3) of each joint, in the frame of the link before it
    offsets: np.ndarray  # (n + 1, 3) m, from joint to joint and to the tip
    task: tuple[str, ...]

    def forward(self, q):
        """Positions (n + 1, ..., 3) and axes (n, ..., 3) of the joints and the tip, and the tip's
        rotation (..., 3, 3).
        """
        batch = np.shape(q)[:-1]
        rotation, place = np.broadcast_to(np.eye(3), (*batch, 3, 3)), np.zeros((*batch, 3))
        places, axes = [], []
        for j, (axis, offset) in enumerate(zip(self.axes, self.offsets[:-1], strict=True)):
            place = place + rotation @ offset
            places.append(place)
            axes.append(rotation @ axis)
            turn = Rotation.from_rotvec(np.reshape(q[..., j, None] * axis, (-1, 3))).as_matrix()
            rotation = rotation @ turn.reshape(*batch, 3, 3)
        places.append(place + rotation @ self.offsets[-1])
        return np.array(places), np.array(axes), rotation

    def pose(self, q):
        """(..., 12) place and rotation of the tip."""
        places, _, rotation = self.forward(q)
        return np.concatenate([places[-1], rotation.reshape(*np.shape(q)[:-1], 9)], axis=-1)

    def displacement(self, start, end):
        start, end = np.broadcast_arrays(start, end)
        before, after = (each[..., 3:].reshape(-1, 3, 3) for each in (start, end))
        turned = Rotation.from_matrix(after @ np.swapaxes(before, 1, 2)).as_rotvec()
        both = [end[..., :3] - start[..., :3], turned.reshape(*end.shape[:-1], 3)]
        return np.concatenate(both, axis=-1)[..., self._rows]

    def jacobian(self, q):
        places, axes, _ = self.forward(q)
        linear = np.cross(axes, places[-1] - places[:-1])
        return np.moveaxis(np.concatenate([linear, axes], axis=-1), 0, -1)[..., self._rows, :]

    def inverse_jacobian(self, q, *, what="pose"):
        return np.linalg.pinv(self.jacobian(q))

    def null_step(self, q, command):
        m = len(self.task)
        if command.shape[-1] == m:
            return np.zeros(np.broadcast_shapes(q.shape, (*command.shape[:-1], q.shape[-1])))
        w = command[..., m:]
        return w - np.matvec(self.inverse_jacobian(q), np.matvec(self.jacobian(q), w))

    def nominal_step(self, q, command):
        step = np.matvec(self.inverse_jacobian(q), command[..., : len(self.task)])
        return step + self.null_step(q, command)

    def singular(self, q):
        return np.linalg.svd(self.jacobian(q), compute_uv=False)[..., -1] < 1e-6

    def require_regular(self, q, *, what="pose"):
        if np.any(self.singular(q)):
            raise SingularJacobianError("the Jacobian is singular")

    @property
    def _rows(self):
        return [ROWS.index(row) for row in self.task]


def random_arm(n: int, m: int) -> RandomArm:
    """Of ``n`` joints and ``m`` of the six rows; the plane's three parallel joints for (3, 2)."""
    rng = np.random.default_rng(100 * n + m)
    axes, offsets = rng.standard_normal((2, n, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    offsets = 0.3 * np.vstack([offsets, rng.standard_normal(3)])
    if (n, m) == (3, 2):
        links = np.array([[0.0, 0, 0], [0.0, 0, 0.155], [0.0, 0, 0.135], [0.0, 0, 0.17]])
        return RandomArm(np.tile([0.0, 1.0, 0.0], (3, 1)), links, ("x", "z"))
    # more rows than a pose has are none of an arm, but of the algebra
    return RandomArm(axes, offsets, tuple(np.array(ROWS)[rng.permutation(6)[:m]]))


def motion(arm: RandomArm, steps: int, rest: int, size: float = 0.02) -> tuple:
    """(steps + 1, n) regular poses in rad of a slow motion, at rest over the first ``rest`` steps,
    and its commands (steps, m) or (steps, m + n).
    """
    n, m = len(arm.axes), len(arm.task)
    rng = np.random.default_rng(7)
    candidates = rng.uniform(-2, 2, (400, n))
    least = np.linalg.svd(arm.jacobian(candidates), compute_uv=False)
    middle = candidates[(least[:, -1] / least[:, 0]).argmax()]
    phase = size * np.maximum(np.arange(steps + 1) - rest, 0)[:, None]
    q = middle + 0.4 * np.sin(phase * rng.uniform(0.7, 1.3, n) + rng.uniform(0, 6, n))
    q += middle - q[0]
    w = np.diff(q, axis=0)
    v = np.matvec(arm.jacobian(q[:-1]), w)
    return q, (v if m == n else np.concatenate([v, w], axis=1))
