"""Interface of robots' kinematics, and the constants of a chain that compiled code takes."""

from __future__ import annotations

from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from pipeline.core.errors import SingularJacobianError

POSE, JACOBIAN, SINGULAR, INVERSE = range(4)  # parts of the kinematics
# columns of a frame: the turn about z (rad), cosine and sine of the tilt about x, the shift before
# the tilt (3, m)
FRAME_TURN, FRAME_COSINE, FRAME_SINE, FRAME_SHIFT = 0, 1, 2, 3


class Arm(NamedTuple):
    """A chain of n joints and a task of m rows."""

    # (11,) of a planar chain its links' x and z (3·2, m), its signs (3) and its origin's x and z
    # (m); (0,) of a serial one
    plane: np.ndarray
    frames: np.ndarray  # (n + 2, 6) of a serial chain, by :func:`joint_frames`; (0, 6) of a planar
    sliding: np.ndarray  # (n,) 1 of a prismatic joint, 0 of a revolute one
    rows: np.ndarray  # (m,) the task's rows: 0 to 2 of velocity, 3 to 5 of angular velocity
    units: np.ndarray  # (m,) factor of a row: 1, or a length in m of an angular one
    least: float  # least singular value of the Jacobian at a regular pose


def joint_frames(placements: np.ndarray) -> np.ndarray:
    """(n + 2, 6) turn, tilt and shift of the ``placements`` (n + 1, 12) of a serial chain.

    A rotation is R_z(β)R_x(α)R_z(γ), and a revolute joint a turn about the z axis: β is added to
    the turn of the joint before and γ to that of its own joint, so that four products with the
    entries of a rotation remain of nine. The last row is the turn after the tip's tilt.
    """
    result, own = np.zeros((len(placements) + 1, 6)), 0.0
    for row, placement in zip(result, placements, strict=False):
        rotation, shift = placement[:9].reshape(3, 3).copy(), placement[9:].copy()
        x, y = rotation[:2, 2]
        # of the two turns that leave the z axis tilted about x alone the one of at most a right
        # angle
        turn = np.arctan2(-x if y >= 0 else x, abs(y))
        back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        rotation[:2], shift[:2] = back @ rotation[:2], back @ shift[:2]
        row[:] = own + turn, rotation[2, 2], -rotation[1, 2], *shift
        own = np.arctan2(-rotation[0, 1], rotation[0, 0])
    result[-1, [FRAME_TURN, FRAME_COSINE]] = own, 1.0
    return result


class Mechanism(Protocol):
    """A robot of n joints and a task of m ≤ n rows; J (m, n) is its Jacobian.

    ``q`` (..., n) are joint angles in rad, m of prismatic joints, of any leading axes. A *command*
    (..., m) is a step of the task, or (..., m + n) such a step v and beside it a step w of the
    joints, of which the arm makes what lies in the null space of J. What a class does not replace
    follows from the rest.
    """

    # what is wrong at a singular pose
    defect: ClassVar[str] = (
        "the Jacobian is singular at {where}, where a step of the task asks for any step of the "
        "joints"
    )
    task: tuple[str, ...]  # names of the m rows
    lower: np.ndarray  # (n,) joint limits, rad or m; infinite where a joint has none
    upper: np.ndarray  # (n,)
    max_speed: np.ndarray  # (n,) rad/s or m/s, likewise

    def pose(self, q: np.ndarray) -> np.ndarray:
        """(..., p) pose of the tip."""

    def displacement(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(..., m) task step from the poses ``start`` (..., p) to ``end`` (..., p)."""

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(..., m, n) J(q): the task's velocity for each joint's."""

    def singular(self, q: np.ndarray) -> np.ndarray:
        """(...,) whether J(q) has no inverse to be trusted, or ``q`` is not finite."""

    def inverse_jacobian(self, q: np.ndarray, *, what: str = "pose") -> np.ndarray:
        """(..., n, m) J⁺ = Jᵀ(JJᵀ)⁻¹; raises :class:`SingularJacobianError` naming the first
        singular ``what``.
        """

    def least_singular_value(self, q: np.ndarray) -> np.ndarray:
        """(...,) of the matrix that a singular pose has no inverse of: of J."""
        return np.linalg.svd(self.jacobian(q), compute_uv=False)[..., -1]

    def require_regular(self, q: np.ndarray, *, what: str = "pose") -> None:
        """Raise :class:`SingularJacobianError` naming the first singular ``what`` of ``q`` and the
        :meth:`least_singular_value` there.
        """
        bad = self.singular(q)
        if np.any(bad):
            index = tuple(int(i) for i in np.argwhere(bad)[0])
            pose = np.asarray(q, dtype=float)[index]
            least = self.least_singular_value(pose) if np.isfinite(pose).all() else np.nan
            defect = self.defect.format(where=f"{int(bad.sum())} {what}(s)")
            raise SingularJacobianError(
                f"{defect} (or a pose is not finite)",
                index=index,
                q=pose.round(4).tolist(),
                least_singular_value=float(f"{least:.3g}"),
            )

    def nominal_step(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """(..., n) step of the joints without noise: J⁺v + (I − J⁺J)w; raises what
        :meth:`inverse_jacobian` does.
        """
        v = np.asarray(command)[..., : len(self.task)]
        return np.matvec(self.inverse_jacobian(q), v) + self.null_step(q, command)

    def null_step(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """(..., n) the part of the step that the task does not feel, (I − J⁺J)w; zero where nothing
        of the kind is commanded.
        """
        w = np.asarray(command, dtype=float)[..., len(self.task) :]
        if w.shape[-1] == 0:
            return np.zeros(np.broadcast_shapes(np.shape(q), (*w.shape[:-1], 1)))
        return w - np.matvec(self.inverse_jacobian(q), np.matvec(self.jacobian(q), w))

    def within_limits(self, q: np.ndarray) -> np.ndarray:
        """(...,) whether every joint of ``q`` is inside its limits: the domain D_q of the
        filter.
        """
        return np.all((q >= self.lower) & (q <= self.upper), axis=-1)


class Chain(Mechanism, Protocol):
    """A serial arm, its joints one behind the other: compiled code moves it too."""

    def numbers(self) -> Arm:
        """What compiled code needs of the chain."""
