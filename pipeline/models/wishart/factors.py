"""The factors of J = J₁J₂ (Eq. LUDecom) for whole batches of Jacobians, by row operations on the
augmented matrices [J | v].

The models need of a decomposition the commanded step seen by the perturbation matrix, a = J₁⁻¹v,
the way back to the joints, J₂⁺ = J₂ᵀ(J₂J₂ᵀ)⁻¹, and the volume of J₂. The batch comes last, so that
each entry is contiguous over it: several times as fast for matrices this small.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arm.interface import Mechanism
from pipeline.models.model import task_step
from pipeline.models.wishart.decomposition import Decomposition


class Factors(NamedTuple):
    """Parts of J = J₁J₂ that a model needs."""

    a: np.ndarray  # (..., m) J₁⁻¹v
    back: np.ndarray  # (..., n, m) J₂⁺
    log_determinant: np.ndarray  # (...,) ½ ln det J₂J₂ᵀ, which is ln|det J₂| where m = n


def factors(
    chain: Mechanism, q: np.ndarray, v: np.ndarray, decomposition: Decomposition
) -> Factors:
    """The factors, Eq. (LUDecom), at joint angles ``q`` (..., n) in rad for the command ``v``, (m,)
    or (..., m) or longer, of which the first m numbers are the task step in m and rad.

    Raises SingularJacobianError.
    """
    chain.require_regular(q)
    return split(chain.jacobian(q), task_step(chain, v), decomposition)


def split(jacobian: np.ndarray, v: np.ndarray, decomposition: Decomposition) -> Factors:
    """The factors, Eq. (LUDecom), of ``jacobian`` J (..., m, n) for the task step ``v`` (..., m);
    the leading axes of both broadcast.

    Not finite or meaningless where J has not full row rank, which the caller has to exclude.
    """
    m, n = jacobian.shape[-2:]
    decomposition.require_size(m)
    batch = np.broadcast_shapes(jacobian.shape[:-2], v.shape[:-1])
    rows = np.empty((m, n + 1, *batch))
    rows[:, :n] = np.moveaxis(np.broadcast_to(jacobian, (*batch, m, n)), (-2, -1), (0, 1))
    rows[:, n] = np.moveaxis(np.broadcast_to(v, (*batch, m)), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        _reduce(rows, n, decomposition)
        second = np.zeros((m, n + m, *batch))
        second[:, :n] = rows[:, :n]
        second[np.arange(m), n + np.arange(m)] = 1.0
        log_determinant = orthonormalize(second, n)
        # J₂ = R'ᵀQ'ᵀ, so that J₂⁺ = Q'R'⁻ᵀ
        back = np.zeros((n, m, *batch))
        for row in second:
            back += row[:n, None] * row[None, n:]
    return Factors(
        np.moveaxis(rows[:, n], 0, -1), np.moveaxis(back, (0, 1), (-2, -1)), log_determinant
    )


def _reduce(rows: np.ndarray, n: int, decomposition: Decomposition) -> None:
    """Make of ``rows`` [J | v] (m, n + 1, ...), in place, J₁⁻¹[J | v] = [J₂ | a]."""
    if decomposition.name == "given":
        rows[:] = np.tensordot(np.linalg.inv(np.array(decomposition.left)), rows, axes=1)
    elif decomposition.name == "qr_transposed":
        orthonormalize(rows, n)
    elif decomposition.name == "pivoted_lu":
        eliminate(rows)


def eliminate(rows: np.ndarray) -> None:
    """Make of ``rows`` [J | X] (m, n + k, ...), in place, L⁻¹P[J | X] of PJ = LU.

    Gaussian elimination with partial pivoting: each pivot is the greatest entry left in its column.
    """
    for k in range(len(rows)):
        greatest = k + np.abs(rows[k:, k]).argmax(axis=0)
        for i in range(k + 1, len(rows)):
            here = greatest == i
            rows[k], rows[i] = np.where(here, rows[i], rows[k]), np.where(here, rows[k], rows[i])
        multiples = rows[k + 1 :, k] / rows[k, k]
        rows[k + 1 :] -= multiples[:, None] * rows[k]
        rows[k + 1 :, k] = 0.0  # zero but for rounding


def orthonormalize(rows: np.ndarray, n: int) -> np.ndarray:
    """Make of ``rows`` [J | X] (m, n + k, ...), in place, R⁻ᵀ[J | X] of the QR decomposition of Jᵀ,
    J = RᵀQᵀ; return ln det R (...,).

    Modified Gram–Schmidt of the first ``n`` columns, the diagonal of R positive. Where J has not m
    independent rows the result is not finite or meaningless.
    """
    log_determinant = np.zeros(rows.shape[2:])
    for k in range(len(rows)):
        length = np.sqrt((rows[k, :n] ** 2).sum(axis=0))
        rows[k] /= length
        along = (rows[k + 1 :, :n] * rows[k, :n]).sum(axis=1)
        rows[k + 1 :] -= along[:, None] * rows[k]
        log_determinant += np.log(length)
    return log_determinant
