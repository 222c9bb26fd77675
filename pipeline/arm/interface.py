"""Interface of robots' kinematics, and the constants of a chain that compiled code takes."""

from typing import NamedTuple, Protocol

import numpy as np

from pipeline.core.errors import SingularJacobianError


class ArmConstants(NamedTuple):
    """A chain of n joints and a task of m rows; ``plane`` or ``frames`` is empty."""

    plane: np.ndarray  # (11,) a planar chain's links' x and z (3·2, m), signs (3) and origin (2, m)
    frames: np.ndarray  # (n + 2, 6) a serial chain's :func:`pipeline.arm.serial.joint_frames`
    sliding: np.ndarray  # (n,) 1 of a prismatic joint, 0 of a revolute one
    rows: np.ndarray  # (m,) the task's rows: 0 to 2 of velocity, 3 to 5 of angular velocity
    units: np.ndarray  # (m,) factor of a row: 1, or a length in m of an angular one
    least: float  # least singular value of the Jacobian at a regular pose


class Mechanism(Protocol):
    """A robot of n joints and a task of m ≤ n rows; J (m, n) is its Jacobian.

    ``q`` (..., n) are joint angles in rad, m of prismatic joints, of any leading axes. A *command*
    (..., m) is a step of the task, or (..., m + n) such a step v and beside it a step w of the
    joints, of which the arm makes the part in the null space of J.
    """

    task: tuple[str, ...]  # names of the m rows
    lower: np.ndarray  # (n,) joint limits, rad or m; infinite where a joint has none
    upper: np.ndarray  # (n,)
    max_speed: np.ndarray  # (n,) rad/s or m/s, likewise

    def pose(self, q: np.ndarray) -> np.ndarray:
        """(..., p) pose of the tip."""

    def displacement(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(..., m) task step between the poses ``start`` and ``end`` (..., p)."""

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(..., m, n) J(q)."""

    def singular(self, q: np.ndarray) -> np.ndarray:
        """(...,) True where J(q) has no inverse to be trusted, or ``q`` is not finite."""

    def inverse_jacobian(self, q: np.ndarray, *, what: str = "pose") -> np.ndarray:
        """(..., n, m) J⁺; raises SingularJacobianError naming the first singular ``what``."""

    def least_singular_value(self, q: np.ndarray) -> np.ndarray:
        """(...,) least singular value of J(q)."""
        return np.linalg.svd(self.jacobian(q), compute_uv=False)[..., -1]

    def require_regular(self, q: np.ndarray, *, what: str = "pose") -> None:
        """Raise :class:`SingularJacobianError` naming the first singular ``what`` of ``q``."""
        bad = self.singular(q)
        if np.any(bad):
            index = tuple(int(i) for i in np.argwhere(bad)[0])
            pose = np.asarray(q, dtype=float)[index]
            least = self.least_singular_value(pose) if np.isfinite(pose).all() else np.nan
            raise SingularJacobianError(
                f"the Jacobian is singular at {int(bad.sum())} {what}(s), where a step of the task "
                "asks for any step of the joints (or a pose is not finite)",
                index=index,
                q=pose.round(4).tolist(),
                least_singular_value=float(f"{least:.3g}"),
            )

    def nominal_step(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """(..., n) step of the joints without noise, J⁺v + (I − J⁺J)w; raises as J⁺ does."""
        v = np.asarray(command)[..., : len(self.task)]
        return np.matvec(self.inverse_jacobian(q), v) + self.null_step(q, command)

    def null_step(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """(..., n) null-space part of the step, (I − J⁺J)w; zero where no w is commanded."""
        w = np.asarray(command, dtype=float)[..., len(self.task) :]
        if w.shape[-1] == 0:
            return np.zeros(np.broadcast_shapes(np.shape(q), (*w.shape[:-1], 1)))
        return w - np.matvec(self.inverse_jacobian(q), np.matvec(self.jacobian(q), w))

    def within_limits(self, q: np.ndarray) -> np.ndarray:
        """(...,) True where every joint of ``q`` is inside its limits."""
        return np.all((q >= self.lower) & (q <= self.upper), axis=-1)


class Chain(Mechanism, Protocol):
    """A serial arm, its joints one behind the other: compiled code moves it too."""

    def numbers(self) -> ArmConstants:
        """Constants of the chain for compiled code."""
