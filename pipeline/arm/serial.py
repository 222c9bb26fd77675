"""The serial chain of any revolute and prismatic joints: pose, Jacobian and its inverse, for whole
batches, by :mod:`pipeline.arm.batches`.

A pose is the tip's position (3, m) and rotation (9, row by row), in the base's axes. The Jacobian
is the geometric one: rows of the tip's velocity and angular velocity in the base's axes, the
latter times the task's characteristic length, so that metres and radians have one unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.arm.numbers import INVERSE, JACOBIAN, POSE, SINGULAR, Arm, joint_frames

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
        from pipeline.arm.batches import displacements  # here, as it loads the compiler

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
        from pipeline.arm.batches import kinematics  # here, as it loads the compiler

        q = np.asarray(q, dtype=float)
        result = np.empty((rows, q.size // len(self.sliding)))
        columns = np.array(q.reshape(-1, len(self.sliding)).T, order="C")
        kinematics(self.numbers(), columns, part, result)
        return result.reshape(rows, *q.shape[:-1])
