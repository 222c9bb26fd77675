"""The articulation of the arm in a point cloud by least squares: the paper's Eq. (KinObj), solved by a Nelder–Mead simplex.

Nodes O1 (fixed) and EE (from the desired trajectory) are known; O2 and O3 are found. The objective has kinks and jumps (a point
that changes its segment changes a maximum), so a search that only compares values is used. That also gives the bounds on the
lengths of the segments their exact and simplest form: any pose within the bounds ranks before any pose outside, and of two
outside the one that violates them less (feasibility rules, Deb 2000); no weight has to be chosen and no bound is overstepped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from pipeline.arm.chain import PlanarChain
from pipeline.errors import RecordingError, SolverError

INFEASIBLE = 1e3  # m; above every value of the objective that points within reach of an arm can give
SPREAD = 0.15  # rad; how far from the nominal pose the cold starts lie: lag and drift of the arm against its trajectory
TOLERANCE = 1e-5  # m; extent of the simplex at which a search has ended: 1e-4 rad on a link, a hundredth of the errors of the sensor
STEP = 0.02  # m; first extent of the simplex: how far a node moves between frames at 30 Hz
MAX_STEPS = 2000
LOST = 2.0  # an objective of more than so many times the least of the take: not the arm; noise alone varies it by less
POSES = 24  # directions of the first segment that an arm which was lost is looked for in


@dataclass(frozen=True)
class ArticulationOptions:
    """Weights of the objective and what a frame has to have.

    Both terms are lengths. γ1 weighs a mean over points, γ2 a sum over the three segments; 1 and 1/3 weigh two means alike.
    """

    gamma1: float = 1.0
    gamma2: float = 1.0 / 3.0
    length_range: float = 0.05  # each segment's length within ± this fraction of the nominal one
    min_points: int = 150  # a frame with fewer points of the arm is a gap
    max_gap: int = 3  # frames in a row that may be gaps


@dataclass(frozen=True)
class Articulation:
    """Fit of a sequence of F frames; rows of gaps are NaN in ``nodes``, ``q`` and ``objective``.

    ``nodes`` (F, 4, 2) O1, O2, O3, EE in the plane, m; ``q`` (F, 3) joint angles from the headings of the fitted segments, rad;
    ``objective`` (F,) value of Eq. (KinObj), m; ``points`` (F,) points a frame; ``gaps`` the number of frames without a fit; ``lost``
    the number of those for which the fit before was no start.
    """

    nodes: np.ndarray
    q: np.ndarray
    objective: np.ndarray
    points: np.ndarray
    gaps: int
    lost: int


def fit_sequence(
    clouds: Sequence[np.ndarray],
    o1: np.ndarray,
    ee: np.ndarray,
    chain: PlanarChain,
    options: ArticulationOptions,
    q_start: np.ndarray,
    *,
    take: str = "",
) -> Articulation:
    """Eq. (KinObj) frame by frame through one take.

    ``clouds``: per frame the arm's points (I, 2) in the plane, m; ``o1`` (2,), ``ee`` (F, 2) m; ``q_start`` (3,) rad the nominal pose
    of the first frame. The first fit starts from poses around it, each later one from the fit before, its O3 carried along with EE; where
    that leads to no arm, as it may after a gap, from all poses that join O1 and EE.
    Frames with fewer than ``min_points`` points are gaps, counted. Raises RecordingError (take, frame) for more than ``max_gap`` of them
    in a row and for an EE that is missing or that the segments cannot reach, SolverError for a search that does not end.
    """
    if len(clouds) != len(ee):
        raise RecordingError(f"{len(ee)} end-effector positions for {len(clouds)} point clouds", take=take)
    if not np.isfinite(ee).all():
        raise RecordingError("the end-effector's position is not finite", take=take, frame=int(np.argmax(~np.isfinite(ee).all(axis=1))))
    bounds = chain.lengths[:, None] * np.array([1 - options.length_range, 1 + options.length_range])
    nodes, objective = np.full((len(ee), 4, 2), np.nan), np.full(len(ee), np.nan)
    number = np.array([len(cloud) for cloud in clouds], dtype=int)
    starts, last, gap = _cold_starts(chain, q_start), 0, 0
    least, lost = np.inf, 0
    for frame, cloud in enumerate(clouds):
        gap = gap + 1 if number[frame] < max(options.min_points, 1) else 0
        if gap > options.max_gap:
            raise RecordingError(
                f"more than {options.max_gap} depth frames in a row have fewer than {options.min_points} points of the arm",
                take=take,
                frame=frame,
            )
        if gap:
            continue
        if not np.isfinite(cloud).all():
            raise RecordingError("a point of the arm is not finite", take=take, frame=frame)
        starts = starts + np.concatenate([[0.0, 0.0], ee[frame] - ee[last]])
        points = np.ascontiguousarray(cloud, dtype=float)
        fits = [_fit(points, o1, ee[frame], start, bounds, options.gamma1, options.gamma2) for start in starts]
        if min(fit[1] for fit in fits) > LOST * least:
            lost += 1
            poses = _joining_poses(o1, ee[frame], chain.lengths)
            fits += [_fit(points, o1, ee[frame], start, bounds, options.gamma1, options.gamma2) for start in poses]
        best, value, ended = min(fits, key=lambda fit: fit[1])
        least = min(least, value)
        if value >= INFEASIBLE:
            raise RecordingError(
                "no pose of the arm within the range of lengths joins O1 and EE: check the trajectory and the clock offset",
                take=take,
                frame=frame,
                distance=round(float(np.hypot(*(ee[frame] - o1))), 4),
            )
        if not ended:
            raise SolverError("the articulation's simplex search did not end", take=take, frame=frame, step=MAX_STEPS)
        nodes[frame], objective[frame] = [o1, best[:2], best[2:], ee[frame]], value
        starts, last = best[None], frame
    steps = np.diff(nodes, axis=1)
    q = chain.joints_from_segments(np.arctan2(steps[..., 0], steps[..., 1]))
    return Articulation(nodes, q, objective, number, int(np.isnan(objective).sum()), lost)


def _cold_starts(chain: PlanarChain, q: np.ndarray) -> np.ndarray:
    """(5, 4) positions of O2 and O3 at the nominal pose and with one of the first two joints turned either way."""
    turned = np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]) * SPREAD
    return chain.points(q + turned)[:, 1:3].reshape(-1, 4)


def _joining_poses(o1: np.ndarray, ee: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """(P, 4) positions of O2 and O3 of poses that join O1 and EE, on a grid of directions of the first segment, O3 on either side."""
    psi = np.arange(POSES) * (2 * np.pi / POSES)
    o2 = o1 + lengths[0] * np.stack([np.sin(psi), np.cos(psi)], axis=-1)
    reach = np.linalg.norm(ee - o2, axis=1)
    along = (reach**2 + lengths[1] ** 2 - lengths[2] ** 2) / (2 * reach)
    joins = np.abs(along) <= lengths[1]
    o2, reach, along = o2[joins], reach[joins, None], along[joins, None]
    towards = (ee - o2) / reach
    aside = np.sqrt(lengths[1] ** 2 - along**2) * np.stack([towards[:, 1], -towards[:, 0]], axis=-1)
    return np.concatenate([np.hstack([o2, o2 + along * towards + side]) for side in (aside, -aside)])


@njit(cache=True)
def rank_value(
    points: np.ndarray, o1: np.ndarray, ee: np.ndarray, v: np.ndarray, bounds: np.ndarray, gamma1: float, gamma2: float
) -> float:
    """Eq. (KinObj), m, at ``v`` = (O2, O3); outside the ``bounds`` (3, 2) on the lengths INFEASIBLE plus the violation in m.

    A point belongs to the segment nearest to it, one nearest to a common node to both. d_a and d_u are the greatest distances of
    a segment's points on either side of its line, 0 where there are none.
    """
    xs = (o1[0], v[0], v[2], ee[0])
    zs = (o1[1], v[1], v[3], ee[1])
    violation = 0.0
    squared = np.empty(3)
    for j in range(3):
        squared[j] = (xs[j + 1] - xs[j]) ** 2 + (zs[j + 1] - zs[j]) ** 2
        length = np.sqrt(squared[j])
        violation += max(bounds[j, 0] - length, 0.0) + max(length - bounds[j, 1], 0.0)
    if not violation == 0.0:
        return INFEASIBLE + violation
    total = 0.0
    above, under = np.zeros(3), np.zeros(3)
    distance, side = np.empty(3), np.empty(3)
    for i in range(points.shape[0]):
        px, pz = points[i, 0], points[i, 1]
        nearest = np.inf
        for j in range(3):
            ux, uz = xs[j + 1] - xs[j], zs[j + 1] - zs[j]
            wx, wz = px - xs[j], pz - zs[j]
            along = wx * ux + wz * uz
            side[j] = wx * uz - wz * ux
            # to the node itself beyond an end, so that both of its segments find the very same number
            if along <= 0.0:
                distance[j] = wx * wx + wz * wz
            elif along >= squared[j]:
                distance[j] = (px - xs[j + 1]) ** 2 + (pz - zs[j + 1]) ** 2
            else:
                distance[j] = side[j] * side[j] / squared[j]
            nearest = min(nearest, distance[j])
        total += np.sqrt(nearest)
        for j in range(3):
            if distance[j] == nearest:
                if side[j] > 0.0:
                    above[j] = max(above[j], nearest)
                else:
                    under[j] = max(under[j], nearest)
    asymmetry = 0.0
    for j in range(3):
        asymmetry += abs(np.sqrt(above[j]) - np.sqrt(under[j]))
    return gamma1 * total / points.shape[0] + gamma2 * asymmetry


@njit(cache=True)
def _fit(
    points: np.ndarray, o1: np.ndarray, ee: np.ndarray, start: np.ndarray, bounds: np.ndarray, gamma1: float, gamma2: float
) -> tuple[np.ndarray, float, bool]:
    """(O2, O3), value, ended: Nelder–Mead from ``start`` (4,), and once more from where it ends with the simplex turned the other way.

    More restarts lower the objective by about 0.1 mm and the error of the angles not at all.
    """
    once, _, _ = _simplex(points, o1, ee, start, STEP, bounds, gamma1, gamma2)
    return _simplex(points, o1, ee, once, -STEP, bounds, gamma1, gamma2)


@njit(cache=True)
def _simplex(
    points: np.ndarray, o1: np.ndarray, ee: np.ndarray, start: np.ndarray, step: float, bounds: np.ndarray, gamma1: float, gamma2: float
) -> tuple[np.ndarray, float, bool]:
    """One run of Nelder and Mead (1965), coefficients 1, 2, ½, ½, until the simplex is smaller than TOLERANCE in every variable.

    The values do not decide when to end: across a jump of the objective they never meet.
    """
    n = start.size
    corners = np.empty((n + 1, n))
    values = np.empty(n + 1)
    for i in range(n + 1):
        corners[i] = start
        if i > 0:
            corners[i, i - 1] += step
        values[i] = rank_value(points, o1, ee, corners[i], bounds, gamma1, gamma2)
    for _ in range(MAX_STEPS):
        order = np.argsort(values, kind="mergesort")
        corners, values = corners[order], values[order]
        if np.abs(corners[1:] - corners[0]).max() <= TOLERANCE:
            return corners[0].copy(), values[0], True
        middle = corners[:n].sum(axis=0) / n
        reflected = 2.0 * middle - corners[n]
        at_reflected = rank_value(points, o1, ee, reflected, bounds, gamma1, gamma2)
        if at_reflected < values[0]:
            expanded = 3.0 * middle - 2.0 * corners[n]
            at_expanded = rank_value(points, o1, ee, expanded, bounds, gamma1, gamma2)
            if at_expanded < at_reflected:
                corners[n], values[n] = expanded, at_expanded
            else:
                corners[n], values[n] = reflected, at_reflected
            continue
        if at_reflected < values[n - 1]:
            corners[n], values[n] = reflected, at_reflected
            continue
        outside = at_reflected < values[n]
        contracted = 0.5 * (middle + (reflected if outside else corners[n]))
        at_contracted = rank_value(points, o1, ee, contracted, bounds, gamma1, gamma2)
        if at_contracted < min(at_reflected, values[n]):
            corners[n], values[n] = contracted, at_contracted
            continue
        for i in range(1, n + 1):
            corners[i] = 0.5 * (corners[0] + corners[i])
            values[i] = rank_value(points, o1, ee, corners[i], bounds, gamma1, gamma2)
    return corners[0].copy(), values[0], False
