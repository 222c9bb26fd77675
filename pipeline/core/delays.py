"""Angles between the rows of a log."""

import numpy as np


def delayed_angles(angles: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return ``angles`` (N, n) delayed by ``rows`` (n,) of any fraction, by cubic polynomials
    through four rows. Before the first row the angles rest, behind the last one their speed
    continues.
    """
    result = np.empty_like(angles, dtype=float)
    near, last = (-1, 0, 1, 2), len(angles) - 1
    for j, late in enumerate(rows):
        place = np.arange(len(angles)) - late
        row = np.floor(place).astype(int)
        part = place - row
        final_step = angles[last, j] - angles[max(last - 1, 0), j]
        column = np.zeros(len(angles))
        for i in near:
            weight = np.prod([(part - k) / (i - k) for k in near if k != i], axis=0)
            beyond = np.maximum(row + i - last, 0)
            value = angles[np.clip(row + i, 0, last), j] + beyond * final_step
            column += weight * value
        result[:, j] = column
    return result
