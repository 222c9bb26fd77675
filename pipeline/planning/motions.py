"""Motions of the joints along a task path: least uncertain, best conditioned or of least norm, by
dynamic programming over a grid of poses (Bellman, 1957).
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from pipeline.core.compiled import compiled
from pipeline.core.errors import ConfigError
from pipeline.planning.problem import TURN, Cost, InfeasibleError, Problem, settle
from pipeline.planning.self_motion import (
    CURVE_STEPS,
    NEWTON_STEPS,
    grid,
    spacing_of,
    stages,
)

POINTS = 200  # grid points per step
REFINED_PATHS = 3  # greatest number of paths through the grid that are refined
LEAST_DISTANCE = 0.5  # rad, least distance between the ends of refined paths
TUBE = 11  # poses at each step of a refinement
WIDEST, NARROWEST = 0.05, 1e-5  # rad, greatest displacement in a tube
MOST_ROUNDS = 300  # of a refinement; 15 to 40 are usual
GAIN = 1e-3  # least relative improvement after which the tube keeps its width


@dataclass(frozen=True, eq=False)
class Planned:
    """A motion on the path and within the limits and the margin."""

    joints: ndarray  # (M+1, n) rad
    cost: ndarray  # (M,) minimised cost of each step
    objective: float  # Σ cost + smoothness·Σ‖w‖², w the null-space steps in rad
    clearance: ndarray  # (M+1,) least singular value of J, m


def least_uncertain(problem: Problem, cost: Cost, points: int = POINTS) -> Planned:
    """Return the motion of least Σ ``cost`` + smoothness·Σ‖w_k‖², w_k the null-space part of step
    k: Eq. (least-uncertain-path) for the trace or another function of the covariance. Self-motion
    is allowed, which the equation's constraint excludes. Dynamic programming over ``points`` poses
    at a step gives the global optimum on that grid; the best paths with distinct ends are refined.

    Raises InfeasibleError with the first step at which no motion keeps the path, the limits and the
    margin, ConfigError for n > m + 1, and the errors of the ``cost``.
    """
    if points < 1:
        raise ConfigError(
            f"the number of grid points must be > 0, got {points}", key="points"
        )
    if problem.spare > 1:
        message = f"the arm has {problem.spare} joints more than the task has rows, at most one is "
        message += "allowed; name more rows in dataset.robot.task"
        raise ConfigError(message, key="dataset.robot.task")
    spacing = spacing_of(problem, points)
    steps = stages(problem, spacing)
    planned, failed = [], []
    for way, _ in cheapest_paths(problem, cost, steps, grid(problem, steps, spacing)):
        try:
            planned.append(_refined_motion(problem, cost, way, steps))
        except InfeasibleError as error:
            failed.append(error)
    if not planned:
        raise failed[0]
    return min(planned, key=lambda motion: motion.objective)


def best_conditioned(problem: Problem, points: int = POINTS) -> Planned:
    """Return the motion of :func:`least_uncertain` with the cost −ln w, w = sqrt(det JJᵀ) being
    Yoshikawa's manipulability.
    """

    def cost(q: ndarray, v: ndarray) -> ndarray:
        jacobian = problem.chain.jacobian(q)
        return -np.linalg.slogdet(jacobian @ np.swapaxes(jacobian, -1, -2))[1] / 2

    return least_uncertain(problem, cost, points)


def minimum_norm(problem: Problem, start: ndarray) -> Planned:
    """Return the motion from ``start`` (n,) in rad with the steps J⁺v, corrected to the path at
    every step, as in resolved-rate control (Whitney, 1969). The cost is the squared step in rad².
    Raises InfeasibleError with the first step at which it leaves the path, a limit or the margin.
    """
    chain, joints = problem.chain, np.empty((len(problem.path), len(start)))
    guess = np.asarray(start, dtype=float)[None]
    for k, target in enumerate(problem.path):
        q, reached = settle(chain, guess, target[None], NEWTON_STEPS)
        if not reached[0] or chain.singular(q)[0]:
            raise InfeasibleError(
                "the least-norm motion does not reach the path", step=k
            )
        joints[k] = q[0]
        if k < len(problem.steps):
            guess = q + np.matvec(chain.inverse_jacobian(q), problem.steps[k])
    if failure := problem.failure(joints):
        raise failure
    cost = np.sum(np.diff(joints, axis=0) ** 2, axis=-1)
    return Planned(joints, cost, cost.sum(), chain.least_singular_value(joints))


def cheapest_paths(
    problem: Problem, cost: Cost, steps: ndarray, grid: list[ndarray]
) -> list[tuple[ndarray, float]]:
    """Return the cheapest path (S, n) in rad through the ``grid`` of poses (G, n) at each of
    ``steps`` (S,) and its objective, Eq. (least-uncertain-path) on the grid; then the cheapest
    other paths with distinct ends. The cost of a step is evaluated at the pose of the nearest
    stage. Raises InfeasibleError with the first step without a path, and the errors of ``cost``.
    """
    chain, counts, wide = (
        problem.chain,
        np.array([len(q) for q in grid]),
        np.diff(steps),
    )
    stage = np.searchsorted(
        (steps[1:] + steps[:-1]) / 2, np.arange(len(problem.steps)), "right"
    )
    q = np.concatenate([grid[s] for s in stage])
    costs = cost(q, np.repeat(problem.steps, counts[stage], axis=0))
    at_pose = np.where(np.arange(counts.max()) < counts[:, None], 0.0, np.inf)
    for s, part in zip(
        stage, np.split(costs, np.cumsum(counts[stage])[:-1]), strict=True
    ):
        at_pose[s, : len(part)] += part
    poses = np.zeros((*at_pose.shape, len(chain.lower)))
    nominal, v = (
        np.zeros_like(poses),
        chain.displacement(*problem.path[[steps[:-1], steps[1:]]]),
    )
    for s, q in enumerate(grid):
        poses[s, : len(q)] = q
        if s < len(v):
            nominal[s, : len(q)] = np.matvec(chain.inverse_jacobian(q), v[s])
    reach, weight = wide[:, None] * problem.reach, problem.smoothness / wide
    before, total = search_stages(
        poses, counts, at_pose, nominal, reach, weight, problem.turning
    )
    if (lost := ~np.isfinite(total).any(axis=1)).any():
        first = int(lost.argmax())
        why = "at every pose of the path the model has no covariance or a singular one"
        if np.isfinite(at_pose[first]).any():
            why = "no pose can be reached within the joints' speed limits; give the path more time"
        after = int(steps[first - 1]) if first else None
        raise InfeasibleError(why, step=int(steps[first]), after=after)
    ways: list[tuple[ndarray, float]] = []
    for last in np.argsort(total[-1], kind="stable"):
        if len(ways) == REFINED_PATHS or not np.isfinite(total[-1, last]):
            break
        ends = (problem.less_turns(poses[-1, last] - way[-1]) for way, _ in ways)
        if all(np.abs(end).max() > LEAST_DISTANCE for end in ends):
            places = [last]
            for row in before[:0:-1]:
                places.append(row[places[-1]])
            ways.append(
                (poses[np.arange(len(steps)), places[::-1]], float(total[-1, last]))
            )
    return ways


def _refined_motion(
    problem: Problem, cost: Cost, way: ndarray, steps: ndarray
) -> Planned:
    """Refine the motion through ``way`` (S, n) in rad at the ``steps`` (S,), after shifts by whole
    turns that remove jumps and, if possible, keep the limits.
    """
    chain, turning, every = problem.chain, problem.turning, np.arange(len(problem.path))
    jumps = np.diff(way, axis=0, prepend=0.0)
    jumps[1:] -= TURN * np.round(jumps[1:] / TURN) * turning
    way = np.cumsum(jumps, axis=0)
    over = np.where(turning, np.maximum(way.max(axis=0) - chain.upper, 0.0), 0.0)
    under = np.where(turning, np.maximum(chain.lower - way.min(axis=0), 0.0), 0.0)
    way = way + TURN * (np.ceil(under / TURN) - np.ceil(over / TURN))
    between = np.stack([np.interp(every, steps, column) for column in way.T], axis=-1)
    joints, reached = settle(chain, between, problem.path, NEWTON_STEPS)
    if not reached.all():
        why = "no motion connects two points of the grid; increase the number of grid points"
        raise InfeasibleError(why, step=int((~reached).argmax()))
    if problem.spare > 0:
        joints = refine(problem, cost, joints)
    if failure := problem.failure(joints):
        raise failure
    costs, clearance = (
        cost(joints[:-1], problem.steps),
        chain.least_singular_value(joints),
    )
    return Planned(joints, costs, problem.objective(costs, joints), clearance)


def refine(problem: Problem, cost: Cost, joints: ndarray) -> ndarray:
    """Return the motion (M+1, n) in rad of least objective that is found near ``joints`` (M+1, n),
    or ``joints`` if no motion near by keeps the limits. Raises the errors of ``cost``.

    Each round searches TUBE poses at every step, displaced along the self-motion from the best
    motion so far, by dynamic programming (Heidari, Chow, Kokotović and Meredith, Water Resources
    Research 7, 1971). After an improvement of less than GAIN the next tube is half as wide.
    """
    chain, every, width, least = problem.chain, np.arange(len(joints)), WIDEST, np.inf
    targets = np.repeat(problem.path, TUBE, axis=0)
    for _ in range(MOST_ROUNDS):
        if width <= NARROWEST:
            break
        normal, offsets = (
            np.linalg.svd(chain.jacobian(joints))[2][:, -1:],
            np.linspace(-1, 1, TUBE),
        )
        near = joints[:, None] + width * offsets[:, None] * normal
        q, kept = settle(chain, near.reshape(len(targets), -1), targets, CURVE_STEPS)
        kept &= chain.within_limits(q) & problem.clear(q)
        tube = [
            q[places][kept[places]] for places in np.arange(len(q)).reshape(-1, TUBE)
        ]
        width, earlier = width / 2, least
        try:
            (way, value), *_ = cheapest_paths(problem, cost, every, tube)
        except InfeasibleError:
            continue
        if value < least:
            joints, least = way, value
        if least < earlier - GAIN * abs(least):
            width *= 2
    return joints


@compiled
def search_stages(poses, counts, cost, nominal, reach, weight, turning):
    """Return the index (S, G) of the previous pose on the path of least Σ cost + Σ weight·‖q_{s+1}
    − q_s − nominal_s‖² to each pose, and the objective (S, G), infinite without a path.

    ``poses`` (S, G, n) in rad, ``counts`` (S,) of them at a stage; ``cost`` (S, G), infinite at a
    forbidden pose; ``nominal`` (S-1, G, n) step from each pose without weight and ``reach`` (S-1,
    n) greatest step, in rad; ``weight`` (S-1,) of a squared deviation from the nominal step;
    ``turning`` (n,) joints whose steps are taken up to whole turns.
    """
    before, total = np.zeros(cost.shape, dtype=np.int64), np.full(cost.shape, np.inf)
    total[0, : counts[0]] = cost[0, : counts[0]]
    for s in range(1, len(counts)):
        # previous poses by increasing cost, until the cost alone is too high
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
