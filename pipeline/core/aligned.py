"""Room for numbers that are computed four at once."""

from __future__ import annotations

import numpy as np

LINE = 8  # floats in a line of the processor's cache


def aligned(rows: int, size: int) -> np.ndarray:
    """(rows, size) floats, not set, from the start of a line of the processor's cache on: NumPy
    starts anywhere, and what is computed four at once would go across the lines' ends.
    """
    floats = np.empty(rows * size + LINE)
    first = -floats.ctypes.data % (8 * LINE) // 8
    return floats[first : first + rows * size].reshape(rows, size)
