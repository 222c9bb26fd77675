"""Decompositions J = J₁J₂ of the mean Jacobian (Eq. LUDecom), and their factors for batches.

J has m task rows and n ≥ m joints, J₁ is (m, m) and J₂ (m, n). The paper says "LU or QR depending
on the redundancy" and computes in MATLAB, whose ``lu`` pivots. Each gives another law of a step:

- ``pivoted_lu``: J₁ = PᵀL, J₂ = U. The law depends on the units of the task rows (m and rad), the
  axes of the task (of the arm's base) and the order of the joints, not on the order of the rows.
- ``qr``: QR of J. It is computed with J₁ = I and J₂ = J, the same law, because the law of B is
  invariant under rotations. The law depends only on the units of the rows.
- ``qr_transposed``: QR of Jᵀ, J₁ = Rᵀ, J₂ = Qᵀ, ‖a‖ = ‖J⁺v‖. The law depends on no unit, axis or
  order.
- ``given``: J₁ is a constant, e.g. diag(ℓ, ℓ, 1), which converts m to rad at a lever arm ℓ.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.model import task_step

COMPUTED = ("pivoted_lu", "qr", "qr_transposed")
LEAST_CONDITION = 1e-9  # least divided by greatest singular value of a given J₁


@dataclass(frozen=True)
class Decomposition:
    """Decomposition by its ``name``, one of :data:`COMPUTED`, or ``given`` with ``left`` J₁ (m, m).
    Raises ModelDomainError for an unknown name or a J₁ that is not regular.
    """

    name: str
    left: Sequence[Sequence[float]] | ndarray | None = None

    def __post_init__(self) -> None:
        if self.left is None and self.name in COMPUTED:
            return
        if self.left is None or self.name != "given":
            known = f"one of {', '.join(COMPUTED)}, or given with the first factor of the Jacobian"
            raise ModelDomainError(
                f"the decomposition must be {known}", decomposition=self.name
            )
        try:
            matrix = np.array(self.left, dtype=float)
            regular = np.linalg.cond(matrix) * LEAST_CONDITION < 1
            object.__setattr__(self, "left", tuple(map(tuple, matrix.tolist())))
        except (TypeError, ValueError, np.linalg.LinAlgError):
            regular = False
        if not (regular and len(set(matrix.shape)) == 1):
            message = "the given first factor of the Jacobian must be a finite, regular matrix"
            raise ModelDomainError(
                f"{message}, as many rows as columns", left=str(self.left)
            )

    def require_size(self, m: int) -> None:
        """Raise ModelDomainError for a given J₁ of another size than ``m`` task rows."""
        if self.left is not None and len(self.left) != m:
            message = (
                f"the given first factor must have as many rows as the task, {m}, got "
            )
            raise ModelDomainError(message + str(len(self.left)), left=self.left)


PIVOTED_LU = Decomposition("pivoted_lu")
CONTROL = Decomposition(
    "qr_transposed"
)  # for comparison: independent of units, axes and order


def decomposition_of(
    name: str,
    left: Sequence[Sequence[float]] | None,
    task: Sequence[str],
    joints: Sequence[str],
) -> Decomposition:
    """Return the decomposition of this ``name`` and ``left`` J₁. ``by_shape`` is pivoted LU for as
    many ``joints`` as ``task`` rows, and QR for more joints.
    """
    by_shape = "pivoted_lu" if len(task) == len(joints) else "qr"
    return Decomposition(by_shape if name == "by_shape" else name, left)


def factors(
    chain: Mechanism, q: ndarray, v: ndarray, decomposition: Decomposition
) -> tuple[ndarray, ndarray, ndarray]:
    """a = J₁⁻¹v (..., m), J₂⁺ (..., n, m) and ½ ln det J₂J₂ᵀ (...,) of J = J₁J₂, Eq. (LUDecom), at
    joint angles ``q`` (..., n) in rad for the command ``v`` (..., m) or (..., m + n). Raises
    SingularJacobianError.
    """
    chain.require_regular(q)
    return split(chain.jacobian(q), task_step(chain, v), decomposition)


def split(
    jacobian: ndarray, v: ndarray, decomposition: Decomposition
) -> tuple[ndarray, ndarray, ndarray]:
    """Return :func:`factors`, Eq. (LUDecom), of ``jacobian`` J (..., m, n) and task step ``v``
    (..., m), whose leading axes broadcast. The result is meaningless if J lacks full row rank.
    """
    m, n = jacobian.shape[-2:]
    decomposition.require_size(m)
    batch = np.broadcast_shapes(jacobian.shape[:-2], v.shape[:-1])
    # [J | v] with the batch axes last, which is several times as fast for small matrices
    rows = np.empty((m, n + 1, *batch))
    rows[:, :n] = np.moveaxis(
        np.broadcast_to(jacobian, (*batch, m, n)), (-2, -1), (0, 1)
    )
    rows[:, n] = np.moveaxis(np.broadcast_to(v, (*batch, m)), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # J₁⁻¹[J | v] = [J₂ | a]
        if decomposition.name == "given":
            rows = np.tensordot(
                np.linalg.inv(np.array(decomposition.left)), rows, axes=1
            )
        elif decomposition.name == "qr_transposed":
            orthonormalize(rows, n)
        elif decomposition.name == "pivoted_lu":
            _eliminate(rows)
        second = np.zeros((m, n + m, *batch))
        second[:, :n] = rows[:, :n]
        second[np.arange(m), n + np.arange(m)] = 1.0
        log_determinant = orthonormalize(second, n)
        # J₂ = R'ᵀQ'ᵀ, so that J₂⁺ = Q'R'⁻ᵀ
        back = np.zeros((n, m, *batch))
        for row in second:
            back += row[:n, None] * row[None, n:]
    return (
        np.moveaxis(rows[:, n], 0, -1),
        np.moveaxis(back, (0, 1), (-2, -1)),
        log_determinant,
    )


def _eliminate(rows: ndarray) -> None:
    """Replace [J | X] (m, n + k, ...) by L⁻¹P[J | X] of PJ = LU with partial pivoting."""
    for k in range(len(rows)):
        greatest = k + np.abs(rows[k:, k]).argmax(axis=0)
        for i in range(k + 1, len(rows)):
            swap = greatest == i
            rows[k], rows[i] = (
                np.where(swap, rows[i], rows[k]),
                np.where(swap, rows[k], rows[i]),
            )
        rows[k + 1 :] -= (rows[k + 1 :, k] / rows[k, k])[:, None] * rows[k]
        rows[k + 1 :, k] = 0.0  # exactly


def orthonormalize(rows: ndarray, n: int) -> ndarray:
    """Replace ``rows`` [J | X] (m, n + k, ...) by R⁻ᵀ[J | X] of J = RᵀQᵀ, by modified Gram–Schmidt
    of the first ``n`` columns, the diagonal of R positive; return ln det R (...,).
    """
    log_determinant = np.zeros(rows.shape[2:])
    for k in range(len(rows)):
        length = np.sqrt((rows[k, :n] ** 2).sum(axis=0))
        rows[k] /= length
        along = (rows[k + 1 :, :n] * rows[k, :n]).sum(axis=1)
        rows[k + 1 :] -= along[:, None] * rows[k]
        log_determinant += np.log(length)
    return log_determinant


def frames(a: ndarray) -> ndarray:
    """(..., m, m) orthonormal matrices with the first column a/‖a‖, ``a`` (..., m) not zero:
    Householder's reflection times −sign(a₁).
    """
    r = np.sqrt(np.vecdot(a, a))
    sign = np.where(a[..., 0] < 0, -1.0, 1.0)
    mirror = a.copy()
    mirror[..., 0] += sign * r
    reach = (r * (r + np.abs(a[..., 0])))[..., None, None]
    reflection = (
        np.eye(a.shape[-1]) - mirror[..., :, None] * mirror[..., None, :] / reach
    )
    return -sign[..., None, None] * reflection
