"""The serial chain of any revolute and prismatic joints, by NumPy alone;
:mod:`pipeline.arm.kinematics` does the same within compiled loops.

A pose is the tip's position (3, m) and rotation (9, row by row), in the base's axes. The Jacobian
is the geometric one: rows of the tip's velocity and angular velocity in the base's axes, the
latter times the task's characteristic length.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arm.interface import ArmConstants, Chain

# least singular value of the Jacobian at a pose whose inverse is trusted, as a share of
# :meth:`SerialChain.scale`: a step of a thousandth of the arm's size asks for a radian of a joint
LEAST_SINGULAR = 1e-3
# rows of velocity and angular velocity; phi is about the normal of a plane, its frame's y axis
ROWS = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5, "phi": 4}
NEXT, LAST = [1, 2, 0], [2, 0, 1]  # entries of a cross product


@dataclass(frozen=True)
class SerialChain(Chain):
    """A chain of n joints with a task of m rows; by :func:`pipeline.arm.model.chain_of`."""

    task: tuple[str, ...]  # m of ROWS
    length: float  # m by which angular rows are multiplied
    # (n + 1, 12) rotation (9, row by row) and translation (3, m) of each joint's frame, whose z
    # axis is the joint's, in the frame before it, the first in the base's; last the tip's
    placements: np.ndarray
    sliding: np.ndarray  # (n,) True of a prismatic joint
    lower: np.ndarray  # (n,) joint limits, rad or m; infinite where a joint has none
    upper: np.ndarray  # (n,)
    max_speed: np.ndarray  # (n,) rad/s or m/s, likewise

    @property
    def lengths(self) -> np.ndarray:
        """(n,) distances in m from each joint's frame to the next one's, the tip's last."""
        return np.linalg.norm(self.placements[1:, 9:], axis=1)

    @cached_property
    def scale(self) -> float:
        """Bound in m of the entries of the Jacobian while sliding joints are at zero: the reach (1
        at least where a joint slides), or the characteristic length of an angular velocity.
        """
        rows, reach = self._numbers.rows, self.lengths.sum()
        reach = max(reach, 1.0) if self.sliding.any() else reach
        return float(max(reach * np.any(rows < 3), self.length * np.any(rows >= 3)))

    def pose(self, q: np.ndarray) -> np.ndarray:
        """(..., 12) pose of the tip."""
        tip = self._frames(q)[..., -1, :3, :]
        return np.concatenate([tip[..., 3], tip[..., :3].reshape(*tip.shape[:-2], 9)], axis=-1)

    def displacement(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(..., m) from the poses ``start`` (..., 12) to ``end`` (..., 12): the way between their
        positions, and the rotation vector of R_end·R_startᵀ times the length.
        """
        start, end = np.broadcast_arrays(np.asarray(start, float), np.asarray(end, float))
        before, after = (x[..., 3:].reshape(*x.shape[:-1], 3, 3) for x in (start, end))
        turned = rotation_vector(after @ before.swapaxes(-1, -2))
        way = np.concatenate([end[..., :3] - start[..., :3], turned], axis=-1)
        return way[..., self._numbers.rows] * self._numbers.units

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(..., m, n) J(q): m/rad (1 for a prismatic joint), angular rows times the length. A joint
        that turns about the axis e through p gives the tip the velocity e × (tip − p) and the
        angular velocity e; one that slides along e the velocity e.
        """
        frames = self._frames(q)
        axes, points = frames[..., :-1, :3, 2], frames[..., :-1, :3, 3]
        lever = frames[..., -1:, :3, 3] - points
        velocity = axes[..., NEXT] * lever[..., LAST] - axes[..., LAST] * lever[..., NEXT]
        if self.sliding.any():
            sliding = self.sliding[:, None]
            velocity, axes = np.where(sliding, axes, velocity), np.where(sliding, 0.0, axes)
        columns = np.concatenate([velocity, axes], axis=-1)[..., self._numbers.rows]
        return columns.swapaxes(-1, -2) * self._numbers.units[:, None]

    def singular(self, q: np.ndarray) -> np.ndarray:
        """(...,) True where the least singular value is below its bound, or ``q`` is not finite."""
        finite, least = np.isfinite(q).all(axis=-1), LEAST_SINGULAR * self.scale
        jacobian = self.jacobian(np.where(finite[..., None], q, 0.0))
        square, others = jacobian @ jacobian.swapaxes(-1, -2), len(self.task) - 1
        # det JJᵀ is at most the least squared singular value times a power of the others' mean
        mean = np.trace(square, axis1=-2, axis2=-1) / max(others, 1)
        near = ~(np.linalg.det(square) > 4 * least**2 * mean**others)
        result = np.array(~finite)
        result[near] |= ~(np.linalg.svd(jacobian[near], compute_uv=False)[..., -1] >= least)
        return result[()]

    @np.errstate(invalid="ignore")  # a pose may be infinite
    def inverse_jacobian(self, q: np.ndarray, *, what: str = "pose") -> np.ndarray:
        """(..., n, m) J⁺ = Jᵀ(JJᵀ)⁻¹; raises SingularJacobianError naming a singular ``what``."""
        jacobian = self.jacobian(q)
        across = jacobian.swapaxes(-1, -2)
        square = len(self.task) == len(self.sliding)
        try:
            inverse = np.linalg.inv(jacobian if square else jacobian @ across)
        except np.linalg.LinAlgError:
            self.require_regular(q, what=what)
            raise
        inverse = inverse if square else across @ inverse
        # the least singular value is at least 1/‖J⁺‖_F
        doubtful = ~(np.linalg.norm(inverse, axis=(-2, -1)) * LEAST_SINGULAR * self.scale <= 1)
        if doubtful.any() and self.singular(np.asarray(q)[doubtful]).any():
            self.require_regular(q, what=what)
        return inverse

    def numbers(self) -> ArmConstants:
        """Constants of the chain for compiled code."""
        return self._numbers._replace(least=LEAST_SINGULAR * self.scale)

    @cached_property
    def _numbers(self) -> ArmConstants:  # without ``least``, which depends on the rows
        rows = np.array([ROWS[name] for name in self.task])
        frames, units = joint_frames(self.placements), np.where(rows < 3, 1.0, self.length)
        return ArmConstants(np.empty(0), frames, self.sliding.astype(float), rows, units, 0.0)

    @np.errstate(invalid="ignore")
    def _frames(self, q: np.ndarray) -> np.ndarray:
        """(..., n + 1, 4, 4) frames of the joints at ``q`` and of the tip, in the base's axes."""
        q = np.asarray(q, dtype=float)
        result = np.empty((*q.shape[:-1], len(self.placements), 4, 4))
        result[...] = np.eye(4)
        result[..., :3, :3] = self.placements[:, :9].reshape(-1, 3, 3)
        result[..., :3, 3] = self.placements[:, 9:]
        x, y, z = (self.placements[:-1, k:9:3] for k in range(3))
        angle = np.where(self.sliding, 0.0, q)[..., None]
        sine, cosine = np.sin(angle), np.cos(angle)
        result[..., :-1, :3, 0] = x * cosine + y * sine
        result[..., :-1, :3, 1] = y * cosine - x * sine
        if self.sliding.any():
            result[..., :-1, :3, 3] += np.where(self.sliding, q, 0.0)[..., None] * z
        for j in range(len(self.sliding)):
            result[..., j + 1, :, :] = result[..., j, :, :] @ result[..., j + 1, :, :]
        return result


def rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """(..., 3) axis times angle in rad, up to half a turn, of ``rotation`` R (..., 3, 3), by the
    unit quaternion (w, v): the first row of 4(w, v)(w, v)ᵀ where w² > 1/4, else the one with the
    greatest diagonal entry.
    """
    w = 1 + rotation[..., 0, 0] + rotation[..., 1, 1] + rotation[..., 2, 2]
    v = rotation[..., LAST, NEXT] - rotation[..., NEXT, LAST]
    if (far := ~(w > 1)).any():
        part = rotation[far]
        square = np.empty((len(part), 4, 4))
        square[:, 0, 0], square[:, 0, 1:] = w[far], v[far]
        square[:, 1:, 0] = v[far]
        square[:, 1:, 1:] = part + part.swapaxes(1, 2) + (2 - w[far])[:, None, None] * np.eye(3)
        greatest = np.diagonal(square, axis1=1, axis2=2).argmax(axis=1)
        row = square[np.arange(len(part)), greatest]
        row = np.where(row[:, :1] < 0, -row, row)
        w, v[far] = np.where(far, 0.0, w), row[:, 1:]
        w[far] = row[:, 0]
    sine = np.sqrt(np.vecdot(v, v))
    angle = 2 * np.arctan2(sine, w)
    return v * np.divide(angle, sine, out=np.zeros_like(sine), where=sine > 0)[..., None]


# columns of a frame: the turn about z (rad), cosine and sine of the tilt about x, the shift before
# the tilt (3, m)
FRAME_TURN, FRAME_COSINE, FRAME_SINE, FRAME_SHIFT = 0, 1, 2, 3


def joint_frames(placements: np.ndarray) -> np.ndarray:
    """(n + 2, 6) turn, tilt and shift of the ``placements`` (n + 1, 12) of a serial chain, whose
    rotations are R_z(β)R_x(α)R_z(γ): β is added to the turn of the joint before and γ to the
    joint's own. The last row turns the tip after its tilt.
    """
    result, own = np.zeros((len(placements) + 1, 6)), 0.0
    for row, placement in zip(result, placements, strict=False):
        rotation, shift = placement[:9].reshape(3, 3).copy(), placement[9:].copy()
        x, y = rotation[:2, 2]
        # after either of two turns z is tilted about x alone: the one of at most a right angle
        turn = np.arctan2(-x if y >= 0 else x, abs(y))
        back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        rotation[:2], shift[:2] = back @ rotation[:2], back @ shift[:2]
        row[:] = own + turn, rotation[2, 2], -rotation[1, 2], *shift
        own = np.arctan2(-rotation[0, 1], rotation[0, 0])
    result[-1, [FRAME_TURN, FRAME_COSINE]] = own, 1.0
    return result
