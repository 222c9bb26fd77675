"""A motion with one joint to spare made better locally, within the limits.

The motion moves by ζ_k in the null space of J at each step k: q_k is the pose on the path with
n_k·(q_k − q⁰_k) = ζ_k, n_k (n,) the unit vector of the null space at the motion q⁰ begun with. ζ is
a cubic spline over the steps, found by L-BFGS-B; limits of angle, speed and margin are relaxed
logarithmic barriers (Feller and Ebenbauer, IEEE Trans. Automatic Control 62, 2017), which lose
their weight round by round. A round's motion, or a share of the way to it, is taken where it is
better and keeps every limit exactly.
"""

import numpy as np

from pipeline.planning.problem import CLOSE, Cost, Problem

WEIGHTS = (1e-1, 1e-2, 1e-3)  # of the mean barrier beside the objective, round by round
MOST = 12  # rounds; those after the first of each weight only until the limits are kept
RELAXED = 1e-3  # slack below which the barrier is a parabola
STEPS_A_KNOT = 8  # of the path
NUDGE = 1e-5  # rad, for slopes
CORRECTIONS = 8  # of Newton's method
SHARES = (1.0, 0.5, 0.25, 0.1)  # of a round's way, where the whole breaks a limit
ITERATIONS = 60  # of a round
LOST = 1e6  # objective of a motion that leaves the path or has no cost; of the order of 1 else


def refined(problem: Problem, cost: Cost, joints: np.ndarray) -> np.ndarray:
    """(M+1, n) in rad a motion no worse than ``joints`` (M+1, n); one that keeps the limits where
    the rounds find any. Raises what ``cost`` raises of ``joints``.
    """
    from scipy.optimize import minimize

    def value(motion: np.ndarray) -> float:
        each = cost(motion[:-1], problem.steps)
        return problem.objective(each, motion) if np.isfinite(each).all() else np.inf

    best, least = joints, value(joints) if problem.failure(joints) is None else np.inf
    for number in range(MOST):
        if number >= len(WEIGHTS) and np.isfinite(least):
            break
        tube = _Tube(problem, cost, best, WEIGHTS[number % len(WEIGHTS)])
        options = {"jac": True, "method": "L-BFGS-B", "options": {"maxiter": ITERATIONS}}
        minimum = minimize(tube.value_and_gradient, np.zeros(tube.spline.shape[1]), **options)
        for share in SHARES:
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
    """The motions around ``middle`` (M+1, n), and their cost with barriers of a ``weight``."""

    def __init__(self, problem: Problem, cost: Cost, middle: np.ndarray, weight: float) -> None:
        from scipy.interpolate import BSpline

        self.problem, self.cost, self.middle, self.weight = problem, cost, middle, weight
        normal, steps = np.linalg.svd(problem.chain.jacobian(middle))[2][:, -1], problem.steps
        # n_k (M+1, n), each nearest to the one before
        normal[1:] *= np.sign(np.cumprod(np.vecdot(normal[1:], normal[:-1])))[:, None]
        self.normal, last = normal, len(middle) - 1
        inner = np.linspace(0.0, last, max(last // STEPS_A_KNOT, 1) + 1)
        knots = np.concatenate([inner[:1].repeat(3), inner, inner[-1:].repeat(3)])
        self.spline = BSpline.design_matrix(np.arange(last + 1.0), knots, 3).toarray()
        # of the objective: its slopes along the self-motion, for a radian, and its smoothness
        h = NUDGE * normal[:-1]
        up, down = (cost(middle[:-1] + sign * h, steps) for sign in (1.0, -1.0))
        both = np.isfinite(up) & np.isfinite(down)
        scale = np.abs(up[both] - down[both]).sum() / (2 * NUDGE)
        self.scale = scale + problem.objective(np.zeros(len(steps)), middle) or 1.0

    def motion(self, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """(M+1, n) q, and the inverses (M+1, n, n) of [J; nᵀ]; None where it leaves the path."""
        chain, zeta = self.problem.chain, self.spline @ coefficients
        q = self.middle + self.normal * zeta[:, None]
        for _ in range(CORRECTIONS):
            whole = np.concatenate([chain.jacobian(q), self.normal[:, None]], axis=-2)
            try:
                inverse = np.linalg.inv(whole)
            except np.linalg.LinAlgError:
                break
            off = chain.displacement(chain.pose(q), self.problem.path)
            if np.abs(off).max() < CLOSE:
                return q, inverse
            beside = zeta - np.vecdot(self.normal, q - self.middle)
            q = q + np.matvec(inverse, np.concatenate([off, beside[:, None]], axis=-1))
            if not np.abs(q).max() < 1e3:
                break
        return q, None

    def value_and_gradient(self, coefficients: np.ndarray) -> tuple[float, np.ndarray]:
        """The objective over its scale, with the barriers, and its slopes."""
        problem, (q, inverse) = self.problem, self.motion(coefficients)
        if inverse is None or not np.isfinite((here := self._by_pose(q))[0]).all():
            return LOST, np.zeros_like(coefficients)
        step = np.diff(q, axis=0)
        share, across = step / problem.reach, 2 * problem.smoothness / self.scale
        w = step - here[1]
        speed, slope = _barrier(1 - share**2)
        value = here[0].sum() + across / 2 * np.sum(w**2) + self.weight * speed.mean()
        # slopes by each step's two ends, then by each pose along its own direction
        moved = across * w - self.weight * 2 * slope * share / problem.reach / share.size
        direction, none = inverse[..., -1], np.zeros_like(q[:1])
        slopes = np.vecdot(np.vstack([none, moved]) - np.vstack([moved, none]), direction)
        nudge = NUDGE * direction
        (up, down), nominal = self._by_pose(np.stack([q + nudge, q - nudge]))
        by_pose = (up - down) / (2 * NUDGE)
        slopes += np.where(np.isfinite(by_pose), by_pose, 0.0)
        slopes[:-1] -= across * np.vecdot(w, nominal[0] - nominal[1]) / (2 * NUDGE)
        return float(value), self.spline.T @ slopes

    def _by_pose(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(..., M+1) cost over the scale and barriers of angles and margin of each of the poses
        ``q`` (..., M+1, n), and (..., M, n) nominal steps there.
        """
        problem, chain = self.problem, self.problem.chain
        bounded = np.isfinite(wide := chain.upper - chain.lower)
        sides = np.stack([chain.upper - q, q - chain.lower])[..., bounded] / wide[bounded]
        barrier = _barrier(chain.least_singular_value(q) / problem.margin - 1)[0]
        if bounded.any():
            barrier = barrier + _barrier(sides)[0].mean(axis=-1).sum(axis=0)
        result, begun = self.weight * barrier / q.shape[-2], q[..., :-1, :]
        v = np.broadcast_to(problem.steps, (*begun.shape[:-1], problem.steps.shape[1]))
        each = self.cost(begun.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1]))
        result[..., :-1] += each.reshape(begun.shape[:-1]) / self.scale
        return result, problem.nominal(begun)


def _barrier(slack: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """−ln of ``slack``, a parabola below :data:`RELAXED`, and its slope."""
    bounded = np.maximum(slack, RELAXED)
    short = (bounded - slack) / RELAXED
    return -np.log(bounded) + short + short**2 / 2, -(1 + short) / bounded
