"""The articulation of the arm in one point cloud: the pose of the least objective, by a Nelder–Mead
simplex; compiled.

The objective has kinks and jumps (a point that changes its segment changes a maximum), so a search
that only compares values is used.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import compiled, inner
from pipeline.perception.articulation_end import End, rank
from pipeline.perception.articulation_objective import Frame

MAX_STEPS = 2000


# Loops over four or five numbers, where array expressions would do: those take seconds more to
# compile.
@inner
def _copy(corner: np.ndarray, other: np.ndarray) -> None:
    for j in range(corner.size):
        corner[j] = other[j]


@inner
def _place(corner: np.ndarray, middle: np.ndarray, other: np.ndarray, factor: float) -> None:
    """``corner`` at middle + factor·(other − middle)."""
    for j in range(corner.size):
        corner[j] = middle[j] + factor * (other[j] - middle[j])


@inner
def _mean(corners: np.ndarray, middle: np.ndarray) -> None:
    """``middle`` of all ``corners`` but the last."""
    n = middle.size
    for j in range(n):
        total = 0.0
        for i in range(n):
            total += corners[i, j]
        middle[j] = total / n


@inner
def _extent(corners: np.ndarray) -> float:
    """Greatest distance from the first corner along any axis."""
    extent = 0.0
    for i in range(1, corners.shape[0]):
        for j in range(corners.shape[1]):
            distance = abs(corners[i, j] - corners[0, j])
            extent = distance if distance > extent else extent
    return extent


@inner
def _order(corners: np.ndarray, values: np.ndarray) -> None:
    """Insertion sort in place: of a simplex mostly one corner changes, and equal ones stay in their
    order.
    """
    for i in range(1, values.size):
        place = i
        while place > 0 and values[place - 1] > values[place]:
            values[place - 1], values[place] = values[place], values[place - 1]
            for j in range(corners.shape[1]):
                corners[place - 1, j], corners[place, j] = corners[place, j], corners[place - 1, j]
            place -= 1


@compiled
def _simplex(
    frame: Frame,
    step: float,
    extent: float,
    corners: np.ndarray,
    values: np.ndarray,
    middle: np.ndarray,
    reflected: np.ndarray,
    tried: np.ndarray,
) -> bool:
    """One run of Nelder and Mead (1965), coefficients 1, 2, ½, ½, until the simplex is smaller than
    ``extent`` in every variable; whether it came to that.

    It begins at ``corners[0]`` of ``corners`` (n+1, n), and leaves the best there and its value in
    ``values[0]`` of ``values`` (n+1,); the other arrays (n,) are buffers. The values do not decide
    when to end: across a jump of the objective they never meet.
    """
    n = values.size - 1
    worst = corners[n]
    for i in range(1, n + 1):
        _copy(corners[i], corners[0])
        corners[i, i - 1] += step
    unknown = 0  # the first corner without a value
    for _ in range(MAX_STEPS):
        for i in range(unknown, n + 1):
            values[i] = rank(frame, corners[i])
        unknown = n + 1
        _order(corners, values)
        if _extent(corners) <= extent:
            return True
        at_worst = values[n]
        _mean(corners, middle)
        _place(reflected, middle, worst, -1.0)
        at_reflected = rank(frame, reflected)
        best, outside = at_reflected < values[0], at_reflected < at_worst
        if not best and at_reflected < values[n - 1]:
            _copy(worst, reflected)
            values[n] = at_reflected
            continue
        # expanded beyond the best, or contracted from what is hardly better than the worst
        _place(tried, middle, worst, -2.0 if best else (-0.5 if outside else 0.5))
        at_tried = rank(frame, tried)
        if at_tried < at_reflected and at_tried < at_worst:
            _copy(worst, tried)
            values[n] = at_tried
        elif best:
            _copy(worst, reflected)
            values[n] = at_reflected
        else:
            for i in range(1, n + 1):
                _place(corners[i], corners[0], corners[i], 0.5)
            unknown = 1
    return False


def fit_frame(frame: Frame, end: End, start: np.ndarray) -> tuple[np.ndarray, float, bool]:
    """(O2, O3, EE) (3, 2) in m, value, ended: Nelder–Mead from ``start`` (3, 2) over the variables
    of ``end``, and from near its end again, turned the other way, as the runs of ``end`` say.

    With the commanded end more runs lower the objective by about 0.1 mm and the error of the angles
    not at all; nor does a first run that goes on to the last extent, which takes 1.7 times as long.
    """
    first = end.variables(frame, start)
    n = first.size
    corners, values, buffers = np.empty((n + 1, n)), np.empty(n + 1), np.empty((3, n))
    corners[0], ended = first, False
    for step, extent in end.runs:
        ended = _simplex(frame, step, extent, corners, values, *buffers)
    return end.nodes(frame, corners[0]), float(values[0]), ended
