"""The test take that the page plays: what the depth camera saw, the links that were fitted to it,
and every filter's posterior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.arm.model import Arm, arm_of
from pipeline.core import contracts
from pipeline.core.columns import matrices, members, values
from pipeline.core.options.dataset import Dataset
from pipeline.core.options.depth_camera import Depth
from pipeline.formats.rosbag import is_bag
from pipeline.recordings.depth_frames import BagFrames, FileFrames
from pipeline.recordings.depth_sequence import take_paths
from pipeline.tools.page.depth_view import DepthView

TRACK, ARTICULATE, FILTER = Path("data/track"), Path("data/articulate"), Path("data/filter")
FRAMES = 33  # of a take's, evenly: every third of the Kinect's 97
MODELS = 3  # those of the figures


class Posterior(NamedTuple):
    """A filter's posterior over K steps: ``mean`` (K, n) rad, ``covariance`` (K, n, n) rad², and
    the effective number of particles ``ess`` (K,).
    """

    mean: np.ndarray
    covariance: np.ndarray
    ess: np.ndarray


@dataclass(frozen=True)
class Take:
    """One take of n joints over K steps and F depth frames.

    Args:
        name: of the take.
        joints: their names, base to tip.
        t: (K,) s, time of the steps.
        truth: (K, n) rad, joint angles of the motion capture.
        posteriors: by the models' names.
        frame_t: (F,) s, time of the frames.
        frame_q: (F, n) rad, joint angles read from the frames.
        images: F images (rows, columns, 3), RGB of 8 bits.
        size: (width, height) of an image, px.
        nodes: (F, n + 1, 2) px, the ends of the fitted links in the images, base to tip.
    """

    name: str
    joints: tuple[str, ...]
    t: np.ndarray
    truth: np.ndarray
    posteriors: Mapping[str, Posterior]
    frame_t: np.ndarray
    frame_q: np.ndarray
    images: Sequence[np.ndarray]
    size: tuple[int, int]
    nodes: np.ndarray


def read_take(dataset: Dataset, models: Sequence[str]) -> Take | None:
    """The first test take of ``dataset`` under the first filtered ``models``; None where there is
    no image of a depth camera, or no filter ran.
    """
    filtered = [model for model in models if contracts.exists("posterior", FILTER / model)]
    if dataset.depth is None or not filtered:
        print("page: no depth camera whose frames could be played; the player is left out")
        return None
    angles = contracts.read("angles", ARTICULATE)
    name = angles["take"].iloc[0]
    angles = angles[angles["take"] == name]
    frames = _frames(name, dataset.depth, Path(dataset.recordings))
    if frames.camera is None:
        print("page: the depth camera gives point clouds and no images; the player is left out")
        return None
    arm = arm_of(dataset.robot)
    nodes = _nodes(angles, arm)
    pose = dataset.depth.camera
    rotation = Rotation.from_euler("xyz", pose.rpy).as_matrix()
    view = DepthView(arm, frames.camera, rotation, np.array(pose.position), nodes.reshape(-1, 2))
    rows = np.unique(np.linspace(0, len(angles) - 1, FRAMES).round().astype(int))
    shown = angles.iloc[rows]
    joints = contracts.read("joints", TRACK)
    joints = joints[joints["take"] == name]
    names = members(joints, "q")
    return Take(
        name=name,
        joints=names,
        t=joints["t"].to_numpy(),
        truth=values(joints, "q"),
        posteriors={model: _posterior(model, name, names) for model in filtered[:MODELS]},
        frame_t=shown["t"].to_numpy(),
        frame_q=values(shown, "q"),
        images=[view.colours(depth) for depth, _ in frames.read(shown["frame"])],
        size=view.size,
        nodes=np.stack([view.pixels(nodes[row]) for row in rows]),
    )


def _frames(take: str, depth: Depth, raw: Path) -> BagFrames | FileFrames:
    path = take_paths(raw, depth)[take]
    return (BagFrames if is_bag(path) else FileFrames)(path, depth, raw)


def _nodes(angles: pd.DataFrame, arm: Arm) -> np.ndarray:
    """(F, n + 1, 2) m in the arm's plane, the first joint first, which does not move."""
    ends = [c[1:] for c in angles.columns if c.startswith("x") and f"z{c[1:]}" in angles.columns]
    moving = np.stack([angles[[f"x{end}", f"z{end}"]].to_numpy() for end in ends], axis=1)
    base = np.broadcast_to(arm.chain.origin, (len(angles), 1, 2))
    return np.concatenate([base, moving], axis=1)


def _posterior(model: str, take: str, joints: Sequence[str]) -> Posterior:
    table = contracts.read("posterior", FILTER / model)
    table = table[table["take"] == take]
    return Posterior(values(table, "m"), matrices(table, "c", joints), table["ess"].to_numpy())
