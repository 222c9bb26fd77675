"""A motion made better locally, within the limits.

The motion moves by ζ_k in the null space of J at each step k: q_k is the pose on the path with
N_kᵀ(q_k − q⁰_k) = ζ_k, N_k (n, n−m) an orthonormal basis at the motion q⁰ begun with, turned as
little as can be from one step to the next. ζ is a cubic spline over the steps. Its coefficients are
SciPy's L-BFGS-B's to find; limits of angle, speed and margin are relaxed logarithmic barriers
(Feller and Ebenbauer, IEEE Trans. Automatic Control 62, 2017), which lose their weight round by
round. A round's motion, or a share of the way to it, is taken where it is better and keeps every
limit exactly.

A cost or a limit of one step depends on few coefficients, so that a gradient is a few batches
whatever their number. Solvers that carry each limit as a constraint (SLSQP, trust-constr, IPOPT)
would carry thousands of them through every iteration. Of SciPy's methods for a smooth objective
L-BFGS-B ends lowest or as low as any on most arms and models; SLSQP, BFGS and TNC, on the same
barriers, stop early on some.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.planning.problem import CLOSE, Cost, Problem, where_defined

WEIGHTS = (1e-1, 1e-2, 1e-3)  # of the mean barrier beside the objective, round by round
MOST = 12  # rounds; those after the first of each weight only until the limits are kept
RELAXED = 1e-3  # slack below which the barrier is a parabola
STEPS_A_KNOT = 8  # of the path
NUDGE = 1e-5  # rad, for slopes
CORRECTIONS = 8  # of Newton's method
SHARES = (1.0, 0.5, 0.25, 0.1)  # of a round's way, where the whole breaks a limit
ITERATIONS = 60  # of a round
LOST = 1e6  # objective of a motion that leaves the path or has no cost; of the order of 1 else


def objective(problem: Problem, each: np.ndarray, joints: np.ndarray) -> float:
    """Σ cost + smoothness·Σ‖w_k‖² of the motion ``joints`` (M+1, n) whose steps cost ``each``
    (M,).
    """
    w = np.diff(joints, axis=0) - _nominal(problem, joints[:-1])
    return float(each.sum() + problem.smoothness * np.sum(w**2))


def refined(problem: Problem, cost: Cost, joints: np.ndarray) -> np.ndarray:
    """(M+1, n) in rad a motion no worse than ``joints`` (M+1, n); one that keeps the limits where
    the rounds find any. Raises what ``cost`` raises of ``joints``.
    """

    from scipy.optimize import minimize

    def value(motion: np.ndarray) -> float:
        each = where_defined(cost, motion[:-1], problem.steps)
        return objective(problem, each, motion) if np.isfinite(each).all() else np.inf

    best, least = joints, value(joints) if problem.failure(joints) is None else np.inf
    for number in range(MOST):
        if number >= len(WEIGHTS) and np.isfinite(least):
            break
        tube = Tube.around(problem, cost, best, WEIGHTS[number % len(WEIGHTS)])
        minimum = minimize(
            tube.value_and_gradient,
            np.zeros(tube.size),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": ITERATIONS},
        )
        for share in SHARES:
            motion, inverse = tube.motion(share * minimum.x)
            if inverse is None:
                continue
            if problem.failure(motion) is None and value(motion) < least:
                best, least = motion, value(motion)
                break
            if share == 1.0 and not np.isfinite(least):
                best = motion
    return best


@dataclass
class Tube:
    """The motions around one, and what they cost with the barriers of a ``weight``."""

    problem: Problem
    cost: Cost
    middle: np.ndarray  # (M+1, n) q⁰
    basis: np.ndarray  # (M+1, n, r) N
    spline: np.ndarray  # (M+1, K) its functions at the steps
    weight: float
    scale: float  # of the objective

    @classmethod
    def around(cls, problem: Problem, cost: Cost, middle: np.ndarray, weight: float) -> Tube:
        """The tube around ``middle`` (M+1, n); its objective is measured by its slopes along the
        self-motion there, for a radian, and by its smoothness.
        """
        basis, steps, scale = _transported(problem, middle), problem.steps, 0.0
        for r in range(problem.spare):
            h = NUDGE * basis[:-1, :, r]
            up, down = (where_defined(cost, middle[:-1] + sign * h, steps) for sign in (1.0, -1.0))
            both = np.isfinite(up) & np.isfinite(down)
            scale += np.abs(up[both] - down[both]).sum() / (2 * NUDGE)
        scale += objective(problem, np.zeros(len(steps)), middle)
        return cls(problem, cost, middle, basis, _spline(len(middle)), weight, scale or 1.0)

    @property
    def size(self) -> int:
        """How many coefficients there are."""
        return self.spline.shape[1] * self.problem.spare

    def motion(self, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """(M+1, n) q, and the inverses (M+1, n, n) of [J; Nᵀ] there; None where it leaves the
        path.
        """
        chain, path = self.problem.chain, self.problem.path
        zeta = self.spline @ coefficients.reshape(-1, self.problem.spare)
        rows = np.swapaxes(self.basis, -1, -2)
        q = self.middle + np.matvec(self.basis, zeta)
        for _ in range(CORRECTIONS):
            whole = np.concatenate([chain.jacobian(q), rows], axis=-2)
            try:
                inverse = np.linalg.inv(whole)
            except np.linalg.LinAlgError:
                return q, None
            off = chain.displacement(chain.pose(q), path)
            if np.abs(off).max() < CLOSE:
                return q, inverse
            beside = zeta - np.matvec(rows, q - self.middle)
            q = q + np.matvec(inverse, np.concatenate([off, beside], axis=-1))
            if not np.abs(q).max() < 1e3:
                return q, None
        return q, None

    def value_and_gradient(self, coefficients: np.ndarray) -> tuple[float, np.ndarray]:
        """The objective over its scale, with the barriers, and its slopes."""
        problem, nothing = self.problem, np.zeros_like(coefficients)
        q, inverse = self.motion(coefficients)
        if inverse is None:
            return LOST, nothing
        each = where_defined(self.cost, q[:-1], problem.steps)
        if not np.isfinite(each).all():
            return LOST, nothing
        directions = inverse[..., len(problem.chain.task) :]
        step, w = np.diff(q, axis=0), np.diff(q, axis=0) - _nominal(problem, q[:-1])
        barrier, by_pose, by_step = _barriers(problem, q, step)
        clearance, least = _margin(problem, q)
        value = (each.sum() + problem.smoothness * np.sum(w**2)) / self.scale
        value += self.weight * (barrier + clearance)
        # slopes by each pose along its own directions, then by each step's two ends
        joint = self.weight * by_pose
        across = 2 * problem.smoothness / self.scale * w
        moved = across + self.weight * by_step
        joint[1:] += moved
        joint[:-1] -= moved
        slopes = np.einsum("kj,kjr->kr", joint, directions)
        for r in range(problem.spare):
            h = NUDGE * directions[..., r]
            up, down = (self._local(q + sign * h, least) for sign in (1.0, -1.0))
            slope = [(one - other) / (2 * NUDGE) for one, other in zip(up, down, strict=True)]
            slopes[:-1, r] += slope[0] / self.scale - np.vecdot(across, slope[1])
            slopes[:, r] += self.weight * slope[2]
        return float(value), (self.spline.T @ slopes).ravel()

    def _local(self, q: np.ndarray, least: tuple) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """At the poses ``q`` (M+1, n) what each contributes by itself: cost (M,), nominal step (M,
        n), and the barrier of the margin (M+1,) to first order by the vectors ``least``.
        """
        problem = self.problem
        each = where_defined(self.cost, q[:-1], problem.steps)
        left, right, force = least
        singular = np.vecdot(left, np.matvec(problem.chain.jacobian(q), right))
        return np.where(np.isfinite(each), each, 0.0), _nominal(problem, q[:-1]), force * singular


def _nominal(problem: Problem, q: np.ndarray) -> np.ndarray:
    """(M, n) J⁺v_k at the poses ``q`` (M, n)."""
    return np.matvec(problem.chain.inverse_jacobian(q), problem.steps)


def _barrier(slack: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """−ln of ``slack``, a parabola below :data:`RELAXED`, and its slope."""
    bounded = np.maximum(slack, RELAXED)
    short = (bounded - slack) / RELAXED
    value = -np.log(bounded) + short + short**2 / 2
    return value, -(1 + short) / bounded


def _barriers(
    problem: Problem, q: np.ndarray, step: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """The mean barrier of angles and speeds, its slopes by ``q`` (M+1, n) and by ``step`` (M,
    n).
    """
    chain, by_pose = problem.chain, np.zeros_like(q)
    wide, value = chain.upper - chain.lower, 0.0
    bounded = np.isfinite(wide)
    for sign, limit in ((1.0, chain.upper), (-1.0, chain.lower)):
        slack = sign * (limit - q)[:, bounded] / wide[bounded]
        each, slope = _barrier(slack)
        value += each.mean() if bounded.any() else 0.0
        by_pose[:, bounded] -= sign * slope / wide[bounded] / max(each.size, 1)
    share = step / problem.reach
    each, slope = _barrier(1 - share**2)
    return value + each.mean(), by_pose, -2 * slope * share / problem.reach / each.size


def _margin(problem: Problem, q: np.ndarray) -> tuple[float, tuple]:
    """The mean barrier of the margin at ``q`` (M+1, n); the vectors (M+1, m) and (M+1, n) of the
    least singular value, and (M+1,) the slope by it.
    """
    left, values, right = np.linalg.svd(problem.chain.jacobian(q), full_matrices=False)
    each, slope = _barrier(values[:, -1] / problem.margin - 1)
    return each.mean(), (left[..., -1], right[:, -1], slope / problem.margin / len(q))


def _spline(count: int) -> np.ndarray:
    """(count, K) cubic B-splines over ``count`` steps."""
    from scipy.interpolate import BSpline

    pieces = max((count - 1) // STEPS_A_KNOT, 1)
    inner = np.linspace(0.0, count - 1.0, pieces + 1)
    knots = np.concatenate([inner[:1].repeat(3), inner, inner[-1:].repeat(3)])
    return BSpline.design_matrix(np.arange(float(count)), knots, 3).toarray()


def _transported(problem: Problem, q: np.ndarray) -> np.ndarray:
    """(M+1, n, r) orthonormal bases of the null space of J at ``q`` (M+1, n), each nearest to the
    one before.
    """
    m = len(problem.chain.task)
    bases = np.swapaxes(np.linalg.svd(problem.chain.jacobian(q))[2][:, m:], -1, -2)
    for k in range(1, len(q)):
        turn, _, back = np.linalg.svd(bases[k].T @ bases[k - 1])
        bases[k] = bases[k] @ (turn @ back)
    return bases
