"""Synthetic OptiTrack recordings with typical faults: markers on the links of a planar arm, or
rigid bodies on the links of an arm in space. The world frame is Motive's (y up, m).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import SerialChain, segment_frames
from pipeline.arm.model import Arm
from pipeline.arm.rotations import rigid_motion
from pipeline.laboratory.options import MocapOptions

LABELS = "abc"
PAIRS = np.array([[0, 1], [0, 2], [1, 2]])
FIRST_UNLABELED = 1000
# rotation (3, 3) and place (3,) m of the arm in the world
Base = tuple[np.ndarray, np.ndarray]


def place_markers(
    template: np.ndarray,
    options: MocapOptions,
    rng: Generator,
) -> np.ndarray:
    """Draw the true positions (..., 3) m of a session's markers, planned at ``template``."""
    return template + options.placement_std * rng.standard_normal(template.shape)


def bursts(
    frames: int,
    shape: tuple[int, ...],
    rate: float,
    mean: float,
    rng: Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the masks (frames, *shape) of frames that start a burst, and of frames in a burst."""
    starts = rng.random((frames, *shape)) < rate
    first, *places = np.nonzero(starts)
    lengths = rng.geometric(1.0 / mean, size=first.size)
    ends = np.minimum(first + lengths, frames)

    change = np.zeros((frames + 1, *shape), dtype=int)
    np.add.at(change, (first, *places), 1)
    np.add.at(change, (ends, *places), -1)
    return starts, np.cumsum(change[:-1], axis=0) > 0


def _exchange_labels(
    observed: np.ndarray,
    options: MocapOptions,
    rng: Generator,
) -> np.ndarray:
    """Return the positions (N, 3, 3, xyz) with two labels of a link exchanged during bursts."""
    frames = observed.shape[0]
    starts, swapped = bursts(frames, (3,), options.swap_rate, options.swap_frames, rng)
    drawn = rng.integers(len(PAIRS), size=(frames, 3))
    # the exchanged pair is constant during a burst
    started = np.where(starts, np.arange(frames)[:, None], 0)
    latest = np.maximum.accumulate(started, axis=0)
    pair = PAIRS[np.take_along_axis(drawn, latest, axis=0)]
    labels = np.where(swapped[..., None], pair[..., ::-1], pair)

    carrier = np.broadcast_to(np.arange(3), (frames, 3, 3)).copy()
    np.put_along_axis(carrier, pair, labels, axis=-1)
    return np.take_along_axis(observed, carrier[..., None], axis=2)


def _lose_labels(
    observed: np.ndarray,
    options: MocapOptions,
    rng: Generator,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the positions (N, 9, 3) without the labels lost in bursts, and name → positions (N, 3)
    of the resulting unlabeled markers.
    """
    rate = options.lost_label_rate
    mean = options.lost_label_frames
    frames, markers, _ = observed.shape
    _, lost = bursts(frames, (markers,), rate, mean, rng)
    lost &= ~np.isnan(observed[..., 0])
    edges = np.diff(lost.astype(np.int8), axis=0, prepend=0, append=0)

    # transpose, so that starts and ends have the same order (by marker, then time)
    marker, first = np.nonzero(edges.T == 1)
    _, last = np.nonzero(edges.T == -1)
    columns = {}
    for number, i in enumerate(np.lexsort((marker, first))):
        burst = slice(first[i], last[i])
        column = np.full((frames, 3), np.nan)
        column[burst] = observed[burst, marker[i]]
        columns[f"Unlabeled {FIRST_UNLABELED + number}"] = column
    return np.where(lost[..., None], np.nan, observed), columns


def capture(
    arm: Arm,
    q: np.ndarray,
    markers: np.ndarray,
    base: Base,
    options: MocapOptions,
    rng: Generator,
) -> dict[str, np.ndarray]:
    """Draw name → positions (N, 3) m in the world frame, NaN if missing, of the ``markers``
    (3, 3, 3) (link, marker, xyz of the segment frame, m) on an arm at true angles ``q`` (N, 3) rad.
    Names are ``link1_a`` … ``link3_c``, and ``Unlabeled 1000`` and following.
    """
    axes, origin = segment_frames(arm.chain, q)
    plane = np.einsum("njab,jmb->njma", axes, markers) + origin[:, :, None, :]
    rotation, place = base
    world = arm.to_base(plane) @ rotation.T + place
    observed = _observe(world, options, rng)
    observed = _exchange_labels(observed, options, rng)
    labelled, unlabeled = _lose_labels(observed.reshape(-1, 9, 3), options, rng)
    names = [f"link{link}_{label}" for link in (1, 2, 3) for label in LABELS]
    columns = np.swapaxes(labelled, 0, 1)
    return dict(zip(names, columns, strict=True)) | unlabeled


def _observe(world: np.ndarray, options: MocapOptions, rng: Generator) -> np.ndarray:
    """Draw the measured positions of markers at ``world`` (N, ..., 3), NaN where occluded."""
    noise = options.noise_std * rng.standard_normal(world.shape)
    observed = world + noise
    frames, *markers, _ = world.shape
    rate = options.occlusion_rate
    mean = options.occlusion_frames
    _, hidden = bursts(frames, tuple(markers), rate, mean, rng)
    observed[hidden] = np.nan
    return observed


class MarkerCluster(NamedTuple):
    """K markers of one rigid body on a link of an arm in space. The tracker fits ``shape`` to the
    visible markers; with fewer than three visible markers, the body is lost.
    """

    # true chain from the base to the link; its tip is the link's frame
    chain: SerialChain
    places: np.ndarray  # (K, 3) m, true positions of the markers in the link's frame
    # (K, 3) m, positions in the body's frame that the tracker assumes
    shape: np.ndarray


def as_built(link: SerialChain, arm: SerialChain) -> SerialChain:
    """Return the chain to a ``link`` with the joint placements of the true ``arm``."""
    joints = len(link.placements) - 1
    placements = [*arm.placements[:joints], link.placements[-1]]
    return replace(link, placements=np.array(placements))


def in_body(places: np.ndarray, position: np.ndarray, rpy: np.ndarray) -> np.ndarray:
    """Return ``places`` (K, 3) m of a link in the frame of a body at ``position`` and ``rpy``."""
    rotation = Rotation.from_euler("xyz", rpy).as_matrix()
    return (places - np.asarray(position)) @ rotation


def capture_bodies(
    clusters: Mapping[str, MarkerCluster],
    q: np.ndarray,
    base: Base,
    options: MocapOptions,
    rng: Generator,
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Draw name → position (N, 3) m and quaternion (N, 4) x, y, z, w in the world frame of the
    bodies on an arm at true angles ``q`` (N, n) rad, NaN where a body is lost.
    """
    bodies = {}
    rotation_of_arm, place_of_arm = base
    for name, cluster in clusters.items():
        joints = len(cluster.chain.lower)
        pose = cluster.chain.pose(q[:, :joints])
        turn = pose[:, 3:].reshape(-1, 3, 3)
        levers = cluster.places @ np.swapaxes(turn, -1, -2)
        places = pose[:, None, :3] + levers
        world = places @ rotation_of_arm.T + place_of_arm
        observed = _observe(world, options, rng)
        rotation, position = rigid_motion(cluster.shape, observed)
        quaternion = np.full((len(q), 4), np.nan)
        tracked = np.isfinite(position).all(axis=-1)
        if tracked.any():
            quaternion[tracked] = Rotation.from_matrix(rotation[tracked]).as_quat()
        bodies[name] = position, quaternion
    return bodies
