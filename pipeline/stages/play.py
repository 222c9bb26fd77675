"""play: one test take as it can be played frame by frame: the depth camera's images, the fitted links, every filter's posterior."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline import config, contracts
from pipeline.arm.model import load_arm
from pipeline.instruments.rosbag import is_bag
from pipeline.perception.depth_frames import BagFrames, FileFrames
from pipeline.perception.depth_sequence import take_paths
from pipeline.perception.depth_view import DepthView

TRACK, ARTICULATE, FILTER, OUT = Path("data/track"), Path("data/articulate"), Path("data/filter"), Path("data/play")
FRAMES = 33  # of a take's, evenly: every third of the Kinect's 97
MODELS = 3  # those of the figures


def run() -> None:
    """Write the frames as images, where the links were fitted in them, and what the filters make of the take."""
    settings = config.sections("play")
    dataset = settings.dataset
    with contracts.replacing(OUT) as folder:
        filtered = [model for model in settings.models if contracts.exists("posterior", FILTER / model)][:MODELS]
        if dataset.depth is None or not filtered:
            print("play: no depth camera whose frames could be played; nothing to do")
            return
        angles = contracts.read("angles", ARTICULATE)
        fitted = angles[angles["take"] == angles["take"].iloc[0]]
        take, raw = fitted["take"].iloc[0], Path(dataset.recordings)
        path = take_paths(raw, dataset.depth)[take]
        frames = (BagFrames if is_bag(path) else FileFrames)(path, dataset.depth, raw)
        if frames.camera is None:
            print("play: the depth camera gives point clouds and no images; nothing to do")
            return
        arm = load_arm(dataset.robot.urdf, dataset.robot.joints, dataset.robot.tool, dataset.robot.locked)
        nodes = np.stack([fitted[[f"x{node}", f"z{node}"]].to_numpy() for node in "23e"], axis=1)
        nodes = np.concatenate([np.broadcast_to(arm.chain.origin, (len(nodes), 1, 2)), nodes], axis=1)
        camera = dataset.depth.camera
        rotation = Rotation.from_euler("xyz", camera.rpy).as_matrix()
        view = DepthView(arm, frames.camera, rotation, np.array(camera.position), nodes.reshape(-1, 2))

        rows = np.unique(np.linspace(0, len(fitted) - 1, FRAMES).round().astype(int))
        shown = fitted.iloc[rows]
        for number, (depth, _) in zip(shown["frame"], frames.read(shown["frame"]), strict=True):
            (folder / f"{number:04d}.png").write_bytes(view.image(depth))
        pixels = np.stack([view.pixels(nodes[row]) for row in rows])
        table = shown[["take", "part", "frame", "t", "q1", "q2", "q3"]].assign(width=view.size[0], height=view.size[1])
        contracts.write(table.assign(**_columns(pixels)), "played_frames", folder)
        contracts.write(_posteriors(filtered, take), "played_posteriors", folder)


def _columns(pixels: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{axis}{node}": pixels[:, node, i] for node in range(4) for i, axis in enumerate("uv")}


def _posteriors(models: list[str], take: str) -> pd.DataFrame:
    """Every filter's moments over the take beside the angles of the motion capture."""
    joints = contracts.read("joints", TRACK)[["take", "k", "q1", "q2", "q3"]]
    columns = ["take", "part", "k", "t", "m1", "m2", "m3", "c11", "c12", "c13", "c22", "c23", "c33", "ess"]
    posteriors = [contracts.read("posterior", FILTER / model)[columns].assign(model=model) for model in models]
    posterior = pd.concat(posteriors, ignore_index=True)
    return posterior[posterior["take"] == take].merge(joints, on=["take", "k"])
