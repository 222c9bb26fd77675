"""The norm of matrices that the paper measures them by."""

from __future__ import annotations

import numpy as np


def frobenius(matrix: np.ndarray) -> np.ndarray:
    """(...,) Frobenius norm of ``matrix`` (..., n, n)."""
    return np.sqrt(np.einsum("...ij,...ij->...", matrix, matrix))
