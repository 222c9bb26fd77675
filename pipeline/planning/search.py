"""The cheapest way through a grid, by dynamic programming (Bellman, 1957)."""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import compiled

TURN = 2 * np.pi


@compiled
def cheapest(
    poses: np.ndarray,
    counts: np.ndarray,
    cost: np.ndarray,
    nominal: np.ndarray,
    reach: np.ndarray,
    weight: np.ndarray,
    turning: np.ndarray,
    before: np.ndarray,
    total: np.ndarray,
) -> int:
    """Find the ways to every pose of least Σ cost + Σ weight·‖q_{s+1} − q_s − nominal_s‖², no joint
    beyond its reach; return S, else the first stage that none reaches.

    Of poses that cost the same the one before wins. Poses before are tried by what they cost, and
    no longer than they can win: nothing is left out.

    Args:
        poses: (S, G, n) in rad.
        counts: (S,) how many of the G there are.
        cost: (S, G), infinite where a pose is not to be taken.
        nominal: (S-1, G, n) step without weight from each pose, in rad.
        reach: (S-1, n) greatest step of each joint, in rad.
        weight: (S-1,) of a squared step beyond the nominal one.
        turning: (n,) joints whose steps are taken up to whole turns.
        before: (S, G) written: the number of the pose before on the way to each.
        total: (S, G) written: the cost of that way, the pose's own with it.
    """
    stages, n = len(counts), poses.shape[2]
    for i in range(counts[0]):
        total[0, i] = cost[0, i]
    for s in range(stages):
        left = np.inf
        if s > 0:
            order = np.argsort(total[s - 1, : counts[s - 1]], kind="mergesort")
        for j in range(counts[s]):
            least = total[0, j] if s == 0 else np.inf
            own = cost[s, j]
            if s > 0 and own < np.inf:
                for place in order:
                    base = total[s - 1, place]
                    if not base < least:
                        break
                    value = base
                    for joint in range(n):
                        step = poses[s, j, joint] - poses[s - 1, place, joint]
                        if turning[joint]:
                            step -= TURN * np.floor(step / TURN + 0.5)
                        if abs(step) > reach[s - 1, joint]:
                            value = np.inf
                            break
                        beyond = step - nominal[s - 1, place, joint]
                        value += weight[s - 1] * beyond * beyond
                    if value < least:
                        least = value
                        before[s, j] = place
                total[s, j] = least + own
            elif s > 0:
                total[s, j] = np.inf
            left = min(left, total[s, j])
        if not left < np.inf:
            return s
    return stages


def way_to(last: int, before: np.ndarray) -> np.ndarray:
    """(S,) numbers of the poses on the way to the pose ``last`` of the last stage, by what
    :func:`cheapest` wrote of the poses ``before`` (S, G).
    """
    way = [last]
    for row in before[:0:-1]:
        way.append(int(row[way[-1]]))
    return np.array(way[::-1])
