"""Decompositions J = J₁J₂ of the mean Jacobian (Eq. LUDecom), and their factors for batches.

J has m task rows and n ≥ m joints, J₁ is (m, m) and J₂ (m, n). The paper says "LU or QR depending
on the redundancy" and computes in MATLAB, whose ``lu`` pivots. Each gives another law of a step:

- ``pivoted_lu``: J₁ = PᵀL, J₂ = U. The law depends on the units of the task rows (m and rad), the
  axes of the task (of the arm's base) and the order of the joints, not on the order of the rows.
- ``qr``: QR of J. It is computed with J₁ = I and J₂ = J, the same law, because the law of B is
  invariant under rotations. The law depends only on the units of the rows.
- ``qr_transposed``: QR of Jᵀ, J₁ = Rᵀ, J₂ = Qᵀ, ‖a‖ = ‖J⁺v‖. The law depends on no unit, axis or
  order.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.model import task_step

COMPUTED = ("pivoted_lu", "qr", "qr_transposed")


@dataclass(frozen=True)
class Decomposition:
    """Decomposition by its ``name``, one of :data:`COMPUTED`; ModelDomainError for another name."""

    name: str

    def __post_init__(self) -> None:
        if self.name not in COMPUTED:
            message = f"the decomposition must be one of {', '.join(COMPUTED)}"
            raise ModelDomainError(message, decomposition=self.name)


PIVOTED_LU = Decomposition("pivoted_lu")
# for comparison: independent of units, axes and order
CONTROL = Decomposition("qr_transposed")


def decomposition_of(
    name: str,
    task: Sequence[str],
    joints: Sequence[str],
) -> Decomposition:
    """Return the decomposition of this ``name``. ``by_shape`` is pivoted LU for as many ``joints``
    as ``task`` rows, and QR for more joints.
    """
    if name == "by_shape":
        name = "pivoted_lu" if len(task) == len(joints) else "qr"
    return Decomposition(name)


def factors(
    chain: Mechanism,
    q: ndarray,
    v: ndarray,
    decomposition: Decomposition,
) -> tuple[ndarray, ndarray, ndarray]:
    """a = J₁⁻¹v (..., m), J₂⁺ (..., n, m) and ½ ln det J₂J₂ᵀ (...,) of J = J₁J₂, Eq. (LUDecom), at
    joint angles ``q`` (..., n) in rad for the command ``v`` (..., m) or (..., m + n). Raises
    SingularJacobianError.
    """
    chain.require_regular(q)
    return split(chain.jacobian(q), task_step(chain, v), decomposition)


def split(
    jacobian: ndarray,
    v: ndarray,
    decomposition: Decomposition,
) -> tuple[ndarray, ndarray, ndarray]:
    """Return :func:`factors`, Eq. (LUDecom), of ``jacobian`` J (..., m, n) and task step ``v``
    (..., m), whose leading axes broadcast. The result is meaningless if J lacks full row rank.
    """
    m, n = jacobian.shape[-2:]
    rows = _extended_rows(jacobian, v)
    with np.errstate(divide="ignore", invalid="ignore"):
        # J₁⁻¹[J | v] = [J₂ | a]
        if decomposition.name == "qr_transposed":
            orthonormalize(rows, n)
        elif decomposition.name == "pivoted_lu":
            _eliminate(rows)
        # J₂ = R'ᵀQ'ᵀ, so that J₂⁺ = Q'R'⁻ᵀ
        second = np.zeros((m, n + m, *rows.shape[2:]))
        second[:, :n] = rows[:, :n]
        second[np.arange(m), n + np.arange(m)] = 1.0
        log_determinant = orthonormalize(second, n)
        back = np.zeros((n, m, *rows.shape[2:]))
        for row in second:
            back += row[:n, None] * row[None, n:]
    a = np.moveaxis(rows[:, n], 0, -1)
    return a, np.moveaxis(back, (0, 1), (-2, -1)), log_determinant


def _extended_rows(jacobian: ndarray, v: ndarray) -> ndarray:
    """Return [J | v] (m, n + 1, ...) with the batch axes last, which is several times as fast for
    small matrices.
    """
    m, n = jacobian.shape[-2:]
    batch = np.broadcast_shapes(jacobian.shape[:-2], v.shape[:-1])
    jacobian = np.broadcast_to(jacobian, (*batch, m, n))
    v = np.broadcast_to(v, (*batch, m))
    rows = np.empty((m, n + 1, *batch))
    rows[:, :n] = np.moveaxis(jacobian, (-2, -1), (0, 1))
    rows[:, n] = np.moveaxis(v, -1, 0)
    return rows


def _eliminate(rows: ndarray) -> None:
    """Replace [J | X] (m, n + k, ...) by L⁻¹P[J | X] of PJ = LU with partial pivoting."""
    for k in range(len(rows)):
        greatest = k + np.abs(rows[k:, k]).argmax(axis=0)
        for i in range(k + 1, len(rows)):
            swap = greatest == i
            upper = np.where(swap, rows[i], rows[k])
            lower = np.where(swap, rows[k], rows[i])
            rows[k], rows[i] = upper, lower
        below = rows[k + 1 :]
        multipliers = below[:, k] / rows[k, k]
        below -= multipliers[:, None] * rows[k]
        below[:, k] = 0.0  # exactly


def orthonormalize(rows: ndarray, n: int) -> ndarray:
    """Replace ``rows`` [J | X] (m, n + k, ...) by R⁻ᵀ[J | X] of J = RᵀQᵀ, by modified Gram–Schmidt
    of the first ``n`` columns, the diagonal of R positive; return ln det R (...,).
    """
    log_determinant = np.zeros(rows.shape[2:])
    for k in range(len(rows)):
        row = rows[k]
        below = rows[k + 1 :]
        length = np.sqrt((row[:n] ** 2).sum(axis=0))
        row /= length
        along = (below[:, :n] * row[:n]).sum(axis=1)
        below -= along[:, None] * row
        log_determinant += np.log(length)
    return log_determinant


def frames(a: ndarray) -> ndarray:
    """(..., m, m) orthonormal matrices with the first column a/‖a‖, ``a`` (..., m) not zero:
    Householder's reflection times −sign(a₁).
    """
    r = np.sqrt(np.vecdot(a, a))
    first = a[..., 0]
    sign = np.where(first < 0, -1.0, 1.0)
    mirror = a.copy()
    mirror[..., 0] += sign * r
    half_square = r * (r + np.abs(first))
    outer = mirror[..., :, None] * mirror[..., None, :]
    reflection = np.eye(a.shape[-1]) - outer / half_square[..., None, None]
    return -sign[..., None, None] * reflection
