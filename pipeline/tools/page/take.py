"""The take that the page plays: what the depth camera saw of a planar arm with the links that were
fitted to it, or an arm in space as its joints have it; and what every model says of its joints.
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
from pipeline.core.columns import members, values
from pipeline.core.errors import ModelDomainError
from pipeline.core.options.dataset import Dataset
from pipeline.core.options.depth_camera import Depth
from pipeline.formats.bag_path import is_bag
from pipeline.models.kinds import fitted_model
from pipeline.recordings.depth_frames import BagFrames, FileFrames
from pipeline.recordings.depth_sequence import take_paths
from pipeline.recordings.steps import training_steps
from pipeline.tools.page.depth_view import DepthView
from pipeline.tools.page.posterior import (
    FILTER,
    FIT,
    Posterior,
    filtered_posterior,
    one_step_ahead,
)
from pipeline.tools.page.scene import Scene, scene_of

TRACK, ARTICULATE = Path("data/track"), Path("data/articulate")
FRAMES = 33  # of a take's, evenly: every third of the Kinect's 97
STEPS = 321  # of a take's of an arm in space, evenly: more a plot of a few hundred px does not show
MODELS = 3  # those of the figures


class Pictures(NamedTuple):
    """F images (rows, columns, 3) of a depth camera, RGB of 8 bits, of the ``size`` (width, height)
    px, and in them the ends of the fitted links, ``nodes`` (F, n + 1, 2) px, base to tip.
    """

    images: Sequence[np.ndarray]
    size: tuple[int, int]
    nodes: np.ndarray


@dataclass(frozen=True)
class Take:
    """One take of n joints over K steps, shown at F frames.

    Args:
        name: of the take.
        joints: their names, base to tip.
        t: (K,) s, time of the steps.
        truth: (K, n) rad, measured joint angles.
        posteriors: by the models' names.
        frame_t: (F,) s, time of the frames.
        frame_q: (F, n) rad, joint angles read from a depth camera's frames, where there is one.
        view: of the arm at the frames.
    """

    name: str
    joints: tuple[str, ...]
    t: np.ndarray
    truth: np.ndarray
    posteriors: Mapping[str, Posterior]
    frame_t: np.ndarray
    frame_q: np.ndarray | None
    view: Pictures | Scene


def read_take(dataset: Dataset, models: Sequence[str]) -> Take | None:
    """A take of ``dataset`` under the first ``models``; of a planar arm None where there is no
    image of a depth camera, or no filter ran.
    """
    filtered = [model for model in models if contracts.exists("posterior", FILTER / model)]
    if not dataset.robot.plane:
        return _spatial_take(dataset, models[:MODELS], filtered)
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
    rows = evenly(len(angles), FRAMES)
    shown = angles.iloc[rows]
    joints = contracts.read("joints", TRACK)
    joints = joints[joints["take"] == name]
    names = members(joints, "q")
    return Take(
        name=name,
        joints=names,
        t=joints["t"].to_numpy(),
        truth=values(joints, "q"),
        posteriors={model: filtered_posterior(model, name, names) for model in filtered[:MODELS]},
        frame_t=shown["t"].to_numpy(),
        frame_q=values(shown, "q"),
        view=Pictures(
            [view.colours(depth) for depth, _ in frames.read(shown["frame"])],
            view.size,
            np.stack([view.pixels(nodes[row]) for row in rows]),
        ),
    )


def _spatial_take(dataset: Dataset, models: Sequence[str], filtered: Sequence[str]) -> Take | None:
    """The first test take under the ``filtered`` models or, where there is none, the first training
    take with what each of the ``models`` says of it one step ahead; None where none says anything.
    """
    joints = contracts.read("joints", TRACK)
    takes = joints[joints["part"] == ("test" if filtered else "training")]
    name, names = takes["take"].iloc[0], members(joints, "q")
    own = takes[takes["take"] == name]
    t, truth = own["t"].to_numpy(), values(own, "q")
    if filtered:
        posteriors = {model: filtered_posterior(model, name, names) for model in filtered[:MODELS]}
    else:
        recorded = training_steps(dataset.robot, dataset.motion)
        posteriors = {}
        for model in models:
            try:
                posteriors[model] = one_step_ahead(fitted_model(FIT / model), recorded)
            except ModelDomainError as error:
                print(f"page: {model} is left out of the player: {error}")
    if not posteriors:
        return None
    shown = evenly(len(t), STEPS)
    t, truth = t[shown], truth[shown]
    posteriors = {model: each.at(shown) for model, each in posteriors.items()}
    rows = evenly(len(t), FRAMES)
    return Take(
        name=name,
        joints=names,
        t=t,
        truth=truth,
        posteriors=posteriors,
        frame_t=t[rows],
        frame_q=None,
        view=scene_of(dataset.robot, truth, posteriors, rows),
    )


def evenly(count: int, most: int) -> np.ndarray:
    """Numbers from 0 to ``count`` − 1, both among them, no more than ``most``."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


def _frames(take: str, depth: Depth, raw: Path) -> BagFrames | FileFrames:
    path = take_paths(raw, depth)[take]
    return (BagFrames if is_bag(path) else FileFrames)(path, depth, raw)


def _nodes(angles: pd.DataFrame, arm: Arm) -> np.ndarray:
    """(F, n + 1, 2) m in the arm's plane, the first joint first, which does not move."""
    ends = [c[1:] for c in angles.columns if c.startswith("x") and f"z{c[1:]}" in angles.columns]
    moving = np.stack([angles[[f"x{end}", f"z{end}"]].to_numpy() for end in ends], axis=1)
    base = np.broadcast_to(arm.chain.origin, (len(angles), 1, 2))
    return np.concatenate([base, moving], axis=1)
