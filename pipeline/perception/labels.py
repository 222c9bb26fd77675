"""Markers get the labels that the arm predicts for them.

Markers are compared with the places that the arm itself predicts for them (template on the chain),
so that one distance, the gate, decides everywhere whether a sample can be the marker that its label
says. It has to exceed the error of the registration of the base frame and stay below half the
distance between markers.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.core.errors import RecordingError
from pipeline.perception.link_fit import fit_segments, marker_places, solve

# solved frames from which a frame's pose is predicted: enough to damp noise, few enough for a
# straight line
NEIGHBOURS = 5


def correct_labels(
    markers: np.ndarray,
    extra: np.ndarray,
    template: np.ndarray,
    chain: PlanarChain,
    gate: float,
    take: str,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, int]]:
    """Markers (N, n, 3, 3) with the right labels, joint angles (N, n), which frames (N,) have
    them, and the counts of samples moved.

    Frames that fit the arm as they are labelled stay. In the others every position, labelled or
    not, goes to the label whose place, predicted from the nearest solved frames, it fits best: an
    optimal assignment under the gate.

    Args:
        markers: positions (N, n links, 3 markers, 3) in the plane's frame, m, NaN where missing.
        extra: (N, U, 3) further positions, likewise.
        template: (n, 3, 3) markers in the frames of their segments, m.
        chain: the arm's kinematics.
        gate: greatest distance in m of a sample from the place of its label.
        take: name of the take, for messages.
    """
    from scipy.optimize import linear_sum_assignment

    q, solved = solve(markers, template, chain, gate)
    moved = {"relabelled": 0, "adopted": 0, "rejected": 0}
    incomplete = np.isnan(markers).any(axis=(-3, -2, -1)) & np.isfinite(extra).all(axis=-1).any(
        axis=-1
    )
    doubtful = ~solved | incomplete
    if not doubtful.any():
        return markers, q, solved, moved
    markers, labels = markers.copy(), template.shape[0] * template.shape[1]
    start, pose = (
        (int(np.argmax(solved)), None)
        if solved.any()
        else _first_pose(markers, extra, template, chain, gate, take)
    )
    # outwards from the first pose that is sure, so that each frame has a solved neighbour
    for k in [*np.flatnonzero(doubtful[start:]) + start, *np.flatnonzero(doubtful[:start])[::-1]]:
        expected = _predict(q, solved, k) if solved.any() else pose
        labelled = markers[k].reshape(labels, 3)
        candidates = np.concatenate([labelled, extra[k][np.isfinite(extra[k]).all(axis=-1)]])
        places = marker_places(expected, template, chain).reshape(labels, 1, 3)
        square = ((places - candidates) ** 2).sum(axis=-1)
        square[np.isnan(square)] = np.inf
        label, sample = linear_sum_assignment(np.minimum(square, gate**2))
        close = square[label, sample] <= gate**2
        label, sample = label[close], sample[close]
        relabelled = np.full((labels, 3), np.nan)
        relabelled[label] = candidates[sample]
        present = np.isfinite(labelled).all(axis=-1)
        markers[k] = relabelled.reshape(template.shape)
        q[k : k + 1], solved[k : k + 1] = solve(markers[k : k + 1], template, chain, gate)
        moved["relabelled"] += int(((sample < labels) & (sample != label)).sum())
        moved["adopted"] += int((sample >= labels).sum())
        moved["rejected"] += int(present.sum() - (sample < labels).sum())
    return markers, q, solved, moved


def _predict(q: np.ndarray, solved: np.ndarray, k: int) -> np.ndarray:
    """Joint angles at frame ``k`` on the straight line through the solved frames nearest to it."""
    frames = np.flatnonzero(solved)
    frames = frames[np.argsort(np.abs(frames - k), kind="stable")[:NEIGHBOURS]]
    time = frames - frames.mean()
    near = np.unwrap(q[frames], axis=0)
    slope = time @ near / max(time @ time, 1.0)
    return near.mean(axis=0) + slope * (k - frames.mean())


def _first_pose(
    markers: np.ndarray,
    extra: np.ndarray,
    template: np.ndarray,
    chain: PlanarChain,
    gate: float,
    take: str,
) -> tuple[int, np.ndarray]:
    """A frame and its joint angles (n,) where no frame fits as it is labelled: from the shape of
    the triangles and the chain alone.

    Link by link, the ordered triple of positions that has the template's shape and starts where the
    link before it ends. Arguments as for :func:`correct_labels`; RecordingError where no frame has
    such triples.
    """
    links = len(template)
    for k in range(len(markers)):
        points = np.concatenate([markers[k].reshape(-1, 3), extra[k]])
        points = points[np.isfinite(points).all(axis=-1)]
        if len(points) < 3 * links:
            continue
        ordered = points[list(permutations(range(len(points)), 3))]
        q = np.zeros(links)
        for j in range(links):
            # two markers that lie within the gate of their places are as far apart as these, but
            # for twice the gate
            triples = ordered[
                (np.abs(_sides(ordered) - _sides(template[j])) <= 2 * gate).all(axis=-1)
            ]
            if not len(triples):
                break
            alone = np.full((len(triples), *template.shape), np.nan)
            alone[:, j] = triples
            psi = fit_segments(alone, template)[0][:, j]
            heading = chain.segment_headings(np.broadcast_to(q, (len(triples), links))).copy()
            heading[:, j] = psi
            trial = chain.joints_from_segments(heading)
            error = np.abs(marker_places(trial, template, chain)[:, j] - triples).max(axis=(-2, -1))
            q = trial[np.argmin(error)]
            if error.min() > gate:
                break
        else:
            return k, q
    raise RecordingError(
        "no frame has markers that fit the arm: check the template, the base frame, the units "
        "and the gate",
        take=take,
    )


def _sides(triangles: np.ndarray) -> np.ndarray:
    """(..., 3) m lengths of the sides of triangles (..., 3, 3)."""
    return np.linalg.norm(triangles - np.roll(triangles, 1, axis=-2), axis=-1)
