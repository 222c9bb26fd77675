"""Serial chain of any revolute and prismatic joints, in NumPy; :mod:`pipeline.arm.kinematics` is
its compiled form.

A pose is the tip's position (3, m) and rotation (9, row by row) in the base's axes. The Jacobian is
geometric: rows of the tip's velocity and of its angular velocity times the task's characteristic
length, in the base's axes.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray

from pipeline.arm.interface import ArmConstants, Chain

# least singular value of J at a regular pose, divided by :meth:`SerialChain.scale`: a task step of
# 1e-3 of the arm's size then needs a joint step of at most 1 rad
LEAST_SINGULAR = 1e-3
# rows of velocity and angular velocity; phi is about the normal of a plane, its y axis
ROWS = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5, "phi": 4}
NEXT, LAST = [1, 2, 0], [2, 0, 1]  # entries of a cross product
SMALL = 5000  # greatest number of coordinates whose frames are cached for the next call


@dataclass(frozen=True)
class SerialChain(Chain):
    """A chain of n joints with a task of m rows; see :func:`pipeline.arm.model.chain_of`."""

    task: tuple[str, ...]  # m names of ROWS
    length: float  # m by which angular rows are multiplied
    # (n + 1, 12) rotation (9, row by row) and translation (3, m) of the joint frames (z along the
    # axis) and the tip's frame, each in the previous frame, the first in the base frame
    placements: ndarray
    sliding: ndarray  # (n,) True for a prismatic joint
    lower: ndarray  # (n,) joint limits, rad or m; infinite without a limit
    upper: ndarray  # (n,)
    max_speed: ndarray  # (n,) rad/s or m/s; infinite without a limit

    @property
    def lengths(self) -> ndarray:
        """(n,) distances in m between consecutive frames of the joints and the tip."""
        return np.linalg.norm(self.placements[1:, 9:], axis=1)

    @cached_property
    def scale(self) -> float:
        """Magnitude of the entries of J in m: the reach or, if greater, the characteristic length.
        The reach is at least 1 with prismatic joints, which are at zero.
        """
        rows, reach = self._numbers.rows, self.lengths.sum()
        reach = max(reach, 1.0) if self.sliding.any() else reach
        return float(max(reach * np.any(rows < 3), self.length * np.any(rows >= 3)))

    def pose(self, q: ndarray) -> ndarray:
        """(..., 12) pose of the tip."""
        tip = self._frames(q)[..., -1, :3, :]
        return np.concatenate(
            [tip[..., 3], tip[..., :3].reshape(*tip.shape[:-2], 9)], axis=-1
        )

    def displacement(self, start: ndarray, end: ndarray) -> ndarray:
        """(..., m) difference of the positions of the poses ``start`` and ``end`` (..., 12), and
        rotation vector of R_end·R_startᵀ times the length.
        """
        start, end = np.broadcast_arrays(
            np.asarray(start, float), np.asarray(end, float)
        )
        before, after = (x[..., 3:].reshape(*x.shape[:-1], 3, 3) for x in (start, end))
        turned = rotation_vector(after @ before.swapaxes(-1, -2))
        way = np.concatenate([end[..., :3] - start[..., :3], turned], axis=-1)
        return way[..., self._numbers.rows] * self._numbers.units

    def coordinates(self, pose: ndarray) -> ndarray:
        """(M+1, m) task rows of ``pose`` (M+1, 12), in m and rad, rotations from the first pose."""
        x, rows = self.displacement(pose[:1], pose), self._numbers.rows
        return np.where(rows < 3, pose[:, np.minimum(rows, 2)], x)

    def jacobian(self, q: ndarray) -> ndarray:
        """(..., m, n) J(q) in m/rad (1 for a prismatic joint). A revolute joint with the axis e
        through p gives the tip the velocity e × (tip − p) and angular velocity e, a prismatic joint
        e.
        """
        frames = self._frames(q)
        axes, points = frames[..., :-1, :3, 2], frames[..., :-1, :3, 3]
        lever = frames[..., -1:, :3, 3] - points
        velocity = (
            axes[..., NEXT] * lever[..., LAST] - axes[..., LAST] * lever[..., NEXT]
        )
        if self.sliding.any():
            sliding = self.sliding[:, None]
            velocity, axes = (
                np.where(sliding, axes, velocity),
                np.where(sliding, 0.0, axes),
            )
        columns = np.concatenate([velocity, axes], axis=-1)[..., self._numbers.rows]
        return columns.swapaxes(-1, -2) * self._numbers.units[:, None]

    def singular(self, q: ndarray) -> ndarray:
        """(...,) True where the least singular value is below its bound, or ``q`` is not finite."""
        finite, least = np.isfinite(q).all(axis=-1), LEAST_SINGULAR * self.scale
        jacobian = self.jacobian(np.where(finite[..., None], q, 0.0))
        square, others = jacobian @ jacobian.swapaxes(-1, -2), len(self.task) - 1
        # det JJᵀ ≤ least squared singular value times a power of the mean of the others
        mean = np.trace(square, axis1=-2, axis2=-1) / max(others, 1)
        near = ~(np.linalg.det(square) > 4 * least**2 * mean**others)
        result = np.array(~finite)
        result[near] |= ~(
            np.linalg.svd(jacobian[near], compute_uv=False)[..., -1] >= least
        )
        return result[()]

    @np.errstate(invalid="ignore")  # a pose may be infinite
    def inverse_jacobian(self, q: ndarray, *, what: str = "pose") -> ndarray:
        """(..., n, m) J⁺ = Jᵀ(JJᵀ)⁻¹; raises SingularJacobianError naming a singular ``what``."""
        jacobian, square = self.jacobian(q), len(self.task) == len(self.sliding)
        across = jacobian.swapaxes(-1, -2)
        try:
            inverse = np.linalg.inv(jacobian if square else jacobian @ across)
        except np.linalg.LinAlgError:
            self.require_regular(q, what=what)
            raise
        inverse = inverse if square else across @ inverse
        # the least singular value is at least 1/‖J⁺‖_F
        doubtful = ~(
            np.linalg.norm(inverse, axis=(-2, -1)) * LEAST_SINGULAR * self.scale <= 1
        )
        if doubtful.any() and self.singular(np.asarray(q)[doubtful]).any():
            self.require_regular(q, what=what)
        return inverse

    def numbers(self) -> ArmConstants:
        """Constants of the chain for compiled code."""
        return self._numbers._replace(least=LEAST_SINGULAR * self.scale)

    @cached_property
    def _numbers(self) -> ArmConstants:  # without ``least``, which depends on the scale
        rows = np.array([ROWS[name] for name in self.task])
        frames, units = (
            joint_frames(self.placements),
            np.where(rows < 3, 1.0, self.length),
        )
        return ArmConstants(
            np.empty(0), frames, self.sliding.astype(float), rows, units, 0.0
        )

    @cached_property
    def _zero(self) -> ndarray:
        """(n + 1, 4, 4) placements as homogeneous matrices."""
        result = np.tile(np.eye(4), (len(self.placements), 1, 1))
        result[:, :3, :3] = self.placements[:, :9].reshape(-1, 3, 3)
        result[:, :3, 3] = self.placements[:, 9:]
        return result

    @np.errstate(invalid="ignore")
    def _frames(self, q: ndarray) -> ndarray:
        """(..., n + 1, 4, 4) frames of the joints at ``q`` and of the tip, in the base's axes."""
        q = np.asarray(q, dtype=float)
        key = q.shape, q.tobytes()
        last = self.__dict__.get("_last", (None, None))
        if last[0] == key:
            return last[1]
        result = np.empty((*q.shape[:-1], *self._zero.shape))
        result[...] = self._zero
        x, y, z = (self._zero[:-1, :3, k] for k in range(3))
        angle = np.where(self.sliding, 0.0, q)[..., None]
        sine, cosine = np.sin(angle), np.cos(angle)
        result[..., :-1, :3, 0] = x * cosine + y * sine
        result[..., :-1, :3, 1] = y * cosine - x * sine
        if self.sliding.any():
            result[..., :-1, :3, 3] += np.where(self.sliding, q, 0.0)[..., None] * z
        for j in range(len(self.sliding)):
            result[..., j + 1, :, :] = result[..., j, :, :] @ result[..., j + 1, :, :]
        if q.size < SMALL:
            self.__dict__["_last"] = key, result
        return result


def rotation_vector(rotation: ndarray) -> ndarray:
    """(..., 3) axis times angle in rad, up to half a turn, of ``rotation`` (..., 3, 3), by the unit
    quaternion (w, v): first row of 4(w, v)(w, v)ᵀ if w² > 1/4, else row of the greatest diagonal.
    """
    w = 1 + rotation[..., 0, 0] + rotation[..., 1, 1] + rotation[..., 2, 2]
    v = rotation[..., LAST, NEXT] - rotation[..., NEXT, LAST]
    if (far := ~(w > 1)).any():
        part = rotation[far]
        square = np.empty((len(part), 4, 4))
        square[:, 0, 0], square[:, 0, 1:] = w[far], v[far]
        square[:, 1:, 0] = v[far]
        square[:, 1:, 1:] = (
            part + part.swapaxes(1, 2) + (2 - w[far])[:, None, None] * np.eye(3)
        )
        greatest = np.diagonal(square, axis1=1, axis2=2).argmax(axis=1)
        row = square[np.arange(len(part)), greatest]
        row = np.where(row[:, :1] < 0, -row, row)
        w, v[far] = np.where(far, 0.0, w), row[:, 1:]
        w[far] = row[:, 0]
    sine = np.sqrt(np.vecdot(v, v))
    angle = 2 * np.arctan2(sine, w)
    return (
        v * np.divide(angle, sine, out=np.zeros_like(sine), where=sine > 0)[..., None]
    )


def rigid_motion(places: ndarray, measured: ndarray) -> tuple[ndarray, ndarray]:
    """Rotations (..., 3, 3) and translations (..., 3) in m that move the points ``places`` (K, 3)
    to the ``measured`` points (..., K, 3), in m, by least squares: Kabsch (1976). Missing points
    are not finite. The result is NaN for fewer than three points and for points in one line.
    """
    present = np.isfinite(measured).all(axis=-1)
    weight = (present / np.maximum(present.sum(axis=-1), 1)[..., None])[..., None]
    known = np.where(present[..., None], measured, 0.0)
    centres = [(weight * points).sum(axis=-2) for points in (places, known)]
    local, rotated = (
        (p - c[..., None, :]) * present[..., None]
        for p, c in zip((places, known), centres, strict=True)
    )
    spread = np.linalg.svd(local, compute_uv=False)
    decided = spread[..., 1] > 1e-6 * np.maximum(spread[..., 0], 1e-300)
    u, _, vt = np.linalg.svd(np.swapaxes(rotated, -1, -2) @ local)
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    rotation = u @ vt
    translation = centres[1] - np.matvec(rotation, centres[0])
    gone = ~(decided & (present.sum(axis=-1) >= 3))
    rotation[gone], translation[gone] = np.nan, np.nan
    return rotation, translation


# columns of a frame: the turn about z (rad), cosine and sine of the tilt about x, the shift before
# the tilt (3, m)
FRAME_TURN, FRAME_COSINE, FRAME_SINE, FRAME_SHIFT = 0, 1, 2, 3


def joint_frames(placements: ndarray) -> ndarray:
    """(n + 2, 6) turn, tilt and shift of the ``placements`` (n + 1, 12) with rotations
    R_z(β)R_x(α)R_z(γ): β is added to the turn of the previous joint, γ to the next one.
    """
    result, own = np.zeros((len(placements) + 1, 6)), 0.0
    for row, placement in zip(result, placements, strict=False):
        rotation, shift = placement[:9].reshape(3, 3).copy(), placement[9:].copy()
        x, y = rotation[:2, 2]
        # turn of at most a right angle after which z is tilted about x alone
        turn = np.arctan2(-x if y >= 0 else x, abs(y))
        back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        rotation[:2], shift[:2] = back @ rotation[:2], back @ shift[:2]
        row[:] = own + turn, rotation[2, 2], -rotation[1, 2], *shift
        own = np.arctan2(-rotation[0, 1], rotation[0, 0])
    result[-1, [FRAME_TURN, FRAME_COSINE]] = own, 1.0
    return result
