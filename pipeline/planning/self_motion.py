"""The poses of the joints that carry the tip to a pose of the path, as a grid.

With one joint more than task rows they are curves, one a branch (elbow up and down, wrist turned
over), closed unless it ends at a singular pose or a joint's limit. A curve is followed along the
null space of J, a spacing at a time, each point brought back to the path by Newton's method; limits
and margin cut it last, so that they part no branch. Newton's method from spread poses (a Halton
sequence within the limits) gives the starts; every solution that no curve passes begins another.
With as many joints as rows the curves are points.
"""

from __future__ import annotations

import numpy as np

from pipeline.planning.problem import InfeasibleError, Problem, inverses, length_of, settle

STARTS, ALL = 32, 256  # poses at which Newton's method begins, a step; where those find nothing
ROUNDS, CORRECTIONS = 40, 6  # of Newton's method, from a start and along a curve
COARSE = 0.25  # rad, the spacing at which the length of the curves is taken
SAME = 1e-4  # rad, between two solutions that are one
LONGEST, PILOTS = 4000, 5  # points of a curve; steps at which its length is taken
TOGETHER = 32  # curves that are followed in one batch, where the time of a call itself is small


def stages(problem: Problem, spacing: float, spacings: float) -> np.ndarray:
    """(S,) steps of the path, its first and last among them, so far apart that the slowest joint
    moves by ``spacings`` of the ``spacing`` in between.

    On a grid that is wide beside a step of the joints no pose could be left within one step.
    """
    last, slowest = len(problem.steps), problem.reach.min()
    wide = 1 if problem.spare == 0 else int(np.ceil(spacings * spacing / slowest))
    count = -(-last // min(max(wide, 1), last))
    return np.round(np.linspace(0, last, count + 1)).astype(int)


def spacing_of(problem: Problem, points: int) -> float:
    """The spacing in rad at which the curves within limits and margin have ``points`` points at
    the step of a few where they are longest.
    """
    if problem.spare == 0:
        return 0.0
    pilots = np.unique(np.linspace(0, len(problem.steps), PILOTS).round().astype(int))
    most = max(len(poses) for poses in curves(problem, pilots, COARSE))
    return COARSE * max(most, 1) / points


def grid(problem: Problem, steps: np.ndarray, spacing: float) -> list[np.ndarray]:
    """Return the poses (G, n) in rad of the whole curves at the ``spacing`` in rad, at each of the
    ``steps`` (S,).

    Raises InfeasibleError with the first step of the path that has no pose, and why.
    """
    poses = curves(problem, steps, spacing)
    for s in [s for s, solutions in enumerate(poses) if len(solutions) == 0]:
        between = np.arange(steps[max(s - 1, 0)], steps[s] + 1)
        sought = curves(problem, between, spacing, ALL)
        for step, solutions in zip(between, sought, strict=True):
            if len(solutions) == 0:
                raise _no_pose(problem, int(step))
        poses[s] = sought[-1]
    return poses


def curves(
    problem: Problem, steps: np.ndarray, spacing: float, count: int = STARTS
) -> list[np.ndarray]:
    """For each of ``steps`` (S,) the points (G, n) in rad, ``spacing`` apart, of the curves that
    ``count`` starts lead to, within limits and margin, whole turns taken off.
    """
    targets = problem.path[steps]
    solutions, waiting = _solutions(problem, steps, count)
    passed = [solutions[s, :0] for s in range(len(steps))]
    while waiting.any():
        several = max(TOGETHER // int(waiting.any(axis=1).sum()), 1)
        lanes, starts = np.nonzero(waiting & (np.cumsum(waiting, axis=1) <= several))
        followed = _follow(problem, solutions[lanes, starts], targets[lanes], spacing)
        for lane, start, points in zip(lanes, starts, followed, strict=True):
            if not waiting[lane, start]:  # the curve of an earlier start passes it
                continue
            passed[lane] = np.concatenate([passed[lane], points])
            open_ = np.flatnonzero(waiting[lane])
            apart = problem.less_turns(solutions[lane, open_, None] - points)
            waiting[lane, open_] = length_of(apart).min(axis=1) > max(1.5 * spacing, SAME)
    q = problem.nearest_turns(np.concatenate(passed))
    kept = problem.chain.within_limits(q)
    kept[kept] = problem.clear(q[kept])
    ends = np.cumsum([len(each) for each in passed])[:-1]
    parts = zip(np.split(q, ends), np.split(kept, ends), strict=True)
    return [part[good] for part, good in parts]


def _solutions(problem: Problem, steps: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(S, count, n) results of Newton's method from spread poses within the limits, or within a
    turn where a joint has none, at each of ``steps`` (S,), and (S, count) True of a solution.
    """
    from scipy.stats.qmc import Halton

    chain = problem.chain
    unbounded = ~np.isfinite(chain.upper - chain.lower)
    low = np.where(unbounded, -np.pi, chain.lower)
    high = np.where(unbounded, np.pi, chain.upper)
    sequence = Halton(len(low), scramble=False).fast_forward(1)
    begin = np.tile(low + (high - low) * sequence.random(count), (len(steps), 1))
    targets = np.repeat(problem.path[steps], count, axis=0)
    solutions, reached = settle(chain, begin, targets, ROUNDS)
    return solutions.reshape(len(steps), count, -1), reached.reshape(len(steps), count)


def _follow(
    problem: Problem, begun: np.ndarray, targets: np.ndarray, spacing: float
) -> list[np.ndarray]:
    """For each lane the points (·, n) of the curve through ``begun`` (L, n) over ``targets``."""
    if problem.spare == 0:
        return [q[None] for q in begun]
    tangent = np.linalg.svd(problem.chain.jacobian(begun))[2][:, -1]
    points, closed = _one_way(problem, begun, targets, tangent, spacing)
    ended = np.flatnonzero(~closed)
    backward, _ = _one_way(problem, begun[ended], targets[ended], -tangent[ended], spacing)
    for lane, more in zip(ended, backward, strict=True):
        points[lane] += more
    return [np.stack([q, *each]) for q, each in zip(begun, points, strict=True)]


def _one_way(
    problem: Problem, begun: np.ndarray, targets: np.ndarray, tangent: np.ndarray, spacing: float
) -> tuple[list[list[np.ndarray]], np.ndarray]:
    """For each lane the points (n,) behind ``begun`` (L, n) in the direction of ``tangent`` (L,
    n), and (L,) True where the curve came back.
    """
    chain = problem.chain
    q, tangent, closed = begun.copy(), tangent.copy(), np.zeros(len(begun), dtype=bool)
    points, lanes = [[] for _ in begun], np.arange(len(begun))
    for count in range(LONGEST):
        if len(lanes) == 0:
            break
        new, good = settle(chain, q[lanes] + spacing * tangent[lanes], targets[lanes], CORRECTIONS)
        within = (new >= chain.lower) & (new <= chain.upper)
        good &= np.all(within | problem.comes_round, axis=-1)
        inverse, regular = inverses(chain, new[good])
        lanes, new = lanes[good][regular], new[good][regular]
        along = tangent[lanes]
        along -= np.matvec(inverse, np.matvec(chain.jacobian(new), along))
        length = length_of(along)
        # a turn of more than a right angle or a long jump is another curve's
        same = (length > 0.5) & (length_of(new - q[lanes]) < 2 * spacing)
        away = length_of(problem.less_turns(new - begun[lanes]))
        back = (count > 1) & (away < 0.75 * spacing)
        closed[lanes[same & back]] = True
        on = same & ~back
        lanes, new = lanes[on], new[on]
        q[lanes], tangent[lanes] = new, (along / length[:, None])[on]
        for lane, point in zip(lanes, new, strict=True):
            points[lane].append(point)
    return points, closed


def _no_pose(problem: Problem, step: int) -> InfeasibleError:
    """Why the path has no pose at ``step``."""
    chain = problem.chain
    solutions, reached = _solutions(problem, np.array([step]), ALL)
    q = problem.nearest_turns(solutions[reached])
    if len(q) == 0:
        why = "the arm does not reach the pose of the path; check its frame and its units"
    elif not chain.within_limits(q).any():
        why = "the arm reaches the pose of the path beyond its joint limits alone"
    else:
        best = float(problem.clearance(q[chain.within_limits(q)]).max())
        why = (
            f"the arm reaches the pose of the path with a least singular value of {best:.3g} m at "
            f"most, below the margin of {problem.margin:g} m"
        )
    return InfeasibleError(why, step=step)
