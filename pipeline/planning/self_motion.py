"""Self-motion (joint motion at a fixed pose of the tip) for n = m + 1: a grid of poses for the
global search, and the local refinement of a motion.

The poses of a step form curves, one per branch (elbow up or down, wrist turned over). The curves
are closed or end at singular poses and joint limits. A curve is followed from every Newton solution
that is not on an earlier curve, in steps along the null space of J, corrected by Newton's method.
Limits and margin are applied last, so that they split no branch. For n = m the curves are points.

The refinement displaces the motion q⁰ by ζ_k in the null space of J at each step k. q_k is the pose
on the path with n_k·(q_k − q⁰_k) = ζ_k. n_k (n,) is the unit vector of the null space at q⁰_k. ζ is
a cubic spline over the steps, found by L-BFGS-B. Limits of angle, speed and margin are relaxed
logarithmic barriers (Feller and Ebenbauer, IEEE Trans. Automatic Control 62, 2017) of decreasing
weight. The motion of a round, or a share of its displacement, is accepted if the objective
decreases and every limit is kept exactly.
"""

import numpy as np
from numpy import ndarray

from pipeline.planning.problem import TOLERANCE, Cost, InfeasibleError, Problem, length_of, settle

STARTS, MORE_STARTS = 32, 256  # Newton starts of a step; starts if no solution was found
NEWTON_STEPS, CURVE_STEPS = 40, 6  # Newton steps from a start, and along a curve
STAGE_SPACINGS = 1.5  # spacings that the slowest joint can move between two stages of the search
COARSE_SPACING = 0.25  # rad, spacing at which the length of the curves is measured
SAME_POSE = 1e-4  # rad, greatest distance of equal solutions
LONGEST_CURVE, PILOT_STEPS = 4000, 5  # points of a curve; steps at which the length is measured
BATCH_CURVES = 32  # curves that are followed in one batch
BARRIER_WEIGHTS = (1e-1, 1e-2, 1e-3)  # of the mean barrier, by round
GREATEST_ROUNDS = 12  # rounds; after the first three only until the limits are kept
RELAXATION = 1e-3  # slack below which the barrier is a parabola
STEPS_PER_KNOT = 8  # steps of the path per knot of the spline
DIFFERENCE = 1e-5  # rad, for finite differences
MOTION_STEPS = 8  # Newton steps of a refined motion
STEP_SHARES = (1.0, 0.5, 0.25, 0.1)  # of a round's displacement, tried until the limits are kept
ROUND_ITERATIONS = 60  # of L-BFGS-B in a round
LOST_OBJECTIVE = 1e6  # of a motion off the path or of infinite cost; usual objectives are about 1


def stages(problem: Problem, spacing: float) -> ndarray:
    """(S,) steps of the path from first to last, so far apart that the slowest joint can move by
    STAGE_SPACINGS times ``spacing`` in between. Otherwise it could not leave a pose of the grid.
    """
    last, slowest = len(problem.steps), problem.reach.min()
    wide = 1 if problem.spare == 0 else int(np.ceil(STAGE_SPACINGS * spacing / slowest))
    count = -(-last // min(max(wide, 1), last))
    return np.round(np.linspace(0, last, count + 1)).astype(int)


def spacing_of(problem: Problem, points: int) -> float:
    """Spacing in rad at which the longest curves of a few steps have ``points`` points."""
    if problem.spare == 0:
        return 0.0
    pilots = np.unique(np.linspace(0, len(problem.steps), PILOT_STEPS).round().astype(int))
    most = max(len(poses) for poses in curves(problem, pilots, COARSE_SPACING))
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


def curves(problem: Problem, steps: ndarray, spacing: float, count: int = STARTS) -> list[ndarray]:
    """Points (G, n) in rad, ``spacing`` apart, of the curves from ``count`` starts at each of
    ``steps`` (S,), within limits and margin and without whole turns.
    """
    targets = problem.path[steps]
    solutions, waiting = _solutions(problem, steps, count)
    curve_points = [solutions[s, :0] for s in range(len(steps))]
    while waiting.any():
        several = max(BATCH_CURVES // int(waiting.any(axis=1).sum()), 1)
        lanes, starts = np.nonzero(waiting & (np.cumsum(waiting, axis=1) <= several))
        followed = _follow(problem, solutions[lanes, starts], targets[lanes], spacing)
        for lane, start, points in zip(lanes, starts, followed, strict=True):
            if not waiting[lane, start]:  # an earlier curve passes this start
                continue
            curve_points[lane] = np.concatenate([curve_points[lane], points])
            left = np.flatnonzero(waiting[lane])
            apart = problem.less_turns(solutions[lane, left, None] - points)
            waiting[lane, left] = length_of(apart).min(axis=1) > max(1.5 * spacing, SAME_POSE)
    found = [problem.nearest_turns(points) for points in curve_points]
    return [q[problem.chain.within_limits(q) & problem.clear(q)] for q in found]


def _solutions(problem: Problem, steps: ndarray, count: int) -> tuple[ndarray, ndarray]:
    """(S, count, n) results of Newton's method at each of ``steps`` (S,) from poses within the
    limits (±π without limits), and (S, count) True for a solution.
    """
    from scipy.stats.qmc import Halton

    chain = problem.chain
    bounded = np.isfinite(chain.upper - chain.lower)
    low, high = np.where(bounded, [chain.lower, chain.upper], [[-np.pi], [np.pi]])
    sequence = Halton(len(low), scramble=False).fast_forward(1)
    begin = np.tile(low + (high - low) * sequence.random(count), (len(steps), 1))
    targets = np.repeat(problem.path[steps], count, axis=0)
    solutions, reached = settle(chain, begin, targets, NEWTON_STEPS)
    return solutions.reshape(len(steps), count, -1), reached.reshape(len(steps), count)


def _follow(problem: Problem, starts: ndarray, targets: ndarray, spacing: float) -> list[ndarray]:
    """Points (·, n) of the curves through the poses ``starts`` (L, n), the tip at ``targets``."""
    points, chain = [[q] for q in starts], problem.chain
    closed = np.zeros(len(starts), dtype=bool)
    for way in (1.0, -1.0) if problem.spare > 0 else ():
        q, tangent = starts.copy(), way * np.linalg.svd(chain.jacobian(starts))[2][:, -1]
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


def refine(problem: Problem, cost: Cost, joints: ndarray) -> ndarray:
    """Return a motion (M+1, n) in rad with an objective not above the objective of ``joints`` (M+1,
    n), within the limits if the rounds find such a motion. Raises the errors of ``cost``.
    """
    from scipy.optimize import minimize

    def value(motion: ndarray) -> float:
        each = cost(motion[:-1], problem.steps)
        return problem.objective(each, motion) if np.isfinite(each).all() else np.inf

    best, least = joints, value(joints) if problem.failure(joints) is None else np.inf
    for number in range(GREATEST_ROUNDS):
        if number >= len(BARRIER_WEIGHTS) and np.isfinite(least):
            break
        tube = _Tube(problem, cost, best, BARRIER_WEIGHTS[number % len(BARRIER_WEIGHTS)])
        options = {"jac": True, "method": "L-BFGS-B", "options": {"maxiter": ROUND_ITERATIONS}}
        minimum = minimize(tube.value_and_gradient, np.zeros(tube.spline.shape[1]), **options)
        for share in STEP_SHARES:
            motion, inverse = tube.motion(share * minimum.x)
            if inverse is None:
                continue
            if problem.failure(motion) is None and (own := value(motion)) < least:
                best, least = motion, own
                break
            if share == 1.0 and not np.isfinite(least):
                best = motion
    return best


class _Tube:
    """Motions around ``middle`` (M+1, n) in rad, and their objective with barriers."""

    def __init__(self, problem: Problem, cost: Cost, middle: ndarray, weight: float) -> None:
        from scipy.interpolate import BSpline

        self.problem, self.cost, self.middle, self.weight = problem, cost, middle, weight
        normal, steps = np.linalg.svd(problem.chain.jacobian(middle))[2][:, -1], problem.steps
        # consecutive n_k point the same way
        normal[1:] *= np.sign(np.cumprod(np.vecdot(normal[1:], normal[:-1])))[:, None]
        self.normal, last = normal, len(middle) - 1
        inner = np.linspace(0.0, last, max(last // STEPS_PER_KNOT, 1) + 1)
        knots = np.concatenate([inner[:1].repeat(3), inner, inner[-1:].repeat(3)])
        self.spline = BSpline.design_matrix(np.arange(last + 1.0), knots, 3).toarray()
        # scale of the objective: its slopes along the self-motion times 1 rad, and its smoothness
        h = DIFFERENCE * normal[:-1]
        up, down = (cost(middle[:-1] + sign * h, steps) for sign in (1.0, -1.0))
        both = np.isfinite(up) & np.isfinite(down)
        scale = np.abs(up[both] - down[both]).sum() / (2 * DIFFERENCE)
        self.scale = scale + problem.objective(np.zeros(len(steps)), middle) or 1.0

    def motion(self, coefficients: ndarray) -> tuple[ndarray, ndarray | None]:
        """q (M+1, n) and the inverses (M+1, n, n) of [J; nᵀ], None for a motion off the path."""
        chain, zeta = self.problem.chain, self.spline @ coefficients
        q = self.middle + self.normal * zeta[:, None]
        for _ in range(MOTION_STEPS):
            whole = np.concatenate([chain.jacobian(q), self.normal[:, None]], axis=-2)
            try:
                inverse = np.linalg.inv(whole)
            except np.linalg.LinAlgError:
                break
            off = chain.displacement(chain.pose(q), self.problem.path)
            if np.abs(off).max() < TOLERANCE:
                return q, inverse
            beside = zeta - np.vecdot(self.normal, q - self.middle)
            q = q + np.matvec(inverse, np.concatenate([off, beside[:, None]], axis=-1))
            if not np.abs(q).max() < 1e3:
                break
        return q, None

    def value_and_gradient(self, coefficients: ndarray) -> tuple[float, ndarray]:
        """Objective divided by its scale plus barriers, and the gradient."""
        problem, (q, inverse) = self.problem, self.motion(coefficients)
        if inverse is None or not np.isfinite((here := self._by_pose(q))[0]).all():
            return LOST_OBJECTIVE, np.zeros_like(coefficients)
        step = np.diff(q, axis=0)
        share, across = step / problem.reach, 2 * problem.smoothness / self.scale
        w = step - here[1]
        speed, slope = _barrier(1 - share**2)
        value = here[0].sum() + across / 2 * np.sum(w**2) + self.weight * speed.mean()
        # slopes through the two ends of each step, then through each pose
        moved = across * w - self.weight * 2 * slope * share / problem.reach / share.size
        direction, none = inverse[..., -1], np.zeros_like(q[:1])
        slopes = np.vecdot(np.vstack([none, moved]) - np.vstack([moved, none]), direction)
        nudge = DIFFERENCE * direction
        (up, down), nominal = self._by_pose(np.stack([q + nudge, q - nudge]))
        by_pose = (up - down) / (2 * DIFFERENCE)
        slopes += np.where(np.isfinite(by_pose), by_pose, 0.0)
        slopes[:-1] -= across * np.vecdot(w, nominal[0] - nominal[1]) / (2 * DIFFERENCE)
        return float(value), self.spline.T @ slopes

    def _by_pose(self, q: ndarray) -> tuple[ndarray, ndarray]:
        """(..., M+1) cost divided by the scale plus barriers of angles and margin at the poses
        ``q`` (..., M+1, n), and (..., M, n) nominal steps.
        """
        problem, chain = self.problem, self.problem.chain
        bounded = np.isfinite(wide := chain.upper - chain.lower)
        sides = np.stack([chain.upper - q, q - chain.lower])[..., bounded] / wide[bounded]
        barrier = _barrier(chain.least_singular_value(q) / problem.margin - 1)[0]
        if bounded.any():
            barrier = barrier + _barrier(sides)[0].mean(axis=-1).sum(axis=0)
        result, before = self.weight * barrier / q.shape[-2], q[..., :-1, :]
        v = np.broadcast_to(problem.steps, (*before.shape[:-1], problem.steps.shape[1]))
        each = self.cost(before.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1]))
        result[..., :-1] += each.reshape(before.shape[:-1]) / self.scale
        return result, problem.nominal(before)


def _barrier(slack: ndarray) -> tuple[ndarray, ndarray]:
    """−ln ``slack``, a parabola below :data:`RELAXATION`, and its slope."""
    bounded = np.maximum(slack, RELAXATION)
    short = (bounded - slack) / RELAXATION
    return -np.log(bounded) + short + short**2 / 2, -(1 + short) / bounded
