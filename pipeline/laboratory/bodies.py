"""Rigid bodies on the links of an arm in space, as a motion capture would report them.

Every body is a cluster of markers that the tracker knows by its shape, so that no label is
exchanged. The tracker fits that shape to the markers that its cameras see; with fewer than three
of them the body is lost. The shape is the one of the drawing: where a marker really sits differs by
what a hand with a ruler misses, and the fitted pose with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.arm.frames import rigid_motion
from pipeline.arm.serial import SerialChain
from pipeline.laboratory.mocap import bursts
from pipeline.laboratory.options import MocapOptions


@dataclass(frozen=True)
class MarkerCluster:
    """The markers of one body."""

    chain: SerialChain  # the true one that carries the link; its tip is the link's frame
    places: np.ndarray  # (K, 3) m, where the markers really sit in the link's frame
    shape: np.ndarray  # (K, 3) m, where the tracker has them in the body's frame


def as_built(link: SerialChain, arm: SerialChain) -> SerialChain:
    """Return the nominal chain to a ``link`` with the placements of the true ``arm``'s joints; what
    is beyond the last of them is the link's own.
    """
    placements = link.placements.copy()
    placements[:-1] = arm.placements[: len(placements) - 1]
    return replace(link, placements=placements)


def in_body(places: np.ndarray, position: np.ndarray, rpy: np.ndarray) -> np.ndarray:
    """Return (K, 3) ``places`` of a link's frame in the frame of a body that is mounted on the link
    at ``position`` (3,), both in m, turned by ``rpy`` (rad, about the fixed axes x, y, z).
    """
    return (places - np.asarray(position)) @ Rotation.from_euler("xyz", rpy).as_matrix()


def capture_bodies(
    clusters: Mapping[str, MarkerCluster],
    q: np.ndarray,
    base: tuple[np.ndarray, np.ndarray],
    options: MocapOptions,
    rng: np.random.Generator,
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return by name the poses in the world frame of the bodies on an arm at true angles ``q`` (N,
    n) in rad: position (N, 3) in m and quaternion (N, 4) as x, y, z, w, NaN where the body is lost.

    The arm's base is turned by ``base[0]`` (3, 3) and stands at ``base[1]`` (3,) in m. White noise
    of s m in each coordinate of K markers about their centre makes s/√K m of the position there,
    and s over the root of the sum of their squared distances from an axis, in rad, of the turn
    about it.
    """
    result = {}
    for name, cluster in clusters.items():
        pose = cluster.chain.pose(q[:, : len(cluster.chain.lower)])
        turn = pose[:, 3:].reshape(-1, 3, 3)
        places = pose[:, None, :3] + cluster.places @ np.swapaxes(turn, -1, -2)
        world = places @ base[0].T + base[1]
        observed = world + options.noise_std * rng.standard_normal(world.shape)
        rate, mean = options.occlusion_rate, options.occlusion_frames
        _, hidden = bursts(len(q), world.shape[1:2], rate, mean, rng)
        observed[hidden] = np.nan
        rotation, position = rigid_motion(cluster.shape, observed)
        quaternion = np.full((len(q), 4), np.nan)
        tracked = np.isfinite(position).all(axis=-1)
        if tracked.any():
            quaternion[tracked] = Rotation.from_matrix(rotation[tracked]).as_quat()
        result[name] = (position, quaternion)
    return result
