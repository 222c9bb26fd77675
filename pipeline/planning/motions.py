"""Motions of the joints along a task path: least uncertain, best conditioned, of least norm; the
cheapest way through a grid of poses by dynamic programming (Bellman, 1957).
"""

from dataclasses import dataclass

import numpy as np

from pipeline.core.compiled import compiled
from pipeline.core.errors import ConfigError
from pipeline.planning.problem import TURN, Cost, InfeasibleError, Problem, settle
from pipeline.planning.refine import refined
from pipeline.planning.self_motion import ROUNDS, grid, spacing_of, stages

POINTS = 200  # of the grid, at a step
WAYS, APART = 3, 0.5  # through a grid that are refined, and the rad that sets two of them apart


@dataclass(frozen=True, eq=False)
class Planned:
    """A motion that keeps the path, the limits and the margin."""

    joints: np.ndarray  # (M+1, n) rad
    cost: np.ndarray  # (M,) of each step, what the motion was chosen by
    objective: float  # Σ cost + smoothness·Σ‖w‖², w the steps in the null space, rad
    clearance: np.ndarray  # (M+1,) least singular value of J, m


def least_uncertain(problem: Problem, cost: Cost, points: int = POINTS) -> Planned:
    """Return the motion of least Σ ``cost`` + smoothness·Σ‖w_k‖², w_k the null-space part of step:
    Eq. (least-uncertain-path), of the trace of its sum or another number, with the self-motion free
    that its constraint leaves out.

    By dynamic programming over a grid of ``points`` at a step, globally optimal to the grid; then
    locally (:mod:`.refine`), from the best ways through the grid that are apart. With m = n the
    grid is the whole set of motions. Raises InfeasibleError with the first step at which no motion
    keeps the path, the limits and the margin, ConfigError for an arm of more joints to spare, and
    what the ``cost`` raises.
    """
    if points < 1:
        raise ConfigError(f"the number of grid points must be > 0, got {points}", key="points")
    if problem.spare > 1:
        raise ConfigError(
            f"the arm has {problem.spare} joints more than the task has rows; plan with one more "
            "at most: name more rows in dataset.robot.task",
            key="dataset.robot.task",
        )
    spacing = spacing_of(problem, points)
    steps = stages(problem, spacing)
    ways = on_stages(problem, cost, steps, grid(problem, steps, spacing))
    planned, failed = [], []
    for way, _ in ways if problem.spare > 0 else ways[:1]:
        try:
            planned.append(_filled_in(problem, cost, way, steps))
        except InfeasibleError as error:
            failed.append(error)
    if not planned:
        raise failed[0]
    return min(planned, key=lambda motion: motion.objective)


def best_conditioned(problem: Problem, points: int = POINTS) -> Planned:
    """The motion of greatest Σ ln w, w = sqrt(det JJᵀ) Yoshikawa's manipulability, less smoothness;
    as :func:`least_uncertain` with −ln w as the cost.
    """

    def cost(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        jacobian = problem.chain.jacobian(q)
        return -np.linalg.slogdet(jacobian @ np.swapaxes(jacobian, -1, -2))[1] / 2

    return least_uncertain(problem, cost, points)


def minimum_norm(problem: Problem, start: np.ndarray) -> Planned:
    """The motion from ``start`` (n,) in rad by J⁺v alone, brought back to the path at every step,
    as resolved-rate control does (Whitney, 1969). Its cost is the square of each step in rad².

    Raises InfeasibleError with the first step at which it leaves the limits or the margin.
    """
    chain, joints = problem.chain, np.empty((len(problem.path), len(start)))
    guess = np.asarray(start, dtype=float)[None]
    for k, target in enumerate(problem.path):
        q, reached = settle(chain, guess, target[None], ROUNDS)
        if not reached[0] or chain.singular(q)[0]:
            raise InfeasibleError("the least-norm motion does not reach the path", step=k)
        joints[k] = q[0]
        if k < len(problem.steps):
            guess = q + np.matvec(chain.inverse_jacobian(q), problem.steps[k])
    if failure := problem.failure(joints):
        raise failure
    cost = np.sum(np.diff(joints, axis=0) ** 2, axis=-1)
    return Planned(joints, cost, cost.sum(), chain.least_singular_value(joints))


def on_stages(
    problem: Problem, cost: Cost, steps: np.ndarray, grid: list[np.ndarray]
) -> list[tuple[np.ndarray, float]]:
    """The cheapest way through the ``grid`` of poses (G, n) at each of ``steps`` (S,), (S, n) in
    rad, and what it costs; behind it the cheapest others that end apart from each other. Eq.
    (least-uncertain-path) to the grid. A step has its cost at the pose of the nearest stage.

    Raises InfeasibleError with the first step to which none leads, and what ``cost`` does.
    """
    chain, counts = problem.chain, np.array([len(q) for q in grid])
    stage = np.searchsorted((steps[1:] + steps[:-1]) / 2, np.arange(len(problem.steps)), "right")
    q = np.concatenate([grid[s] for s in stage])
    each = cost(q, np.repeat(problem.steps, counts[stage], axis=0))
    own = np.where(np.arange(counts.max()) < counts[:, None], 0.0, np.inf)
    poses = np.zeros((*own.shape, len(chain.lower)))
    nominal, wide = np.zeros_like(poses[1:]), np.diff(steps)
    for s, solutions in enumerate(grid):
        poses[s, : len(solutions)] = solutions
        if s + 1 < len(steps):
            v = chain.displacement(problem.path[steps[s]], problem.path[steps[s + 1]])
            nominal[s, : len(solutions)] = np.matvec(chain.inverse_jacobian(solutions), v)
    for s, part in zip(stage, np.split(each, np.cumsum(counts[stage])[:-1]), strict=True):
        own[s, : len(part)] += part
    reach, weight = wide[:, None] * problem.reach, problem.smoothness / wide
    before, total = cheapest(poses, counts, own, nominal, reach, weight, problem.turning)
    if (lost := ~np.isfinite(total).any(axis=1)).any():
        reached = int(lost.argmax())
        why = "the model has no covariance at any pose of the path, or none with a ln det"
        if np.isfinite(own[reached]).any():
            why = "no pose of the path can be reached from those before within the joints' speeds; "
            why += "give the path more time"
        after = int(steps[reached - 1]) if reached else None
        raise InfeasibleError(why, step=int(steps[reached]), after=after)
    ways: list[tuple[np.ndarray, float]] = []
    for last in np.argsort(total[-1], kind="stable"):
        if len(ways) == WAYS or not np.isfinite(total[-1, last]):
            break
        ends = (problem.less_turns(poses[-1, last] - way[-1]) for way, _ in ways)
        if all(np.abs(end).max() > APART for end in ends):
            way = poses[np.arange(len(steps)), way_to(last, before)]
            ways.append((way, float(total[-1, last])))
    return ways


def _filled_in(problem: Problem, cost: Cost, way: np.ndarray, steps: np.ndarray) -> Planned:
    """The motion through ``way`` (S, n) in rad at the ``steps`` (S,), without jumps of whole turns
    and within the limits where some turns fit, refined.
    """
    chain, turning, every = problem.chain, problem.turning, np.arange(len(problem.path))
    jumps = np.diff(way, axis=0, prepend=0.0)
    jumps[1:] -= TURN * np.round(jumps[1:] / TURN) * turning
    way = np.cumsum(jumps, axis=0)
    over = np.where(turning, np.maximum(way.max(axis=0) - chain.upper, 0.0), 0.0)
    under = np.where(turning, np.maximum(chain.lower - way.min(axis=0), 0.0), 0.0)
    way = way + TURN * (np.ceil(under / TURN) - np.ceil(over / TURN))
    between = np.stack([np.interp(every, steps, column) for column in way.T], axis=-1)
    joints, reached = settle(chain, between, problem.path, ROUNDS)
    if not reached.all():
        raise InfeasibleError(
            "no motion connects two points of the grid; increase the number of grid points",
            step=int((~reached).argmax()),
        )
    if problem.spare > 0:
        joints = refined(problem, cost, joints)
    if failure := problem.failure(joints):
        raise failure
    each, clearance = cost(joints[:-1], problem.steps), chain.least_singular_value(joints)
    return Planned(joints, each, problem.objective(each, joints), clearance)


@compiled
def cheapest(
    poses: np.ndarray,
    counts: np.ndarray,
    cost: np.ndarray,
    nominal: np.ndarray,
    reach: np.ndarray,
    weight: np.ndarray,
    turning: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (S, G) the pose before on the way of least Σ cost + Σ weight·‖q_{s+1} − q_s −
    nominal_s‖² to each pose, and (S, G) the cost of that way, infinite where none leads, no joint
    beyond its reach.

    ``poses`` (S, G, n) in rad, ``counts`` (S,) of them at a stage; ``cost`` (S, G), infinite where
    a pose is not to be taken; ``nominal`` (S-1, G, n) step without weight from each pose and
    ``reach`` (S-1, n) greatest step, in rad; ``weight`` (S-1,) of a squared step beyond the nominal
    one; ``turning`` (n,) joints whose steps are taken up to whole turns. Poses before are tried by
    their cost, as long as they can win: nothing is left out.
    """
    before, total = np.zeros(cost.shape, dtype=np.int64), np.full(cost.shape, np.inf)
    total[0, : counts[0]] = cost[0, : counts[0]]
    for s in range(1, len(counts)):
        order = np.argsort(total[s - 1, : counts[s - 1]], kind="mergesort")
        for j in range(counts[s]):
            least = np.inf
            for place in order if cost[s, j] < np.inf else order[:0]:
                value = total[s - 1, place]
                if not value < least:
                    break
                for joint in range(poses.shape[2]):
                    step = poses[s, j, joint] - poses[s - 1, place, joint]
                    if turning[joint]:
                        step -= TURN * np.floor(step / TURN + 0.5)
                    if abs(step) > reach[s - 1, joint]:
                        value = np.inf
                        break
                    beyond = step - nominal[s - 1, place, joint]
                    value += weight[s - 1] * beyond * beyond
                if value < least:
                    least, before[s, j] = value, place
            total[s, j] = least + cost[s, j]
    return before, total


def way_to(last: int, before: np.ndarray) -> np.ndarray:
    """(S,) poses on the way to the pose ``last`` of the last stage, by ``before`` (S, G)."""
    way = [last]
    for row in before[:0:-1]:
        way.append(int(row[way[-1]]))
    return np.array(way[::-1])
