"""Joint angles of the arm in a depth camera's points by least squares, Eq. (KinObj), frame by
frame.

The objective jumps where a point changes its segment, so a compiled Nelder–Mead simplex is used.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import Arm
from pipeline.core.columns import spread
from pipeline.core.compiled import compiled, inner
from pipeline.core.errors import RecordingError, SolverError
from pipeline.core.options.analysis import ArticulationSection
from pipeline.perception import articulation_objective as objective
from pipeline.perception.articulation_objective import INFEASIBLE, Frame, rank

MAX_STEPS = 2000  # of the simplex
# rad; how far from the nominal pose the cold starts lie: lag and drift of the arm against its
# trajectory
SPREAD = 0.15
# an objective of more than so many times the least of the take: not the arm; noise alone varies it
# by less
LOST = 2.0
POSES = 24  # directions of the first segment that a lost arm is looked for in


@compiled
def _simplex(frame, step, extent, corners, values, scratch):
    """One run of Nelder and Mead (1965), coefficients 1, 2, ½, ½, until the simplex is smaller than
    ``extent`` in every variable, from ``corners[0]`` of ``corners`` (n+1, n), where it leaves the
    best; whether it came to that. Across a jump of the objective values never meet.

    ``values`` (n+1,) and ``scratch`` (3, n) are overwritten. Loops compile in a quarter of the time
    of NumPy's array expressions.
    """
    n = values.size - 1
    middle, reflected, tried = scratch[0], scratch[1], scratch[2]
    for i in range(1, n + 1):
        _set(corners, i, corners[0])
        corners[i, i - 1] += step
    unknown = 0  # the first corner without a value
    for _ in range(MAX_STEPS):
        for i in range(unknown, n + 1):
            values[i] = rank(frame, corners[i])
        _sort(corners, values)
        size = 0.0
        for j in range(n):
            middle[j] = corners[0, j]
            for i in range(1, n):
                middle[j] += corners[i, j]
            for i in range(1, n + 1):
                size = max(size, abs(corners[i, j] - corners[0, j]))
        if size <= extent:
            return True
        for j in range(n):
            middle[j] /= n
            reflected[j] = middle[j] - (corners[n, j] - middle[j])
        at_reflected, unknown = rank(frame, reflected), n + 1
        best, outside = at_reflected < values[0], at_reflected < values[n]
        if not best and at_reflected < values[n - 1]:
            values[n] = at_reflected
            _set(corners, n, reflected)
            continue
        # expanded beyond the best, or contracted from a point that is hardly better than the worst
        factor = -2.0 if best else (-0.5 if outside else 0.5)
        for j in range(n):
            tried[j] = middle[j] + factor * (corners[n, j] - middle[j])
        at_tried = rank(frame, tried)
        if at_tried < at_reflected and at_tried < values[n]:
            values[n] = at_tried
            _set(corners, n, tried)
        elif best:
            values[n] = at_reflected
            _set(corners, n, reflected)
        else:
            for i in range(1, n + 1):
                for j in range(n):
                    corners[i, j] = corners[0, j] + 0.5 * (corners[i, j] - corners[0, j])
            unknown = 1
    return False


@inner
def _set(corners, i, corner):
    for j in range(corner.size):
        corners[i, j] = corner[j]


@inner
def _sort(corners, values):
    """Sort the ``values`` and their ``corners`` by insertion; equal ones keep their order."""
    for last in range(1, values.size):
        i = last
        while i > 0 and values[i] < values[i - 1]:
            values[i], values[i - 1] = values[i - 1], values[i]
            for j in range(corners.shape[1]):
                corners[i, j], corners[i - 1, j] = corners[i - 1, j], corners[i, j]
            i -= 1


def _fit(frame: Frame, end: str, start: np.ndarray) -> tuple[np.ndarray, float, bool]:
    """(O2, O3, EE) (3, 2) in m, the value, and whether the search from ``start`` (3, 2) ended."""
    first, ended = objective.variables(frame, start, end), False
    corners, values = np.empty((first.size + 1, first.size)), np.empty(first.size + 1)
    scratch = np.empty((3, first.size))
    corners[0] = first
    for step, extent in objective.RUNS[end]:
        ended = _simplex(frame, step, extent, corners, values, scratch)
    return objective.nodes_of(frame, corners[0]), float(values[0]), ended


class FittedSequence(NamedTuple):
    """Fit of a sequence of F frames; rows of gaps are NaN in ``nodes``, ``q`` and ``objective``."""

    nodes: np.ndarray  # (F, 4, 2) O1, O2, O3, EE in the plane, m
    q: np.ndarray  # (F, 3) joint angles from the headings of the fitted segments, rad
    objective: np.ndarray  # (F,) value of Eq. (KinObj), m
    lost: int  # frames for which the fit before was no start


def fit_sequence(
    clouds: Sequence[np.ndarray],
    o1: np.ndarray,
    ee: np.ndarray,
    chain: PlanarChain,
    options: ArticulationSection,
    q_start: np.ndarray,
    *,
    take: str = "",
) -> FittedSequence:
    """Solve Eq. (KinObj) frame by frame through one take.

    ``clouds``: per frame the arm's points (I, 2) in the plane, m; ``o1`` (2,), ``ee`` (F, 2) m as
    commanded; ``q_start`` (3,) rad. The first fit starts around it, each later one from the fit
    before carried along with the command, or, where that leads to no arm, from all poses that join
    O1 and EE. Raises RecordingError (take, frame) for too many frames with few points and for an EE
    out of reach, SolverError for a search that does not end.
    """
    end, gammas = options.end_point, (options.gamma1, options.gamma2)
    bounds = chain.lengths[:, None] * np.array([1 - options.length_range, 1 + options.length_range])
    nodes, values = np.full((len(ee), 4, 2), np.nan), np.full(len(ee), np.nan)
    turned = np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]) * SPREAD
    starts, last, gap, least, lost = chain.points(q_start + turned)[:, 1:], 0, 0, np.inf, 0
    for frame, (cloud, goal) in enumerate(zip(clouds, ee, strict=True)):
        where = {"take": take, "frame": frame}
        gap = gap + 1 if len(cloud) < max(options.minimum_points, 1) else 0
        if gap > options.max_gap:
            message = f"more than {options.max_gap} depth frames in a row have fewer than"
            raise RecordingError(f"{message} {options.minimum_points} points of the arm", **where)
        if gap:
            continue
        if not (np.isfinite(goal).all() and np.isfinite(cloud).all()):
            message = "the end-effector's position or a point of the arm is not finite"
            raise RecordingError(message, **where)
        starts = starts + np.array([[0.0], [1.0], [1.0]]) * (goal - ee[last])
        problem = objective.frame_of(cloud.T, o1, goal, bounds, gammas)
        fits = [_fit(problem, end, start) for start in starts]
        if min(fit[1] for fit in fits) > LOST * least:
            lost += 1
            poses = _joining_poses(o1, goal, chain.lengths)
            fits += [_fit(problem, end, start) for start in poses]
        best, value, ended = min(fits, key=lambda fit: fit[1])
        least = min(least, value)
        if value >= INFEASIBLE:
            message = "no pose of the arm within the range of lengths joins O1 and EE: check the"
            where["distance"] = round(float(np.hypot(*(goal - o1))), 4)
            raise RecordingError(f"{message} trajectory and the clock offset", **where)
        if not ended:
            message = "the articulation's simplex search did not end"
            raise SolverError(message, **where, step=MAX_STEPS)
        nodes[frame], values[frame] = np.vstack([o1, best]), value
        starts, last = best[None], frame
    steps = np.diff(nodes, axis=1)
    q = chain.joints_from_segments(np.arctan2(steps[..., 0], steps[..., 1]))
    return FittedSequence(nodes, q, values, lost)


def _joining_poses(o1: np.ndarray, ee: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """(P, 3, 2) positions of O2, O3 and EE of poses that join O1 and EE, O3 on either side."""
    psi = np.arange(POSES) * (2 * np.pi / POSES)
    o2 = o1 + lengths[0] * np.stack([np.sin(psi), np.cos(psi)], axis=-1)
    reach = np.linalg.norm(ee - o2, axis=1)
    along = (reach**2 + lengths[1] ** 2 - lengths[2] ** 2) / (2 * reach)
    joins = np.abs(along) <= lengths[1]
    o2, reach, along = o2[joins], reach[joins, None], along[joins, None]
    towards = (ee - o2) / reach
    aside = np.sqrt(lengths[1] ** 2 - along**2) * np.stack([towards[:, 1], -towards[:, 0]], axis=-1)
    ends = np.broadcast_to(ee, o2.shape)
    return np.concatenate(
        [np.stack([o2, o2 + along * towards + side, ends], axis=1) for side in (aside, -aside)]
    )


def articulate_rows(
    rows: pd.DataFrame,
    clouds: Sequence[np.ndarray],
    arm: Arm,
    joints: Sequence[str],
    trajectory: pd.DataFrame,
    options: ArticulationSection,
    start: np.ndarray,
) -> pd.DataFrame:
    """Return the rows of the table ``angles`` of one take by :func:`fit_sequence`, without gaps:
    ``rows`` of the table ``frames``, the table ``trajectory`` and the first frame's ``start`` (3,).
    """
    ee = [np.interp(rows["t"], trajectory["t"], trajectory[f"x:{row}"]) for row in ("x", "z")]
    given = arm.chain.origin, np.stack(ee, axis=-1), arm.chain, options, start
    fitted = fit_sequence(clouds, *given, take=rows["take"].iloc[0])
    names = [f"{axis}{node}" for node in ("2", "3", "e") for axis in "xz"]
    fit = dict(zip(names, fitted.nodes[:, 1:].reshape(-1, 6).T, strict=True))
    fit |= {"points": [len(cloud) for cloud in clouds], "objective": fitted.objective}
    table = rows[["take", "part", "frame", "t"]].assign(**spread("q", joints, fitted.q), **fit)
    return table[np.isfinite(fitted.objective)]
