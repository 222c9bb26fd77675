"""Serial chains of revolute and prismatic joints. All of them, planar or in space, have the
kinematics of :mod:`pipeline.arm.kinematics`.

A pose is the tip's position (3, m) and rotation (9, row by row) in the base's axes. The Jacobian is
geometric: rows of the tip's velocity and of its angular velocity times the task's characteristic
length, in the base's axes.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy import ndarray

from pipeline.arm.interface import Mechanism
from pipeline.arm.kinematics import ArmConstants, evaluate, link_constants
from pipeline.arm.rotations import rotation_vector
from pipeline.arm.rows import JOINTS, block_rows
from pipeline.core.columns import PLANE

# least singular value of the scaled Jacobian at a regular pose: a task step of 1e-3 of the reach
# or of 1e-3 rad then needs a joint step of at most 1 rad or the reach
LEAST_SINGULAR = 1e-3
# rows of velocity and angular velocity; phi is about the normal of a plane, its y axis
ROWS = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5, "phi": 4}


class Chain(Mechanism):
    """A chain of n joints with a task of m rows; see :func:`pipeline.arm.model.chain_of`."""

    task: tuple[str, ...]  # m names of ROWS
    length: float  # m by which angular rows are multiplied
    # (n + 1, 12) rotation (9, row by row) and translation (3, m) of the joint frames (z along the
    # axis) and the tip's frame, each in the previous frame, the first in the base frame
    placements: ndarray
    sliding: ndarray  # (n,) True for a prismatic joint

    @property
    def lengths(self) -> ndarray:
        """(n,) distances in m between consecutive frames of the joints and the tip."""
        return np.linalg.norm(self.placements[1:, 9:], axis=1)

    @cached_property
    def reach(self) -> float:
        """Sum of :attr:`lengths` in m, 1 if all axes pass through one point."""
        return float(self.lengths.sum()) or 1.0

    @cached_property
    def row_sizes(self) -> ndarray:
        """(m,) by which rows of J are divided to be without unit: the reach, or the length."""
        return np.where(self.constants.rows < 3, self.reach, self.length)

    @cached_property
    def column_sizes(self) -> ndarray:
        """(n,) by which columns of J are multiplied to be without unit: 1, or the reach of a
        prismatic joint.
        """
        return np.where(self.sliding, self.reach, 1.0)

    @cached_property
    def constants(self) -> ArmConstants:
        """Constants of the chain for compiled code."""
        rows = np.array([ROWS[name] for name in self.task])
        return ArmConstants(
            *link_constants(self.placements),
            sliding=self.sliding.astype(float),
            rows=rows,
            units=np.where(rows < 3, 1.0, self.length),
            reach=self.reach,
            least=LEAST_SINGULAR,
        )

    def _evaluate(self, q: ndarray, first: int, last: int) -> ndarray:
        """(..., last − first) rows of :func:`evaluate` from ``first`` on, at ``q`` (..., n)."""
        q = np.asarray(q, dtype=float)
        joints = np.ascontiguousarray(q.reshape(-1, q.shape[-1]).T)
        rows = evaluate(self.constants, joints)[first:last]
        return np.ascontiguousarray(rows.T).reshape(*q.shape[:-1], last - first)

    def pose(self, q: ndarray) -> ndarray:
        """(..., 12) pose of the tip."""
        return self._evaluate(q, 0, 12)

    def joint_points(self, q: ndarray) -> ndarray:
        """(..., n + 1, 3) a point of each joint's axis and the tip, m."""
        n = len(self.lower)
        rows = self._evaluate(q, 0, JOINTS + 6 * n)
        axes = rows[..., JOINTS:].reshape(*rows.shape[:-1], n, 6)
        return np.concatenate([axes[..., 3:], rows[..., None, :3]], axis=-2)

    def jacobian(self, q: ndarray) -> ndarray:
        """(..., m, n) J(q) in m/rad (1 for a prismatic joint). A revolute joint with the axis e
        through p gives the tip the velocity e × (tip − p) and angular velocity e, a prismatic joint
        e.
        """
        n = len(self.lower)
        m = len(self.task)
        first = block_rows(n, m).jacobian
        rows = self._evaluate(q, first, first + m * n)
        return rows.reshape(*rows.shape[:-1], m, n)

    def scaled_jacobian(self, q: ndarray) -> ndarray:
        """(..., m, n) J(q) without units, the same in m and mm: velocities are divided by the
        reach, angular rows by their length, and a prismatic joint moves by reaches.
        """
        return self.jacobian(q) / self.row_sizes[:, None] * self.column_sizes

    def displacement(self, start: ndarray, end: ndarray) -> ndarray:
        """(..., m) difference of the positions of the poses ``start`` and ``end`` (..., 12), and
        rotation vector of R_end·R_startᵀ times the length.
        """
        start = np.asarray(start, dtype=float)
        end = np.asarray(end, dtype=float)
        start, end = np.broadcast_arrays(start, end)
        back = _rotation(start).swapaxes(-1, -2)
        turn = _rotation(end) @ back
        shift = end[..., :3] - start[..., :3]
        rows = np.concatenate([shift, rotation_vector(turn)], axis=-1)
        return rows[..., self.constants.rows] * self.constants.units

    def coordinates(self, q: ndarray) -> ndarray:
        """(M+1, m) task rows of a motion ``q`` (M+1, n), in m and rad, rotations from the first
        pose.
        """
        pose = self.pose(q)
        rows = self.constants.rows
        turns = self.displacement(pose[:1], pose)
        return np.where(rows < 3, pose[:, np.minimum(rows, 2)], turns)

    def singular(self, q: ndarray) -> ndarray:
        """(...,) True where the least singular value of the scaled Jacobian is below
        LEAST_SINGULAR, or ``q`` is not finite.
        """
        finite = np.isfinite(q).all(axis=-1)
        finite_q = np.where(finite[..., None], q, 0.0)
        jacobian = self.scaled_jacobian(finite_q)
        square = jacobian @ jacobian.swapaxes(-1, -2)
        # det JJᵀ ≤ least squared singular value times a power of the mean of the greater ones
        greater = len(self.task) - 1
        mean = np.trace(square, axis1=-2, axis2=-1) / max(greater, 1)
        bound = 4 * LEAST_SINGULAR**2 * mean**greater
        near = ~(np.linalg.det(square) > bound)

        singular = np.array(~finite)
        values = np.linalg.svd(jacobian[near], compute_uv=False)
        least = values[..., -1]
        singular[near] |= ~(least >= LEAST_SINGULAR)
        return singular[()]

    @np.errstate(invalid="ignore")  # a pose may be infinite
    def inverse_jacobian(self, q: ndarray, *, what: str = "pose") -> ndarray:
        """(..., n, m) J⁺ = Jᵀ(JJᵀ)⁻¹; raises SingularJacobianError naming a singular ``what``."""
        jacobian = self.jacobian(q)
        transposed = jacobian.swapaxes(-1, -2)
        try:
            if len(self.task) == len(self.sliding):
                inverse = np.linalg.inv(jacobian)
            else:
                inverse = transposed @ np.linalg.inv(jacobian @ transposed)
        except np.linalg.LinAlgError:
            self.require_regular(q, what=what)
            raise
        # the least singular value of a matrix is at least 1/‖right inverse‖_F
        scaled = inverse * self.row_sizes / self.column_sizes[:, None]
        doubtful = ~(np.linalg.norm(scaled, axis=(-2, -1)) * LEAST_SINGULAR <= 1)
        if doubtful.any() and self.singular(np.asarray(q)[doubtful]).any():
            self.require_regular(q, what=what)
        return inverse


@dataclass(frozen=True)
class SerialChain(Chain):
    """A chain by its placements."""

    task: tuple[str, ...]
    length: float
    placements: ndarray
    sliding: ndarray
    lower: ndarray  # (n,) joint limits, rad or m; infinite without a limit
    upper: ndarray
    max_speed: ndarray  # (n,) rad/s or m/s; infinite without a limit


@dataclass(frozen=True)
class PlanarChain(Chain):
    """A planar chain of three revolute joints by its links; :func:`pipeline.arm.model.chain_of`
    reads it from a URDF.

    Frame of the plane: x horizontal, z up (the two task axes), rotations positive about its normal
    y = z × x; task rows in the order x (m), z (m), φ (rad). With cumulative angles φ_j = s_1 q_1 +
    … + s_j q_j and link vectors r_j (at q = 0) the joints are at O_{j+1} = O_j + R(φ_j) r_j, O_4
    being the end-effector EE.
    """

    task: ClassVar[tuple[str, ...]] = PLANE
    length: ClassVar[float] = 1.0
    origin: ndarray  # (2,) O1 in the plane, m
    links: ndarray  # (3, 2) link vectors at q = 0, m
    signs: ndarray  # (3,) +1 or -1: sense of each joint about the plane's normal
    lower: ndarray  # (3,) joint limits, rad
    upper: ndarray  # (3,)
    max_speed: ndarray  # (3,) rad/s

    @cached_property
    def placements(self) -> ndarray:
        """(4, 12) frames of the joints and the tip, which has the plane's axes at q = 0."""
        frames = [joint_axes(sign) for sign in self.signs]
        frames.append(np.eye(3))  # of the tip
        in_plane = np.vstack([self.origin, self.links])
        vectors = np.insert(in_plane, 1, 0.0, axis=1)
        placements = []
        previous = np.eye(3)
        for frame, vector in zip(frames, vectors, strict=True):
            turn = previous.T @ frame
            shift = previous.T @ vector
            placements.append(np.append(turn, shift))
            previous = frame
        return np.array(placements)

    @cached_property
    def sliding(self) -> ndarray:
        """(3,) False: all joints are revolute."""
        return np.zeros(3, dtype=bool)

    @property
    def straight(self) -> float:
        """Angle of the second joint in rad, modulo π, at which the first two links are in line."""
        first, second = np.arctan2(*self.links[:2].T)
        return float(self.signs[1] * (first - second))

    def points(self, q: ndarray) -> ndarray:
        """(..., 4, 2) positions of O1, O2, O3 and EE in m for joint angles ``q`` (..., 3)."""
        return self.joint_points(q)[..., [0, 2]]

    def coordinates(self, q: ndarray) -> ndarray:
        """(..., 3) task rows x, z (m) and φ (rad), which is zero at zero angles and keeps whole
        turns, at ``q`` (..., 3).
        """
        turns = self.signs * np.asarray(q, dtype=float)
        phi = np.cumsum(turns, axis=-1)[..., -1:]
        position = self.pose(q)[..., [0, 2]]
        return np.concatenate([position, phi], axis=-1)

    def segment_headings(self, q: ndarray) -> ndarray:
        """(..., 3) angles ψ_j in rad about y from the z axis to the segments O_jO_{j+1}."""
        return np.cumsum(self.signs * q, axis=-1) + np.arctan2(*self.links.T)

    def joints_from_segments(self, psi: ndarray) -> ndarray:
        """(..., 3) joint angles in rad at the headings ``psi`` (..., 3), nearest to mid-range."""
        phi = np.asarray(psi, dtype=float) - np.arctan2(*self.links.T)
        q = self.signs * np.diff(phi, axis=-1, prepend=0.0)
        middle = (self.lower + self.upper) / 2
        return q - 2 * np.pi * np.round((q - middle) / (2 * np.pi))


def joint_axes(sign: float) -> ndarray:
    """(3, 3) axes, in columns, of a planar chain's joint frame: x is the plane's, z is the joint's
    axis, ``sign`` times the plane's normal y.
    """
    return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, sign], [0.0, -sign, 0.0]])


def segment_frames(chain: PlanarChain, q: ndarray) -> tuple[ndarray, ndarray]:
    """Rotations (..., 3, 3, 3) and origins (..., 3, 3) in m of the segments in the plane's frame
    (x, normal y, z) at ``q`` (..., 3) in rad. Segment j starts at O_j; its axes, the columns of its
    rotation, are z towards O_{j+1}, y along the normal, x = y × z.
    """
    psi = chain.segment_headings(q)
    sine = np.sin(psi)
    cosine = np.cos(psi)
    rotation = np.zeros((*psi.shape, 3, 3))
    rotation[..., 0, 0] = cosine
    rotation[..., 2, 2] = cosine
    rotation[..., 0, 2] = sine
    rotation[..., 2, 0] = -sine
    rotation[..., 1, 1] = 1.0
    origins = chain.joint_points(q)[..., :-1, :]
    return rotation, origins


def _rotation(pose: ndarray) -> ndarray:
    """(..., 3, 3) rotation of the ``pose`` (..., 12)."""
    return pose[..., 3:].reshape(*pose.shape[:-1], 3, 3)
