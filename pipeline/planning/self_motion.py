"""Self-motion (joint motion at a fixed pose of the tip) for n = m + 1: a grid of poses.

The poses of a step form curves, one per branch (elbow up or down, wrist turned over). The curves
are closed or end at singular poses and joint limits. A curve is followed from every Newton solution
that is not on an earlier curve, in steps along the null space of J, corrected by Newton's method.
Limits and margin are applied last, so that they split no branch. For n = m the curves are points.
"""

import numpy as np
from numpy import ndarray

from pipeline.planning.problem import InfeasibleError, Problem, length_of, settle

STARTS, MORE_STARTS = (
    32,
    256,
)  # Newton starts of a step; starts if no solution was found
NEWTON_STEPS, CURVE_STEPS = 40, 6  # Newton steps from a start, and along a curve
STAGE_SPACINGS = (
    1.5  # spacings that the slowest joint can move between two stages of the search
)
COARSE_SPACING = 0.25  # rad, spacing at which the length of the curves is measured
SAME_POSE = 1e-4  # rad, greatest distance of equal solutions
LONGEST_CURVE, PILOT_STEPS = (
    4000,
    5,
)  # points of a curve; steps at which the length is measured


def stages(problem: Problem, spacing: float) -> ndarray:
    """(S,) steps of the path from first to last, so far apart that the slowest joint can move by
    STAGE_SPACINGS times ``spacing`` in between. Otherwise it could not leave a pose of the grid.
    """
    last = len(problem.steps)
    wide = int(np.ceil(STAGE_SPACINGS * spacing / problem.reach.min()))
    count = -(-last // min(max(wide, 1), last))
    return np.round(np.linspace(0, last, count + 1)).astype(int)


def spacing_of(problem: Problem, points: int) -> float:
    """Spacing in rad at which the longest curves of a few steps have ``points`` points."""
    if problem.spare == 0:
        return 0.0
    pilots = np.unique(
        np.linspace(0, len(problem.steps), PILOT_STEPS).round().astype(int)
    )
    most = max(map(len, curves(problem, pilots, COARSE_SPACING)))
    return COARSE_SPACING * max(most, 1) / points


def grid(problem: Problem, steps: ndarray, spacing: float) -> list[ndarray]:
    """Return the poses (G, n) in rad of all curves at each of the ``steps`` (S,), ``spacing`` rad
    apart. Raises InfeasibleError with the first step of the path that has no pose.
    """
    poses = curves(problem, steps, spacing)
    for s in [s for s, solutions in enumerate(poses) if len(solutions) == 0]:
        for step in range(steps[max(s - 1, 0)], steps[s] + 1):
            (poses[s],) = curves(problem, np.array([step]), spacing, MORE_STARTS)
            if len(poses[s]) == 0:
                why = "check the path's frame and units: the arm does not reach the pose within "
                why += "its joint limits, or only with a least singular value below the margin of "
                raise InfeasibleError(f"{why}{problem.margin:g} m", step=step)
    return poses


def curves(
    problem: Problem, steps: ndarray, spacing: float, count: int = STARTS
) -> list[ndarray]:
    """Points (G, n) in rad, ``spacing`` apart, of the curves at each of ``steps`` (S,), within
    limits and margin and without whole turns. Newton's method starts at ``count`` poses within the
    limits (±π without limits).
    """
    from scipy.stats.qmc import Halton

    chain, targets = problem.chain, problem.path[steps]
    bounded = np.isfinite(chain.upper - chain.lower)
    low, high = np.where(bounded, [chain.lower, chain.upper], [[-np.pi], [np.pi]])
    shares = Halton(len(low), scramble=False).fast_forward(1).random(count)
    begin = np.tile(low + (high - low) * shares, (len(steps), 1))
    found, reached = settle(
        chain, begin, np.repeat(targets, count, axis=0), NEWTON_STEPS
    )
    solutions, waiting = (
        part.reshape(len(steps), count, -1) for part in (found, reached)
    )
    waiting, curve_points = waiting[..., 0], [each[:0] for each in solutions]
    while waiting.any():
        lanes = np.flatnonzero(waiting.any(axis=1))
        starts = solutions[lanes, waiting[lanes].argmax(axis=1)]
        followed = _follow(problem, starts, targets[lanes], spacing)
        for lane, points in zip(lanes, followed, strict=True):
            curve_points[lane] = np.concatenate([curve_points[lane], points])
            left = np.flatnonzero(waiting[lane])
            apart = problem.less_turns(solutions[lane, left, None] - points)
            waiting[lane, left] = length_of(apart).min(axis=1) > max(
                1.5 * spacing, SAME_POSE
            )
    poses = map(problem.nearest_turns, curve_points)
    return [q[chain.within_limits(q) & problem.clear(q)] for q in poses]


def _follow(
    problem: Problem, starts: ndarray, targets: ndarray, spacing: float
) -> list[ndarray]:
    """Points (·, n) of the curves through the poses ``starts`` (L, n), the tip at ``targets``."""
    points, chain = [[q] for q in starts], problem.chain
    closed = np.zeros(len(starts), dtype=bool)
    for way in (1.0, -1.0) if problem.spare > 0 else ():
        q, tangent = (
            starts.copy(),
            way * np.linalg.svd(chain.jacobian(starts))[2][:, -1],
        )
        lanes = np.flatnonzero(~closed)
        for count in range(LONGEST_CURVE):
            if len(lanes) == 0:
                break
            ahead = q[lanes] + spacing * tangent[lanes]
            new, good = settle(chain, ahead, targets[lanes], CURVE_STEPS)
            within = (new >= chain.lower) & (new <= chain.upper)
            good &= np.all(within | problem.comes_round, axis=-1) & ~chain.singular(new)
            lanes, new = lanes[good], new[good]
            along, jacobian = tangent[lanes], chain.jacobian(new)
            along -= np.matvec(chain.inverse_jacobian(new), np.matvec(jacobian, along))
            length = length_of(along)
            # a larger change of direction or a longer step leads to another curve
            same = (length > 0.5) & (length_of(new - q[lanes]) < 2 * spacing)
            away = length_of(problem.less_turns(new - starts[lanes]))
            back = (count > 1) & (away < 0.75 * spacing)
            closed[lanes[same & back]] = True
            on = same & ~back
            lanes, new = lanes[on], new[on]
            q[lanes], tangent[lanes] = new, (along / length[:, None])[on]
            for lane, point in zip(lanes, new, strict=True):
                points[lane].append(point)
    return [np.stack(each) for each in points]
