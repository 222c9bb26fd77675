"""Joint angles of the arm in a depth camera's points by minimising Eq. (KinObj) in each frame.

The tool ends at the commanded end-effector, as in the paper, or its end is fitted. A fitted tool
has its nominal length, because a free length would grow to its bound, and an asymmetry for each
half. The objective jumps if a point changes its segment, so the Nelder–Mead simplex minimises it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.core.compiled import compiled, inner
from pipeline.core.elementary import sine_cosine
from pipeline.core.errors import RecordingError, SolverError
from pipeline.core.options.analysis import ArticulationSection

INFEASIBLE = 1e3  # m; above the objective of every pose within the bounds
STEP = 0.02  # m; first extent of the simplex: motion of a node between frames at 30 Hz
# 1/m; a change of λ by STEP moves a length from nominal to its bound
STRETCH = np.pi / 2 / STEP
# first and last extent of the simplex in each run, m; a wide first simplex escapes local minima
RUNS = {
    "commanded": ((STEP, 1e-3), (-STEP / 2, 1e-5)),
    "fitted": ((2 * STEP, 4e-3), (-2 * STEP, 4e-3), (STEP, 1e-4)),
}
MAX_STEPS = 2000  # of the simplex
# rad; offset of the first frame's start poses from the commanded pose
START_SPREAD = 0.15
START_TURNS = np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
# O2, O3, EE: nodes that a search moves with the command, from the fit of the frame before
MOVED_NODES = np.array([[0.0], [1.0], [1.0]])
LOST = 2.0  # objective, in least objectives of the take, above which the arm counts as lost
# headings of the first segment from which a search for a lost arm starts
LOST_HEADINGS = 24
SIGN = np.int64(-(2**63))  # sign bit of a 64-bit float


class Frame(NamedTuple):
    """Points, known nodes and options of one frame, and buffers of the compiled functions."""

    points: np.ndarray  # (2, I) x and z, m
    nodes: np.ndarray  # (4, 2) O1, O2, O3, EE, m; O1 and the commanded EE are inputs
    bounds: np.ndarray  # (3, 2) of the segments' lengths, m
    gamma1: float  # weight of the mean distance
    gamma2: float  # weight of the asymmetry
    # (5, I) signed squared distances by segment, m²; last row: distances, m
    buffer: np.ndarray
    bits: np.ndarray  # (5, I) ``buffer`` viewed as integers


def frame_of(
    points: np.ndarray,
    o1: np.ndarray,
    ee: np.ndarray,
    bounds: np.ndarray,
    gammas: tuple,
) -> Frame:
    """Return the frame with new buffers; ``gammas`` are the weights γ1 and γ2."""
    buffer = np.empty((5, points.shape[1]))
    return Frame(
        np.array(points, order="C"),
        np.array([o1, o1, o1, ee]),
        np.array(bounds, order="C"),
        *gammas,
        buffer,
        buffer.view(np.int64),
    )


@inner
def rank(frame: Frame, v: np.ndarray) -> float:
    """Return the objective of Eq. (KinObj) in m. A length outside its bounds gives INFEASIBLE plus
    the excess, so that feasible poses rank first (feasibility rules, Deb 2000).

    The commanded end has v = (O2, O3) in m. The fitted end has v = (λ1, λ2, l1ψ1, l2ψ2, l3ψ3), l
    nominal lengths, ψ headings; its lengths l(1 + r·sin(STRETCH·λ)) keep their bounds (James and
    Roos 1975). A point nearest to a node belongs to both segments.
    """
    fitted_end = v.size == 5
    if fitted_end:
        _turn_nodes(frame, v)
    else:
        excess = _move_nodes(frame, v)
        if excess > 0.0:
            return INFEASIBLE + excess
    x = frame.points[0]
    z = frame.points[1]
    signed = frame.buffer
    _assign(x, z, frame.nodes, signed[0], signed[1], signed[2], signed[4])

    pieces = 3
    if fitted_end:
        pieces = 4
        _split_tool(frame)
    asymmetry = 0.0
    for j in range(pieces):
        above, under = _greatest(signed[j], frame.bits[j])
        asymmetry += abs(np.sqrt(above) - np.sqrt(under))
    mean_distance = frame.gamma1 * _sum(signed[4]) / x.size
    return mean_distance + frame.gamma2 * asymmetry


@inner
def _turn_nodes(frame, v):
    """Set the nodes of a pose ``v`` of the fitted end from its lengths and headings."""
    nodes = frame.nodes
    bounds = frame.bounds
    for j in range(3):
        shortest = bounds[j, 0]
        longest = bounds[j, 1]
        middle = 0.5 * (shortest + longest)
        half = 0.5 * (longest - shortest)
        stretch = STRETCH * v[j] if j < 2 else 0.0
        stretched, _ = sine_cosine(stretch)
        sine, cosine = sine_cosine(v[j + 2] / middle)
        length = middle + half * stretched
        nodes[j + 1, 0] = nodes[j, 0] + length * sine
        nodes[j + 1, 1] = nodes[j, 1] + length * cosine


@inner
def _move_nodes(frame, v):
    """Set O2 and O3 of a pose ``v`` of the commanded end; return the sum of the distances in m of
    the segments' lengths to their bounds.
    """
    nodes = frame.nodes
    bounds = frame.bounds
    excess = 0.0
    for j in range(2):
        nodes[j + 1, 0] = v[2 * j]
        nodes[j + 1, 1] = v[2 * j + 1]
    for j in range(3):
        x, z = _node(nodes, j)
        next_x, next_z = _node(nodes, j + 1)
        length = np.sqrt((next_x - x) ** 2 + (next_z - z) ** 2)
        excess += max(bounds[j, 0] - length, length - bounds[j, 1], 0.0)
    return excess


@inner
def _node(nodes, j):
    """Return x and z of a node in m."""
    return nodes[j, 0], nodes[j, 1]


@inner
def _split_tool(frame):
    """Move the points beyond the middle of the tool to the fourth row of the buffer."""
    x = frame.points[0]
    z = frame.points[1]
    signed = frame.buffer
    nodes = frame.nodes
    tool = signed[2]
    beyond = signed[3]
    start_x, start_z = _node(nodes, 2)
    end_x, end_z = _node(nodes, 3)
    middle_x = 0.5 * (start_x + end_x)
    middle_z = 0.5 * (start_z + end_z)
    way_x = end_x - start_x
    way_z = end_z - start_z
    for i in range(x.size):
        along = (x[i] - middle_x) * way_x + (z[i] - middle_z) * way_z
        is_beyond = along > 0.0
        beyond[i] = tool[i] if is_beyond else 0.0
        tool[i] = 0.0 if is_beyond else tool[i]


@inner
def _assign(x, z, nodes, first, second, third, distance):
    """Write each point's distance to its nearest segment, and the squared distance: positive above
    the line, negative below, 0 for the other segments. The loop has no branch, so it is vectorised.
    """
    o1 = _node(nodes, 0)
    o2 = _node(nodes, 1)
    o3 = _node(nodes, 2)
    ee = _node(nodes, 3)
    for i in range(x.size):
        to_first, side_first = _to_segment(x[i], z[i], o1, o2)
        to_second, side_second = _to_segment(x[i], z[i], o2, o3)
        to_third, side_third = _to_segment(x[i], z[i], o3, ee)

        nearest = to_first if to_first < to_second else to_second
        nearest = nearest if nearest < to_third else to_third
        distance[i] = np.sqrt(nearest)
        first[i] = _signed(nearest, to_first, side_first)
        second[i] = _signed(nearest, to_second, side_second)
        third[i] = _signed(nearest, to_third, side_third)


@inner
def _signed(nearest, to_segment, side):
    """Return ``nearest`` with the sign of ``side`` if it is the distance to the segment, else 0."""
    squared = nearest if to_segment == nearest else 0.0
    return squared if side > 0.0 else -squared


@inner
def _to_segment(x, z, start, end):
    """Return the squared distance to the segment and the signed side of the segment's line."""
    # of the segment; of the point from the segment's start and from its end
    ux = end[0] - start[0]
    uz = end[1] - start[1]
    wx = x - start[0]
    wz = z - start[1]
    ex = x - end[0]
    ez = z - end[1]

    squared = ux * ux + uz * uz
    along = wx * ux + wz * uz
    side = wx * uz - wz * ux
    from_start = wx * wx + wz * wz
    from_end = ex * ex + ez * ez

    inside = from_end if along >= squared else side * side * (1.0 / squared)
    return from_start if along <= 0.0 else inside, side


@inner
def _greatest(signed, bits):
    """Return the greatest positive and the greatest negative magnitude; overwrites ``signed``."""
    above = np.int64(0)
    under = SIGN
    for i in range(signed.size):  # vectorised for integers
        flipped = bits[i] ^ SIGN
        above = bits[i] if bits[i] > above else above
        under = flipped if flipped > under else under
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
        a += values[i]
        b += values[i + 1]
        c += values[i + 2]
        d += values[i + 3]
    for i in range(whole, values.size):
        a += values[i]
    return (a + b) + (c + d)


def variables(frame: Frame, nodes: np.ndarray, end: str) -> np.ndarray:
    """Return the argument v of :func:`rank` for ``nodes`` (3, 2) O2, O3, EE in m and ``end``."""
    if end == "commanded":
        return nodes[:2].ravel()
    all_nodes = np.vstack([frame.nodes[0], nodes])
    x, z = np.diff(all_nodes, axis=0).T
    middle, half = _lengths_of(frame)
    stretched = (np.hypot(x, z) - middle) / half
    share = np.clip(stretched[:2], -1.0, 1.0)
    lambdas = np.arcsin(share) / STRETCH
    arcs = middle * np.arctan2(x, z)
    return np.concatenate([lambdas, arcs])


def _lengths_of(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Return the middle and half of the range (3,) in m of the segments' lengths."""
    shortest, longest = frame.bounds.T
    return frame.bounds.mean(axis=1), (longest - shortest) / 2


def nodes_of(frame: Frame, v: np.ndarray) -> np.ndarray:
    """Return the nodes (3, 2) O2, O3 and EE, m, of a pose ``v`` of :func:`rank`."""
    if v.size == 4:
        return np.vstack([v.reshape(2, 2), frame.nodes[3]])
    middle, half = _lengths_of(frame)
    shares = np.sin(STRETCH * v[:2])
    stretched = np.append(shares, 0.0)
    lengths = middle + half * stretched
    headings = v[2:] / middle
    segments = lengths[:, None] * _directions(headings)
    return frame.nodes[0] + np.cumsum(segments, axis=0)


def _directions(psi: np.ndarray) -> np.ndarray:
    """Return the unit vectors (..., 2) x and z of headings ``psi`` (...) in rad."""
    return np.stack([np.sin(psi), np.cos(psi)], axis=-1)


@compiled
def _simplex(frame, step, extent, corners, values):
    """Run the simplex of Nelder and Mead (1965), coefficients 1, 2, ½, ½, from ``corners[0]``;
    return True if its size fell to ``extent`` in every variable.

    ``corners`` (n+4, n) and ``values`` (n+1,) are overwritten; the best corner is first, the last
    three rows are a buffer. Loops compile four times as fast as NumPy's array expressions.
    """
    n = values.size - 1
    middle = corners[n + 1]
    reflected = corners[n + 2]
    tried = corners[n + 3]
    for i in range(1, n + 1):
        _set(corners, i, corners[0])
        corners[i, i - 1] += step
    unknown = 0  # index of the first corner without a value
    for _ in range(MAX_STEPS):
        for i in range(unknown, n + 1):
            values[i] = rank(frame, corners[i])
        _sort(corners, values)
        if _sum_corners(corners, middle) <= extent:
            return True

        for j in range(n):
            middle[j] /= n
            reflected[j] = middle[j] - (corners[n, j] - middle[j])
        at_reflected = rank(frame, reflected)
        unknown = n + 1
        best = at_reflected < values[0]
        outside = at_reflected < values[n]
        if not best and at_reflected < values[n - 1]:
            values[n] = at_reflected
            _set(corners, n, reflected)
            continue

        if best:
            factor = -2.0  # expansion
        elif outside:
            factor = -0.5  # contraction outside
        else:
            factor = 0.5  # contraction inside
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
                    away = corners[i, j] - corners[0, j]
                    corners[i, j] = corners[0, j] + 0.5 * away
            unknown = 1
    return False


@inner
def _sum_corners(corners, middle):
    """Set ``middle`` (n,) to the sum of all corners but the worst; return the greatest distance of
    a variable from its value at the best corner.
    """
    size = 0.0
    n = middle.size
    for j in range(n):
        middle[j] = corners[0, j]
        for i in range(1, n):
            middle[j] += corners[i, j]
        for i in range(1, n + 1):
            size = max(size, abs(corners[i, j] - corners[0, j]))
    return size


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
            before = i - 1
            values[i], values[before] = values[before], values[i]
            for j in range(corners.shape[1]):
                coordinate = corners[i, j]
                corners[i, j] = corners[before, j]
                corners[before, j] = coordinate
            i = before


def _fit(frame: Frame, end: str, start: np.ndarray) -> tuple[np.ndarray, float, bool]:
    """Return O2, O3, EE (3, 2) in m, the objective in m, and True if the search converged."""
    first = variables(frame, start, end)
    corners = np.tile(first, (first.size + 4, 1))
    values = np.empty(first.size + 1)
    ended = False
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

    ``clouds`` are the arm's points (I, 2) m of each frame in the plane; ``o1`` (2,) and ``ee``
    (F, 2) m are commanded. The first search starts around ``q_start`` (3,) rad, a later one from
    the previous fit moved with the command, and for a lost arm from poses that join O1 and EE.
    Raises RecordingError for a long gap or an EE out of reach, SolverError for no convergence.
    """
    end = options.end_point
    gammas = (options.gamma1, options.gamma2)
    share = np.array([1 - options.length_range, 1 + options.length_range])
    bounds = chain.lengths[:, None] * share
    nodes = np.full((len(ee), 4, 2), np.nan)
    values = np.full(len(ee), np.nan)

    starts = chain.points(q_start + START_TURNS * START_SPREAD)[:, 1:]
    last = 0
    gap = 0
    least = np.inf
    for frame, (cloud, goal) in enumerate(zip(clouds, ee, strict=True)):
        where = {"take": take, "frame": frame}
        gap = gap + 1 if len(cloud) < options.minimum_points else 0
        if gap > options.max_gap:
            few = f"fewer than {options.minimum_points} points of the arm"
            message = f"more than {options.max_gap} depth frames in a row have {few}"
            raise RecordingError(message, **where)
        if gap:
            continue

        starts = starts + MOVED_NODES * (goal - ee[last])
        problem = frame_of(cloud.T, o1, goal, bounds, gammas)
        fits = [_fit(problem, end, start) for start in starts]
        if min(fit[1] for fit in fits) > LOST * least:
            joining = _joining_poses(o1, goal, chain.lengths)
            fits += [_fit(problem, end, start) for start in joining]

        best, value, ended = min(fits, key=lambda fit: fit[1])
        if value >= INFEASIBLE:
            where["distance"] = f"{np.hypot(*(goal - o1)):.4f} m"
            message = "no arm in length_range joins O1 and EE; check trajectory and clock offset"
            raise RecordingError(message, **where)
        if not ended:
            message = "the fit of the arm did not converge"
            raise SolverError(message, **where, step=MAX_STEPS)
        least = min(least, value)
        nodes[frame] = np.vstack([o1, best])
        values[frame] = value
        starts = best[None]
        last = frame
    x, z = np.moveaxis(np.diff(nodes, axis=1), -1, 0)
    return FittedSequence(nodes, chain.joints_from_segments(np.arctan2(x, z)), values)


def _joining_poses(o1: np.ndarray, ee: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return O2, O3 and EE (P, 3, 2) in m of poses that join O1 and EE, O3 on either side."""
    first, second, third = lengths
    psi = np.arange(LOST_HEADINGS) * (2 * np.pi / LOST_HEADINGS)
    o2 = o1 + first * _directions(psi)
    reach = np.linalg.norm(ee - o2, axis=1, keepdims=True)
    # distance from O2 of the foot of O3 on the line to EE, by the cosine theorem
    along = (reach**2 + second**2 - third**2) / (2 * reach)
    joins = np.abs(along[:, 0]) <= second
    o2 = o2[joins]
    reach = reach[joins]
    along = along[joins]

    towards = (ee - o2) / reach
    across = towards[:, ::-1] * [1.0, -1.0]
    aside = np.sqrt(second**2 - along**2) * across
    foot = o2 + along * towards
    ends = np.full_like(o2, ee)
    left = np.stack([o2, foot + aside, ends], axis=1)
    right = np.stack([o2, foot - aside, ends], axis=1)
    return np.concatenate([left, right])
