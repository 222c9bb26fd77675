"""The poses of the joints that carry the tip to a pose of the path, as a grid.

With one joint more than task rows they are curves, one a branch (elbow up and down, wrist turned
over), closed unless it ends at a singular pose or a joint's limit. A curve is followed along the
null space of J, a spacing at a time, each point brought back to the path by Newton's method; limits
and margin cut it last, so that they part no branch. Newton's method from spread poses (a Halton
sequence within the limits) gives the starts; every solution that no curve passes begins another.
With as many joints as rows the curves are points.
"""

import numpy as np

from pipeline.planning.problem import InfeasibleError, Problem, length_of, settle

STARTS, ALL = 32, 256  # poses at which Newton's method begins, a step; where those find nothing
ROUNDS, CORRECTIONS = 40, 6  # of Newton's method, from a start and along a curve
SPACINGS = 1.5  # that the slowest joint can move from one stage of the search to the next
COARSE = 0.25  # rad, the spacing at which the length of the curves is taken
SAME = 1e-4  # rad, between two solutions that are one
LONGEST, PILOTS = 4000, 5  # points of a curve; steps at which its length is taken
TOGETHER = 32  # curves that are followed in one batch, where the time of a call itself is small


def stages(problem: Problem, spacing: float) -> np.ndarray:
    """(S,) steps of the path, its first and last among them, so far apart that the slowest joint
    moves by SPACINGS of the ``spacing`` in between: nearer, no pose of the grid could be left.
    """
    last, slowest = len(problem.steps), problem.reach.min()
    wide = 1 if problem.spare == 0 else int(np.ceil(SPACINGS * spacing / slowest))
    count = -(-last // min(max(wide, 1), last))
    return np.round(np.linspace(0, last, count + 1)).astype(int)


def spacing_of(problem: Problem, points: int) -> float:
    """The spacing in rad at which the curves have ``points`` points, at most of a few steps."""
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
        for step in range(steps[max(s - 1, 0)], steps[s] + 1):
            (poses[s],) = curves(problem, np.array([step]), spacing, ALL)
            if len(poses[s]) == 0:
                raise _no_pose(problem, step)
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
    kept = [problem.nearest_turns(points) for points in passed]
    kept = [q[problem.chain.within_limits(q)] for q in kept]
    return [q[problem.clear(q)] for q in kept]


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
    points, chain = [[q] for q in begun], problem.chain
    if problem.spare == 0:
        return [np.stack(each) for each in points]
    closed = np.zeros(len(begun), dtype=bool)
    for way in (1.0, -1.0):
        q, tangent = begun.copy(), way * np.linalg.svd(chain.jacobian(begun))[2][:, -1]
        lanes = np.flatnonzero(~closed)
        for count in range(LONGEST):
            if len(lanes) == 0:
                break
            ahead = q[lanes] + spacing * tangent[lanes]
            new, good = settle(chain, ahead, targets[lanes], CORRECTIONS)
            within = (new >= chain.lower) & (new <= chain.upper)
            good &= np.all(within | problem.comes_round, axis=-1) & ~chain.singular(new)
            lanes, new = lanes[good], new[good]
            along, jacobian = tangent[lanes], chain.jacobian(new)
            along -= np.matvec(chain.inverse_jacobian(new), np.matvec(jacobian, along))
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
    return [np.stack(each) for each in points]


def _no_pose(problem: Problem, step: int) -> InfeasibleError:
    """Why the path has no pose at ``step``."""
    chain = problem.chain
    solutions, reached = _solutions(problem, np.array([step]), ALL)
    q = problem.nearest_turns(solutions[reached])
    within = q[chain.within_limits(q)]
    if len(q) == 0:
        why = "the arm does not reach the pose of the path; check its frame and its units"
    elif len(within) == 0:
        why = "the arm reaches the pose of the path beyond its joint limits alone"
    else:
        why = (
            "the arm reaches the pose of the path with a least singular value of "
            f"{chain.least_singular_value(within).max():.3g} m at most, below the margin of "
            f"{problem.margin:g} m"
        )
    return InfeasibleError(why, step=step)
