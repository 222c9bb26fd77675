"""Row operations on batches of augmented matrices [J | X]: they apply J₁⁻¹ of J = J₁J₂ to both
parts.

The batch comes last, so that each entry is contiguous over it: several times as fast for matrices
this small. J has m rows and n ≥ m columns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def eliminate(rows: np.ndarray, order: Sequence[int], *, exchange: bool) -> np.ndarray:
    """Make of ``rows`` [J | X] (m, n + k, ...), in place, L⁻¹P[J | X] of PJ = LU; the share (m,
    ...) that each pivot has of the length of what is left of its row of J.

    Gaussian elimination of the n columns of J in their ``order``. With ``exchange`` each pivot is
    the greatest of what is left of its column (partial pivoting); without it P = I. The share of a
    pivot does not depend on the unit of its row. Where a pivot is zero the result is not finite.
    """
    shares = np.empty((len(rows), *rows.shape[2:]))
    left = list(order)
    for k in range(len(rows)):
        column = left[0]
        if exchange:
            greatest = k + np.abs(rows[k:, column]).argmax(axis=0)
            for i in range(k + 1, len(rows)):
                here = greatest == i
                rows[k], rows[i] = (
                    np.where(here, rows[i], rows[k]),
                    np.where(here, rows[k], rows[i]),
                )
        shares[k] = np.abs(rows[k, column]) / _length(rows[k, left])
        multiples = rows[k + 1 :, column] / rows[k, column]
        rows[k + 1 :] -= multiples[:, None] * rows[k]
        rows[k + 1 :, column] = 0.0  # what elimination made zero up to rounding
        left = left[1:]
    return shares


def orthonormalize(rows: np.ndarray, n: int) -> np.ndarray:
    """Make of ``rows`` [J | X] (m, n + k, ...), in place, R⁻ᵀ[J | X] of the QR decomposition of Jᵀ,
    J = RᵀQᵀ; ln det R (...,).

    Modified Gram–Schmidt of the first ``n`` columns, the diagonal of R positive. Where J has not m
    independent rows the result is not finite or meaningless.
    """
    log_determinant = np.zeros(rows.shape[2:])
    for k in range(len(rows)):
        length = _length(rows[k, :n])
        rows[k] /= length
        along = (rows[k + 1 :, :n] * rows[k, :n]).sum(axis=1)
        rows[k + 1 :] -= along[:, None] * rows[k]
        log_determinant += np.log(length)
    return log_determinant


def _length(entries: np.ndarray) -> np.ndarray:
    """(...,) of the row of ``entries`` (n, ...)."""
    return np.sqrt((entries**2).sum(axis=0))
