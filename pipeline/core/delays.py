"""Angles between the rows of a log."""

import numpy as np


def delayed_angles(angles: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return ``angles`` (N, n) delayed by ``rows`` (n,) of any fraction, by cubic polynomials
    through four rows. Before the first row the angles rest, behind the last one their speed
    continues.
    """
    result = np.empty_like(angles, dtype=float)
    nodes = (-1, 0, 1, 2)
    last = len(angles) - 1
    for joint, delay in enumerate(rows):
        column = angles[:, joint]
        exact = np.arange(len(angles)) - delay
        row = np.floor(exact).astype(int)
        share = exact - row  # of the way to the next row
        final_step = column[last] - column[max(last - 1, 0)]
        delayed = np.zeros(len(angles))
        for node in nodes:
            factors = [(share - k) / (node - k) for k in nodes if k != node]
            weight = np.prod(factors, axis=0)
            place = row + node
            beyond = np.maximum(place - last, 0)
            value = column[np.clip(place, 0, last)] + beyond * final_step
            delayed += weight * value
        result[:, joint] = delayed
    return result
