"""What the kinematics of every robot offers, whatever its joints and its task: the interfaces of
mechanisms and of those among them that compiled code moves.
"""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np

from pipeline.arm.numbers import Arm
from pipeline.core.errors import SingularJacobianError


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
