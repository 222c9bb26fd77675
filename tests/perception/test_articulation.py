"""The articulation of both ends: objective against arrays, simplex against SciPy, angles."""

from itertools import pairwise

import numpy as np
import pytest
from compiled_calls import from_python
from numpy.random import default_rng
from rectangle_clouds import CHAIN, cloud, limits, motion
from sample_options import made
from scipy.optimize import minimize

from pipeline.core.errors import RecordingError
from pipeline.core.options.analysis import ArticulationSection as Articulation
from pipeline.perception.articulation import (
    INFEASIBLE,
    RUNS,
    STEP,
    FittedSequence,
    Frame,
    fit_sequence,
    frame_of,
    rank,
    variables,
)

OPTIONS = made(Articulation)
FREE = made(Articulation, end_point="fitted")
RANK = from_python(rank)
GAMMAS = (FREE.gamma1, FREE.gamma2)
AWAY = np.array([0.05, -0.05, 0.05])  # rad, of a start from the pose
ROUNDED = 8  # number of starts that differ by rounding


def plain_objective(
    points: np.ndarray,
    nodes: np.ndarray,
    gamma1: float,
    gamma2: float,
) -> float:
    """Eq. (KinObj) of ``points`` (I, 2) at ``nodes`` (4, 2), every distance as the distance to the
    closest point of the segment.
    """
    nearest, sides = _distances(points, nodes)
    asymmetry = sum(_asymmetry(*of_segment) for of_segment in sides)
    return gamma1 * nearest.mean() + gamma2 * asymmetry


def fitted_nodes(v: np.ndarray, o1: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """(4, 2) nodes of the fitted end at ``v`` (5,), with complex numbers."""
    shortest, longest = bounds.T
    middle = (shortest + longest) / 2
    turned = np.exp(1j * v[2:] / middle)
    lengths = middle.copy()
    lengths[:2] += (longest - shortest)[:2] / 2 * np.sin(np.pi / 2 * v[:2] / 0.02)

    reached = np.cumsum(np.append(0.0, lengths * turned))  # z + ix
    return o1 + np.stack([reached.imag, reached.real], axis=-1)


def plain_halved(v, points, o1, bounds, gamma1: float, gamma2: float) -> float:
    """The objective of the fitted end at ``v`` (5,), each half of the tool with an asymmetry."""
    nodes = fitted_nodes(v, o1, bounds)
    nearest, sides = _distances(points, nodes)
    distance, side = sides.pop()
    middle = nodes[2:].mean(axis=0)
    tool = nodes[3] - nodes[2]
    beyond = (points - middle) @ tool > 0
    for half_of_tool in (beyond, ~beyond):
        sides.append((distance[half_of_tool], side[half_of_tool]))
    asymmetry = sum(_asymmetry(*of_segment) for of_segment in sides)
    return gamma1 * nearest.mean() + gamma2 * asymmetry


def _distances(
    points: np.ndarray,
    nodes: np.ndarray,
) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Distance of every point to the nearest segment; of every segment the distances of its own
    points, and of the others 0, and on which side all are.
    """
    distances = []
    sides = []
    for start, end in pairwise(nodes):
        way = end - start
        from_start = points - start
        share = np.clip(from_start @ way / (way @ way), 0.0, 1.0)
        to_closest = from_start - np.outer(share, way)
        distances.append(np.linalg.norm(to_closest, axis=1))
        sides.append(from_start @ [way[1], -way[0]])
    nearest = np.min(distances, axis=0)
    of_nearest = np.where(distances <= nearest + 1e-12, distances, 0.0)
    return nearest, [*zip(of_nearest, sides, strict=True)]


def _asymmetry(distance: np.ndarray, side: np.ndarray) -> float:
    above = distance[side > 0].max(initial=0.0)
    below = distance[side <= 0].max(initial=0.0)
    return abs(above - below)


def plain_rank(v, points, o1, ee, bounds, gamma1: float, gamma2: float) -> float:
    """The same at ``v`` = (O2, O3), and behind every feasible pose by the violation of the
    ``bounds`` (3, 2) on the lengths.
    """
    nodes = np.vstack([o1, v.reshape(2, 2), ee])
    length = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    excess = np.sum(np.abs(length - np.clip(length, *bounds.T)))
    if excess > 0:
        return INFEASIBLE + excess
    return plain_objective(points, nodes, gamma1, gamma2)


def ranked(
    points: np.ndarray,
    nodes: np.ndarray,
    share: float,
    *gammas: float,
) -> float:
    frame = frame_of(points.T, nodes[0], nodes[3], limits(share), gammas)
    return RANK(frame, nodes[1:3].ravel())


def fit(clouds, q: np.ndarray, options=OPTIONS, take: str = "") -> FittedSequence:
    ee = CHAIN.points(q)[:, 3]
    return fit_sequence(clouds, CHAIN.origin, ee, CHAIN, options, q[0], take=take)


def objective(fitted: FittedSequence) -> float:
    return fitted.objective[0]


def problem(points: np.ndarray, q: np.ndarray) -> Frame:
    """A frame of the fitted end."""
    ee = CHAIN.points(q)[3]
    return frame_of(points.T, CHAIN.origin, ee, limits(FREE.length_range), GAMMAS)


RNG = default_rng(7)
Q = motion()
CLOUDS = [cloud(pose, RNG) for pose in Q]


EVERY_EIGHTH = range(0, 97, 8)


@pytest.mark.parametrize("frame", EVERY_EIGHTH)
def test_the_objective_is_the_printed_one(frame) -> None:
    points = CLOUDS[frame]
    nodes = CHAIN.points(Q[frame])
    nodes[1:3] += default_rng(frame).normal(scale=0.01, size=(2, 2))
    value = ranked(points, nodes, 0.9, 0.7, 0.4)
    assert value == pytest.approx(plain_objective(points, nodes, 0.7, 0.4), rel=1e-12)


@pytest.mark.parametrize("frame", EVERY_EIGHTH)
def test_the_objective_of_the_fitted_end_has_an_asymmetry_for_each_half_of_the_tool(
    frame,
) -> None:
    points = CLOUDS[frame]
    nodes = CHAIN.points(Q[frame])
    free = problem(points, Q[frame])
    away = default_rng(frame).normal(scale=0.01, size=5)
    v = variables(free, nodes[1:], "fitted") + away
    plain = plain_halved(v, points, CHAIN.origin, limits(), *GAMMAS)
    assert RANK(free, v) == pytest.approx(plain, rel=1e-10)


def test_a_point_at_a_joint_is_of_both_segments():
    nodes = np.array([[0.0, 0.0], [0.0, 0.155], [0.135, 0.155], [0.135, 0.325]])
    point = nodes[1] + 0.02 * np.array([-0.6, 0.8])
    value = ranked(point[None], nodes, 0.05, 1.0, 0.25)
    assert value == pytest.approx(0.02 + 0.25 * (0.02 + 0.02), rel=1e-12)


def test_poses_of_lengths_out_of_range_rank_behind_by_their_violation():
    nodes = CHAIN.points(Q[0])
    nodes[1] += 0.2 * (nodes[1] - nodes[0])
    v = nodes[1:3].ravel()
    gammas = (1.0, 0.3)
    plain = plain_rank(v, CLOUDS[0], *nodes[[0, 3]], limits(), *gammas)
    assert ranked(CLOUDS[0], nodes, 0.05, *gammas) == pytest.approx(plain, rel=1e-12)
    assert plain > INFEASIBLE + 0.02


def least_of_commanded_end(number: int, rng) -> tuple[float, float]:
    """Objective of a frame by our simplex and by SciPy's, with the commanded end."""
    away = Q[number] + AWAY
    o1, ee = CHAIN.points(Q[number])[[0, 3]]
    fitted = fit_sequence(
        CLOUDS[number : number + 1],
        o1,
        ee[None],
        CHAIN,
        OPTIONS,
        away,
    )
    plain = plain_objective(CLOUDS[number], fitted.nodes[0], *GAMMAS)
    assert objective(fitted) == pytest.approx(plain, rel=1e-10)

    start = CHAIN.points(away)[1:3].ravel()
    arguments = CLOUDS[number], o1, ee, limits(), *GAMMAS
    scipys = minimum_of_scipy(plain_rank, start, arguments, [(STEP, 1e-5)], 1e-7)
    return objective(fitted), scipys


def least_of_fitted_end(number: int, rng) -> tuple[float, float]:
    """Objective of a frame by our simplex and by SciPy's, with the fitted end."""
    away = Q[number] + AWAY
    points = CLOUDS[number : number + 1]
    nearby = away + 1e-12 * rng.normal(size=(ROUNDED, 1, 3))
    ours = min(objective(fit(points, near, FREE)) for near in nearby)

    start = variables(problem(points[0], away), CHAIN.points(away)[1:], "fitted")
    arguments = points[0], CHAIN.origin, limits(), *GAMMAS
    scipys = minimum_of_scipy(plain_halved, start, arguments, RUNS["fitted"], np.inf)
    return ours, scipys


@pytest.mark.parametrize(
    "least_of",
    [
        pytest.param(least_of_commanded_end, id="commanded"),
        pytest.param(least_of_fitted_end, id="fitted", marks=pytest.mark.slow),
    ],
)
def test_the_simplex_finds_what_scipys_finds_or_better(least_of) -> None:
    """The objective jumps, so that the minimum of a start depends on its rounding: at frame 96 and
    starts 1e-12 rad apart, the least of our five is 14.51 to 14.90 mm, SciPy's is 14.55 to 15.27
    mm. From 60 starts within 1 mrad the means of both agree to 0.1 mm, either being less.
    """
    rng = default_rng(2)
    ours, scipys = np.transpose([least_of(frame, rng) for frame in range(0, 97, 24)])
    # ours has five starts in a first frame, SciPy's one
    assert np.all(ours <= scipys + 2e-4)
    assert np.mean(ours) <= np.mean(scipys)


def minimum_of_scipy(value, start, arguments, runs, last: float) -> float:
    """Minimum of ``value`` by SciPy's simplex from ``start`` in several ``runs``, each with the
    first and last extent of the simplex.
    """
    for step, extent in runs:
        corners = start + step * np.eye(len(start) + 1, len(start), -1)
        ends = {"initial_simplex": corners, "xatol": extent, "fatol": last}
        solution = minimize(value, start, arguments, "Nelder-Mead", options=ends)
        start = solution.x
    return solution.fun


@pytest.mark.parametrize("options", [OPTIONS, FREE], ids=["commanded", "fitted"])
def test_the_angles_are_as_good_as_a_filter_needs_and_the_lengths_stay_in_range(
    options,
):
    fitted = fit(CLOUDS, Q, options)
    again = fit(CLOUDS[:10], Q[:10], options)

    rms = np.sqrt(((fitted.q - Q) ** 2).mean(axis=0))
    lengths = np.linalg.norm(np.diff(fitted.nodes, axis=1), axis=2)
    assert np.all(rms < [0.04, 0.06, 0.06])
    assert np.abs(lengths - np.clip(lengths, *limits().T)).max() < 1e-12
    assert np.isfinite(fitted.objective).all()
    assert again.nodes.tobytes() == fitted.nodes[:10].tobytes()


def thinned(*frames: int) -> list[np.ndarray]:
    """The first 40 clouds, of which some ``frames`` have too few points."""
    clouds = list(CLOUDS[:40])
    for frame in frames:
        clouds[frame] = clouds[frame][:10]
    return clouds


def test_frames_with_too_few_points_are_gaps_and_bridged() -> None:
    fitted = fit(thinned(0, 30, 31), Q[:40])
    lost = np.isnan(fitted.q).any(axis=1)
    assert np.flatnonzero(lost).tolist() == [0, 30, 31]
    assert np.abs(fitted.q[32] - Q[32]).max() < 0.2


def test_too_many_frames_with_too_few_points_in_a_row_are_refused() -> None:
    with pytest.raises(RecordingError, match=r"take-9.*frame 23"):
        fit(thinned(20, 21, 22, 23), Q[:40], take="take-9")


def test_an_arm_that_was_lost_over_missing_frames_is_found_again(monkeypatch) -> None:
    frames = [*range(43, 48), *range(80, 90)]
    clouds = [CLOUDS[frame] for frame in frames]
    q = Q[frames]
    assert np.abs(fit(clouds, q).q - q).max() < 0.2
    # the control: without the search over all poses the elbow stays on the wrong side
    monkeypatch.setattr("pipeline.perception.articulation.LOST", np.inf)
    assert np.abs(fit(clouds, q).q - q).max() > 1.0


def test_an_end_effector_out_of_reach_is_refused() -> None:
    far = np.array([[0.0, 0.7]])
    with pytest.raises(RecordingError, match=r"joins O1 and EE.*frame 0"):
        fit_sequence(CLOUDS[:1], CHAIN.origin, far, CHAIN, OPTIONS, Q[0])
