"""Joint angles of the arm in a depth camera's points by minimising Eq. (KinObj) in each frame.

The tool ends at the commanded end-effector, as in the paper, or its end is fitted. A fitted tool
has its nominal length, because a free length would grow to its bound, and an asymmetry for each
half. The objective jumps if a point changes its segment, so the Nelder–Mead simplex minimises it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import Arm
from pipeline.core.columns import spread
from pipeline.core.compiled import compiled, inner
from pipeline.core.elementary import sine_cosine
from pipeline.core.errors import RecordingError, SolverError
from pipeline.core.options.analysis import ArticulationSection

INFEASIBLE = 1e3  # m; above the objective of every pose within the bounds
STEP = 0.02  # m; first extent of the simplex: motion of a node between frames at 30 Hz
STRETCH = (
    np.pi / 2 / STEP
)  # 1/m; a change of λ by STEP moves a length from nominal to its bound
# first and last extent of the simplex in each run, m; a wide first simplex escapes local minima
RUNS = {
    "commanded": ((STEP, 1e-3), (-STEP / 2, 1e-5)),
    "fitted": ((2 * STEP, 4e-3), (-2 * STEP, 4e-3), (STEP, 1e-4)),
}
MAX_STEPS = 2000  # of the simplex
START_SPREAD = (
    0.15  # rad; offset of the first frame's start poses from the commanded pose
)
LOST = 2.0  # objective, in least objectives of the take, above which the arm counts as lost
LOST_HEADINGS = (
    24  # headings of the first segment from which a search for a lost arm starts
)
SIGN = np.int64(-(2**63))  # sign bit of a 64-bit float


class Frame(NamedTuple):
    """Points, known nodes and options of one frame, and buffers of the compiled functions."""

    points: np.ndarray  # (2, I) x and z, m
    nodes: np.ndarray  # (4, 2) O1, O2, O3, EE, m; O1 and the commanded EE are inputs
    bounds: np.ndarray  # (3, 2) of the segments' lengths, m
    gamma1: float  # weight of the mean distance
    gamma2: float  # weight of the asymmetry
    buffer: (
        np.ndarray
    )  # (5, I) signed squared distances by segment, m²; last row: distances, m
    bits: np.ndarray  # (5, I) ``buffer`` viewed as integers


def frame_of(
    points: np.ndarray,
    o1: np.ndarray,
    ee: np.ndarray,
    bounds: np.ndarray,
    gammas: tuple,
) -> Frame:
    """Return the frame with new buffers; ``gammas`` are the weights γ1 and γ2."""
    arrays = (
        np.array(array, order="C") for array in (points, [o1, o1, o1, ee], bounds)
    )
    buffer = np.empty((5, points.shape[1]))
    return Frame(*arrays, *gammas, buffer, buffer.view(np.int64))


@inner
def rank(frame: Frame, v: np.ndarray) -> float:
    """Return the objective of Eq. (KinObj) in m. A length outside its bounds gives INFEASIBLE plus
    the excess, so that feasible poses rank first (feasibility rules, Deb 2000).

    The commanded end has v = (O2, O3) in m. The fitted end has v = (λ1, λ2, l1ψ1, l2ψ2, l3ψ3), l
    nominal lengths, ψ headings; its lengths l(1 + r·sin(STRETCH·λ)) keep their bounds (James and
    Roos 1975). A point nearest to a node belongs to both segments.
    """
    nodes, bounds, excess, pieces = frame.nodes, frame.bounds, 0.0, v.size - 1
    for j in range(3):
        if pieces == 4:
            middle, half = (
                0.5 * (bounds[j, 0] + bounds[j, 1]),
                0.5 * (bounds[j, 1] - bounds[j, 0]),
            )
            stretched, _ = sine_cosine(STRETCH * v[j] if j < 2 else 0.0)
            sine, cosine = sine_cosine(v[j + 2] / middle)
            length = middle + half * stretched
            nodes[j + 1, 0] = nodes[j, 0] + length * sine
            nodes[j + 1, 1] = nodes[j, 1] + length * cosine
        else:
            if j < 2:
                nodes[j + 1, 0], nodes[j + 1, 1] = v[2 * j], v[2 * j + 1]
            ux, uz = nodes[j + 1, 0] - nodes[j, 0], nodes[j + 1, 1] - nodes[j, 1]
            length = np.sqrt(ux**2 + uz**2)
            excess += max(bounds[j, 0] - length, length - bounds[j, 1], 0.0)
    if excess > 0.0:
        return INFEASIBLE + excess
    x, z, signed = frame.points[0], frame.points[1], frame.buffer
    _assign(x, z, nodes, signed[0], signed[1], signed[2], signed[4])
    if pieces == 4:  # points beyond the middle of the tool
        ax, az, bx, bz = nodes[2, 0], nodes[2, 1], nodes[3, 0], nodes[3, 1]
        for i in range(x.size):
            aside = (x[i] - 0.5 * (ax + bx)) * (bx - ax) + (z[i] - 0.5 * (az + bz)) * (
                bz - az
            )
            signed[3, i] = signed[2, i] if aside > 0.0 else 0.0
            signed[2, i] = 0.0 if aside > 0.0 else signed[2, i]
    asymmetry = 0.0
    for j in range(pieces):
        above, under = _greatest(signed[j], frame.bits[j])
        asymmetry += abs(np.sqrt(above) - np.sqrt(under))
    return frame.gamma1 * _sum(signed[4]) / x.size + frame.gamma2 * asymmetry


@inner
def _assign(x, z, nodes, first, second, third, distance):
    """Write each point's distance to its nearest segment, and the squared distance: positive above
    the line, negative below, 0 for the other segments. The loop has no branch, so it is vectorised.
    """
    o1, o2 = (nodes[0, 0], nodes[0, 1]), (nodes[1, 0], nodes[1, 1])
    o3, ee = (nodes[2, 0], nodes[2, 1]), (nodes[3, 0], nodes[3, 1])
    for i in range(x.size):
        to_first, side_first = _to_segment(x[i], z[i], o1, o2)
        to_second, side_second = _to_segment(x[i], z[i], o2, o3)
        to_third, side_third = _to_segment(x[i], z[i], o3, ee)
        nearest = to_first if to_first < to_second else to_second
        nearest = nearest if nearest < to_third else to_third
        distance[i] = np.sqrt(nearest)
        squared = nearest if to_first == nearest else 0.0
        first[i] = squared if side_first > 0.0 else -squared
        squared = nearest if to_second == nearest else 0.0
        second[i] = squared if side_second > 0.0 else -squared
        squared = nearest if to_third == nearest else 0.0
        third[i] = squared if side_third > 0.0 else -squared


@inner
def _to_segment(x, z, start, end):
    """Return the squared distance to the segment and the signed side of the segment's line."""
    ux, uz = end[0] - start[0], end[1] - start[1]
    wx, wz, ex, ez = x - start[0], z - start[1], x - end[0], z - end[1]
    squared, along, side = ux * ux + uz * uz, wx * ux + wz * uz, wx * uz - wz * ux
    from_start, from_end = wx * wx + wz * wz, ex * ex + ez * ez
    inside = from_end if along >= squared else side * side * (1.0 / squared)
    return from_start if along <= 0.0 else inside, side


@inner
def _greatest(signed, bits):
    """Return the greatest positive and the greatest negative magnitude; overwrites ``signed``."""
    above, under = np.int64(0), SIGN
    for i in range(signed.size):  # vectorised for integers
        above = bits[i] if bits[i] > above else above
        under = bits[i] ^ SIGN if bits[i] ^ SIGN > under else under
    bits[0] = above
    greatest = signed[0]
    bits[0] = under ^ SIGN
    return greatest, (-signed[0] if signed[0] < 0.0 else 0.0)


@inner
def _sum(values):
    """Return the sum of ``values`` by four independent partial sums."""
    a = b = c = d = 0.0
    whole = values.size - values.size % 4
    for i in range(0, whole, 4):
        a, b, c, d = (
            a + values[i],
            b + values[i + 1],
            c + values[i + 2],
            d + values[i + 3],
        )
    for i in range(whole, values.size):
        a += values[i]
    return (a + b) + (c + d)


def variables(frame: Frame, nodes: np.ndarray, end: str) -> np.ndarray:
    """Return the argument v of :func:`rank` for ``nodes`` (3, 2) O2, O3, EE in m and ``end``."""
    if end == "commanded":
        return nodes[:2].ravel()
    x, z = np.diff(np.vstack([frame.nodes[0], nodes]), axis=0).T
    middle, half = frame.bounds.mean(axis=1), np.diff(frame.bounds)[:, 0] / 2
    share = np.clip(((np.hypot(x, z) - middle) / half)[:2], -1.0, 1.0)
    return np.concatenate([np.arcsin(share) / STRETCH, middle * np.arctan2(x, z)])


def nodes_of(frame: Frame, v: np.ndarray) -> np.ndarray:
    """Return the nodes (3, 2) O2, O3 and EE, m, of a pose ``v`` of :func:`rank`."""
    if v.size == 4:
        return np.vstack([v.reshape(2, 2), frame.nodes[3]])
    middle, half = frame.bounds.mean(axis=1), np.diff(frame.bounds)[:, 0] / 2
    psi, lengths = (
        v[2:] / middle,
        middle + half * np.append(np.sin(STRETCH * v[:2]), 0.0),
    )
    steps = lengths[:, None] * np.stack([np.sin(psi), np.cos(psi)], axis=-1)
    return frame.nodes[0] + np.cumsum(steps, axis=0)


@compiled
def _simplex(frame, step, extent, corners, values):
    """Run the simplex of Nelder and Mead (1965), coefficients 1, 2, ½, ½, from ``corners[0]``;
    return True if its size fell to ``extent`` in every variable.

    ``corners`` (n+4, n) and ``values`` (n+1,) are overwritten; the best corner is first, the last
    three rows are a buffer. Loops compile four times as fast as NumPy's array expressions.
    """
    n = values.size - 1
    middle, reflected, tried = corners[n + 1], corners[n + 2], corners[n + 3]
    for i in range(1, n + 1):
        _set(corners, i, corners[0])
        corners[i, i - 1] += step
    unknown = 0  # index of the first corner without a value
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
        # expansion, or contraction outside or inside
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
                    corners[i, j] = corners[0, j] + 0.5 * (
                        corners[i, j] - corners[0, j]
                    )
            unknown = 1
    return False


@inner
def _set(corners, i, corner):
    for j in range(corner.size):
        corners[i, j] = corner[j]


@inner
def _sort(corners, values):
    """Sort the ``values`` and their ``corners`` by insertion; equal values keep their order."""
    for last in range(1, values.size):
        i = last
        while i > 0 and values[i] < values[i - 1]:
            values[i], values[i - 1] = values[i - 1], values[i]
            for j in range(corners.shape[1]):
                corners[i, j], corners[i - 1, j] = corners[i - 1, j], corners[i, j]
            i -= 1


def _fit(frame: Frame, end: str, start: np.ndarray) -> tuple[np.ndarray, float, bool]:
    """Return O2, O3, EE (3, 2) in m, the objective in m, and True if the search converged."""
    first, ended = variables(frame, start, end), False
    corners, values = np.tile(first, (first.size + 4, 1)), np.empty(first.size + 1)
    for step, extent in RUNS[end]:
        ended = _simplex(frame, step, extent, corners, values)
    return nodes_of(frame, corners[0]), float(values[0]), ended


class FittedSequence(NamedTuple):
    """Fit of a sequence of F frames; rows of gaps are NaN in ``nodes``, ``q`` and ``objective``."""

    nodes: np.ndarray  # (F, 4, 2) O1, O2, O3, EE in the plane, m
    q: np.ndarray  # (F, 3) joint angles from the headings of the fitted segments, rad
    objective: np.ndarray  # (F,) value of Eq. (KinObj), m


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

    ``clouds`` has the arm's points (I, 2) of each frame in the plane, m; ``o1`` (2,) and ``ee``
    (F, 2) are commanded, m; ``q_start`` (3,) rad. The first search starts around ``q_start``, a
    later search from the previous fit moved with the command, and for a lost arm also from poses
    that join O1 and EE. Raises RecordingError (take, frame) for a long gap or an EE out of reach,
    SolverError for a search that does not converge.
    """
    end, gammas = options.end_point, (options.gamma1, options.gamma2)
    bounds = chain.lengths[:, None] * np.array(
        [1 - options.length_range, 1 + options.length_range]
    )
    nodes, values = np.full((len(ee), 4, 2), np.nan), np.full(len(ee), np.nan)
    turned = (
        np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
        * START_SPREAD
    )
    starts, last, gap, least = chain.points(q_start + turned)[:, 1:], 0, 0, np.inf
    for frame, (cloud, goal) in enumerate(zip(clouds, ee, strict=True)):
        where = {"take": take, "frame": frame}
        gap = gap + 1 if len(cloud) < options.minimum_points else 0
        if gap > options.max_gap:
            message = (
                f"more than {options.max_gap} depth frames in a row have fewer than"
            )
            raise RecordingError(
                f"{message} {options.minimum_points} points of the arm", **where
            )
        if gap:
            continue
        starts = starts + np.array([[0.0], [1.0], [1.0]]) * (goal - ee[last])
        problem = frame_of(cloud.T, o1, goal, bounds, gammas)
        fits = [_fit(problem, end, start) for start in starts]
        if min(fit[1] for fit in fits) > LOST * least:
            fits += [
                _fit(problem, end, s) for s in _joining_poses(o1, goal, chain.lengths)
            ]
        best, value, ended = min(fits, key=lambda fit: fit[1])
        least = min(least, value)
        if value >= INFEASIBLE:
            message = "no arm in length_range joins O1 and EE; check trajectory and clock offset"
            raise RecordingError(
                message, **where, distance=f"{np.hypot(*(goal - o1)):.4f} m"
            )
        if not ended:
            raise SolverError(
                "the fit of the arm did not converge", **where, step=MAX_STEPS
            )
        nodes[frame], values[frame] = np.vstack([o1, best]), value
        starts, last = best[None], frame
    x, z = np.moveaxis(np.diff(nodes, axis=1), -1, 0)
    return FittedSequence(nodes, chain.joints_from_segments(np.arctan2(x, z)), values)


def _joining_poses(o1: np.ndarray, ee: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return O2, O3 and EE (P, 3, 2) in m of poses that join O1 and EE, O3 on either side."""
    psi = np.arange(LOST_HEADINGS) * (2 * np.pi / LOST_HEADINGS)
    o2 = o1 + lengths[0] * np.stack([np.sin(psi), np.cos(psi)], axis=-1)
    reach = np.linalg.norm(ee - o2, axis=1)
    along = (reach**2 + lengths[1] ** 2 - lengths[2] ** 2) / (2 * reach)
    joins = np.abs(along) <= lengths[1]
    o2, reach, along = o2[joins], reach[joins, None], along[joins, None]
    towards = (ee - o2) / reach
    aside = np.sqrt(lengths[1] ** 2 - along**2) * np.stack(
        [towards[:, 1], -towards[:, 0]], axis=-1
    )
    ends, middle = np.full_like(o2, ee), o2 + along * towards
    return np.concatenate(
        [np.stack([o2, middle + s, ends], axis=1) for s in (aside, -aside)]
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
    """Return the rows of the table ``angles`` of one take by :func:`fit_sequence`, without gaps;
    ``rows`` are of the table ``frames``, ``start`` (3,) rad is the pose about the first frame.
    """
    ee = [
        np.interp(rows["t"], trajectory["t"], trajectory[f"x:{row}"])
        for row in ("x", "z")
    ]
    motion = arm.chain.origin, np.stack(ee, axis=-1), arm.chain, options, start
    fitted = fit_sequence(clouds, *motion, take=rows["take"].iloc[0])
    names = [f"{axis}{node}" for node in ("2", "3", "e") for axis in "xz"]
    fit = dict(zip(names, fitted.nodes[:, 1:].reshape(-1, 6).T, strict=True))
    fit |= {"points": [len(cloud) for cloud in clouds], "objective": fitted.objective}
    table = rows[["take", "part", "frame", "t"]].assign(
        **spread("q", joints, fitted.q), **fit
    )
    return table[np.isfinite(fitted.objective)]
