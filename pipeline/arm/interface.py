"""Interface of the kinematics of robots, and the table of a commanded trajectory."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy import ndarray

from pipeline.core.columns import spread
from pipeline.core.errors import SingularJacobianError

if TYPE_CHECKING:  # an exported model is loaded with NumPy alone
    import pandas as pd


class Mechanism(Protocol):
    """A robot of n joints and a task of m ≤ n rows; J (m, n) is its Jacobian.

    ``q`` (..., n) are joint coordinates in rad (revolute) or m (prismatic). A *command* (..., m) is
    a step v of the task. A longer command (..., m + n) also has a step w of the joints; the arm
    executes the part of w in the null space of J.
    """

    task: tuple[str, ...]  # names of the m rows
    lower: ndarray  # (n,) joint limits, rad or m; infinite without a limit
    upper: ndarray  # (n,)
    max_speed: ndarray  # (n,) rad/s or m/s; infinite without a limit

    def pose(self, q: ndarray) -> ndarray:
        """(..., p) pose of the tip."""

    def coordinates(self, q: ndarray) -> ndarray:
        """(M+1, m) task rows of a motion ``q`` (M+1, n), in m and rad."""

    def displacement(self, start: ndarray, end: ndarray) -> ndarray:
        """(..., m) task step between the poses ``start`` and ``end`` (..., p)."""

    def jacobian(self, q: ndarray) -> ndarray:
        """(..., m, n) J(q)."""

    def singular(self, q: ndarray) -> ndarray:
        """(...,) True where J(q) is nearly singular (bound of the chain) or ``q`` not finite."""

    def inverse_jacobian(self, q: ndarray, *, what: str = "pose") -> ndarray:
        """(..., n, m) J⁺; raises SingularJacobianError naming the first singular ``what``."""

    def least_singular_value(self, q: ndarray) -> ndarray:
        """(...,) least singular value of J(q)."""
        return np.linalg.svd(self.jacobian(q), compute_uv=False)[..., -1]

    def require_regular(self, q: ndarray, *, what: str = "pose") -> None:
        """Raise :class:`SingularJacobianError` naming the first singular ``what`` of ``q``."""
        bad = self.singular(q)
        if np.any(bad):
            index = tuple(int(i) for i in np.argwhere(bad)[0])
            pose = np.asarray(q, dtype=float)[index]
            least = (
                self.least_singular_value(pose) if np.isfinite(pose).all() else np.nan
            )
            raise SingularJacobianError(
                f"the Jacobian is singular at {int(bad.sum())} {what}(s), where a small step of "
                "the task needs a large step of the joints (or a pose is not finite)",
                index=index,
                q=pose.round(4).tolist(),
                least_singular_value=float(f"{least:.3g}"),
            )

    def nominal_step(self, q: ndarray, command: ndarray) -> ndarray:
        """(..., n) noise-free joint step J⁺v + (I − J⁺J)w; raises SingularJacobianError."""
        v = np.asarray(command)[..., : len(self.task)]
        return np.matvec(self.inverse_jacobian(q), v) + self.null_step(q, command)

    def null_step(self, q: ndarray, command: ndarray) -> ndarray:
        """(..., n) null-space part (I − J⁺J)w of the joint step; zero for a command without w."""
        w = np.asarray(command, dtype=float)[..., len(self.task) :]
        if w.shape[-1] == 0:
            return np.zeros(np.broadcast_shapes(np.shape(q), (*w.shape[:-1], 1)))
        return w - np.matvec(self.inverse_jacobian(q), np.matvec(self.jacobian(q), w))

    def within_limits(self, q: ndarray) -> ndarray:
        """(...,) True where every joint of ``q`` is within its limits."""
        return np.all((q >= self.lower) & (q <= self.upper), axis=-1)


def trajectory_table(
    chain: Mechanism,
    q: ndarray,
    rate: float,
    joints: Sequence[str] = (),
) -> "pd.DataFrame":
    """Table of xᵈ and ẋᵈ for commanded joint angles ``q`` (M+1, n) in rad at ``rate`` per second.
    Columns are k, t, the families x and v of the task rows (SI), and for a redundant arm the speeds
    u of ``joints`` in rad/s. v_kΔt is the displacement from the pose at t_k to the pose at t_{k+1},
    zero in the last row.
    """
    import pandas as pd

    pose = chain.pose(q)
    k = np.arange(len(q))
    task_steps = chain.displacement(pose[:-1], pose[1:])
    joint_steps = np.diff(q, axis=0)
    table = {"k": k, "t": k / rate}
    table |= spread("x", chain.task, chain.coordinates(q))
    table |= spread("v", chain.task, _speeds(task_steps, rate))
    if len(chain.task) < q.shape[1]:
        table |= spread("u", joints, _speeds(joint_steps, rate))
    return pd.DataFrame(table)


def _speeds(steps: ndarray, rate: float) -> ndarray:
    """(M+1, n) speeds per second of ``steps`` (M, n), zero in the last row."""
    return np.vstack([steps * rate, np.zeros((1, steps.shape[1]))])
