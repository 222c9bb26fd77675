"""The factors of J = J₁J₂ (Eq. LUDecom) for whole batches of Jacobians, by row operations on
[J | v].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.commands import task_step
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.reduction import eliminate, orthonormalize

# A pivot of LU without pivoting is small below this share of the length of what is left of its row.
# The noise grows as the inverse of its square. In the natural orders the first pivot is the height
# of the tip above the first joint: it vanishes where they are level, a pose that means nothing to
# the arm.
PIVOT = 1e-2


class Factors(NamedTuple):
    """What a model needs of J = J₁J₂."""

    a: np.ndarray  # (..., m) J₁⁻¹v
    back: np.ndarray  # (..., n, m) J₂⁺
    log_determinant: np.ndarray  # (...,) ½ ln det J₂J₂ᵀ, which is ln|det J₂| where m = n


def split(jacobian: np.ndarray, v: np.ndarray, decomposition: Decomposition) -> Factors:
    """The factors, Eq. (LUDecom), of ``jacobian`` J (..., m, n) for the task step ``v`` (..., m);
    the leading axes of both broadcast.

    NaN where a pivot of ``lu`` is small (see :data:`PIVOT`); not finite or meaningless where J has
    not full row rank, about which the caller has to ask first.
    """
    m, n = jacobian.shape[-2:]
    decomposition.require_size(m, n)
    reduced = _augmented(jacobian, v[..., None])
    with np.errstate(divide="ignore", invalid="ignore"):
        _reduce(reduced, n, decomposition)
        second = np.zeros((m, n + m, *reduced.shape[2:]))
        second[:, :n] = reduced[:, :n]
        second[np.arange(m), n + np.arange(m)] = 1.0
        log_determinant = orthonormalize(second, n)
        # J₂ = R'ᵀQ'ᵀ, so that J₂⁺ = Q'R'⁻ᵀ
        back = np.zeros((n, m, *reduced.shape[2:]))
        for row in second:
            back += row[:n, None] * row[None, n:]
    return Factors(
        np.moveaxis(reduced[:, n], 0, -1), np.moveaxis(back, (0, 1), (-2, -1)), log_determinant
    )


def _augmented(jacobian: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(m, n + k, ...) [J | X] with the batch last, of ``jacobian`` (..., m, n) and ``right`` X
    (..., m, k).
    """
    batch = np.broadcast_shapes(jacobian.shape[:-2], right.shape[:-2])
    m, n = jacobian.shape[-2:]
    result = np.empty((m, n + right.shape[-1], *batch))
    for part, columns in ((jacobian, slice(0, n)), (right, slice(n, None))):
        whole = np.broadcast_to(part, (*batch, *part.shape[-2:]))
        result[:, columns] = np.moveaxis(whole, (-2, -1), (0, 1))
    return result


def _reduce(rows: np.ndarray, n: int, decomposition: Decomposition) -> np.ndarray | None:
    """Make of ``rows`` [J | v] (m, n + 1, ...), in place, J₁⁻¹[J | v] = [J₂ | a]; for LU without
    pivoting the shares (m, ...) of its pivots.
    """
    name = decomposition.name
    if name == "given":
        rows[:] = np.tensordot(np.linalg.inv(np.array(decomposition.left)), rows, axes=1)
    elif name == "qr_transposed":
        orthonormalize(rows, n)
    elif name == "pivoted_lu":
        eliminate(rows, range(n), exchange=True)
    elif name == "lu":
        if decomposition.rows is not None:
            rows[:] = rows[list(decomposition.rows)]
        shares = eliminate(rows, decomposition.order or range(n), exchange=False)
        rows[:, :, ~np.all(shares >= PIVOT, axis=0)] = np.nan
        return shares
    return None


def factors(
    chain: Mechanism, q: np.ndarray, v: np.ndarray, decomposition: Decomposition
) -> Factors:
    """The factors, Eq. (LUDecom), at joint angles ``q`` (..., n) in rad for the command ``v``, (m,)
    or (..., m) or longer, of which the first m numbers are the task step.

    Raises SingularJacobianError, and ModelDomainError where a pivot of LU without pivoting is
    small.
    """
    chain.require_regular(q)
    result = split(chain.jacobian(q), task_step(chain, v), decomposition)
    bad = np.isnan(result.log_determinant)
    if not np.any(bad):
        return result
    index = tuple(int(i) for i in np.argwhere(bad)[0])
    pose = np.broadcast_to(q, (*bad.shape, q.shape[-1]))[index]
    rows = _augmented(chain.jacobian(pose), np.zeros((len(chain.task), 1)))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = _reduce(rows, len(pose), decomposition)
    first = int((~(shares >= PIVOT)).argmax())
    raise ModelDomainError(
        f"LU without pivoting meets a small pivot at {int(bad.sum())} pose(s), where its noise "
        "would grow without bound; name another order of rows or joints in the dataset's option "
        "elimination, or another decomposition in the model's option file",
        index=index,
        q=np.asarray(pose, dtype=float).round(4).tolist(),
        pivot=first + 1,
        share_of_its_row=float(f"{shares[first]:.3g}"),
        least_share=PIVOT,
    )
