"""The root of λ(s) = λ (:mod:`.bound`): the place of the optimum for a given weight.

Newton's steps are those of 1/(λ(∞) − λ(s)), a straight line in s where A has one singular value and
no bound is met (as those of Moré and Sorensen, SIAM J. Sci. Stat. Comput. 4, 1983). Halvings of
what the signs have not ruled out take their place where they leave it, or turn about a bend.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import inner
from pipeline.models.wishart.bound import PULL, place

# last step of s and what is left of λ, as shares: the next error is of the size of their squares
SETTLED = 1e-6
HALVED = 1e-14  # share of s below which halving ends
WIDER = 8.0  # factor of a step towards a side that is open
LEAST_GUESS = 1e-10  # of s, as a share of the trace of AᵀA


@inner
def root(
    ratio: float,
    delta: float,
    across: float,
    least: float,
    most: float,
    steps: int,
    squares: np.ndarray,
    room: np.ndarray,
) -> float:
    """c where λ(s) is ``ratio``, and y there in ``room``; −1 where that was not reached in
    ``steps``.

    Args:
        ratio: λ.
        delta: δ.
        across: ‖ω⊥‖².
        least: λ(0), negative where y breaks the bound at s = 0.
        most: λ(∞).
        steps: of Newton's method or halvings, at most.
        squares: (3, m, m) as of :func:`.bound.place`.
        room: (ROWS, m) likewise.
    """
    low, high, longest = 0.0, np.inf, np.inf
    s = guess(ratio, max(least, 0.0), most, squares[0], room[PULL])
    for _ in range(steps):
        _, weight, growth = place(s, delta, across, squares, room)
        if weight >= ratio:
            high = s
        else:
            low = s
        following = s + (ratio - weight) * (most - weight) / ((most - ratio) * growth)
        move = abs(following - s)
        settled = move <= SETTLED * s and abs(weight - ratio) <= SETTLED * ratio
        # each step is at most half of the one before: else they could turn about a bend of λ(s)
        if not settled and not (low <= following <= high and 0 < move <= longest / 2):
            if low == 0.0:
                following = s / WIDER
            elif high == np.inf:
                following = s * WIDER
            else:
                following = np.sqrt(low * high)
                settled = high - low <= HALVED * high
        longest, s = abs(following - s), following
        if settled:
            return place(s, delta, across, squares, room)[0]
    return -1.0


@inner
def guess(ratio: float, least: float, most: float, gram: np.ndarray, pull: np.ndarray) -> float:
    """Where λ(s) would be ``ratio`` if it were most − k/(s + b): with its ends, and its decline
    from s = ∞ without the bound.
    """
    m, trace, square, bend = len(pull), 0.0, 0.0, 0.0
    for i in range(m):
        image = gram[i, i] * pull[i]
        for j in range(i):
            image += 2 * gram[i, j] * pull[j]
        trace += gram[i, i]
        square += pull[i] * pull[i]
        bend += pull[i] * image
    decline = most * (bend / square - most * most)
    s = decline * (1 / (most - ratio) - 1 / (most - least))
    return s if LEAST_GUESS * trace < s < np.inf else LEAST_GUESS * trace
