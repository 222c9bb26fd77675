"""Singular values and vectors of a small matrix by one-sided Jacobi rotations (Hestenes, J. SIAM 6,
1958), for compiled code.

Small singular values come out as exact, relative to themselves, as the scaling of the columns
allows (Demmel and Veselić, SIAM J. Matrix Anal. Appl. 13, 1992). An eigen-decomposition of MᵀM
would lose those below 1e-8 of the greatest, and noise far below the size of a step has such.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import inner

SWEEPS = 30  # at most; four to six are usual
# cosine between two columns below which they count as orthogonal
ORTHOGONAL = 4 * float(np.finfo(float).eps)


@inner
def orthogonalize(columns: np.ndarray, turn: np.ndarray) -> None:
    """Rotate the ``columns`` (k, n) of M (n, k), in place, until they are orthogonal: their lengths
    are then the singular values, their directions the left vectors.

    The columns of ``turn`` (k, m) are rotated alike. Begun as I (k, k) it ends with the right
    vectors in its rows: M = Σ columnsᵢ·turnᵢᵀ.
    """
    count, length, width = len(columns), columns.shape[1], turn.shape[1]
    for _ in range(SWEEPS):
        settled = True
        for p in range(count - 1):
            for q in range(p + 1, count):
                square_p = square_q = product = 0.0
                for i in range(length):
                    x, y = columns[p, i], columns[q, i]
                    square_p += x * x
                    square_q += y * y
                    product += x * y
                if abs(product) <= ORTHOGONAL * np.sqrt(square_p * square_q):
                    continue
                settled = False
                zeta = (square_q - square_p) / (2 * product)
                tangent = np.copysign(1 / (abs(zeta) + np.sqrt(1 + zeta * zeta)), zeta)
                cosine = 1 / np.sqrt(1 + tangent * tangent)
                sine = cosine * tangent
                for i in range(length):
                    x, y = columns[p, i], columns[q, i]
                    columns[p, i] = cosine * x - sine * y
                    columns[q, i] = sine * x + cosine * y
                for i in range(width):
                    x, y = turn[p, i], turn[q, i]
                    turn[p, i] = cosine * x - sine * y
                    turn[q, i] = sine * x + cosine * y
        if settled:
            return
