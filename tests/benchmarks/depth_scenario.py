"""Depth frames of the synthetic laboratory, in the files that its camera writes, for what reads and
fits them.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import OmegaConf
from project_copy import set_parameters
from scenario import ROOT, arm, swing, youbot

from pipeline.core.config import compose_config
from pipeline.core.options.depth_camera import Depth
from pipeline.formats.depth.image import write_depth
from pipeline.formats.depth.index import write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics
from pipeline.laboratory.kinect import DepthCamera
from pipeline.laboratory.sensor import draw_bias
from pipeline.perception.articulation import ArticulationOptions, articulate_rows
from pipeline.recordings.depth_sequence import DepthSequence

RATE = 30.0  # frames/s
TAKE = "test_001"
JOINTS = ("shoulder", "elbow", "wrist")


@dataclass(frozen=True)
class Recording:
    """A take of the arm as it swings, in a folder, and what it takes to read it."""

    folder: Path
    depth: Depth
    options: ArticulationOptions
    poses: np.ndarray  # (F, 3) rad, one a frame

    def angles(self, frames: int) -> pd.DataFrame:
        """The table ``angles`` of the first ``frames`` frames."""
        time = np.arange(frames) / RATE
        ee = youbot().points(self.poses[:frames])[:, 3]
        trajectory = pd.DataFrame({"t": time, "x:x": ee[:, 0], "x:z": ee[:, 1]})
        rows = pd.DataFrame({"take": TAKE, "part": "test", "frame": np.arange(frames), "t": time})
        sequence = DepthSequence(self.folder / "kinect" / TAKE, self.depth, arm(), self.folder)
        clouds = [points for points, _ in sequence.points(rows["frame"])]
        return articulate_rows(rows, clouds, arm(), JOINTS, trajectory, self.options, self.poses[0])


def record(folder: Path, frames: int) -> Recording:
    """Render and write ``frames`` frames; the camera is that of the synthetic dataset, whatever
    dataset params.yaml chooses.
    """
    shutil.copy2(ROOT / "params.yaml", folder)
    set_parameters(folder, dataset="youbot", overrides="{}")
    config = compose_config(folder / "params.yaml")
    kinect = OmegaConf.to_object(config.dataset.laboratory)["kinect"]
    rng = np.random.default_rng(2017)
    camera, poses = DepthCamera(arm(), kinect, draw_bias(kinect, rng)), swing(frames - 1)
    files = tuple(f"depth/{number:04d}.png" for number in range(frames))
    (folder / "kinect" / TAKE / "depth").mkdir(parents=True)
    for file, q in zip(files, poses, strict=True):
        write_depth(folder / "kinect" / TAKE / file, camera.observe(q, rng))
    write_index(folder / "kinect" / TAKE / "depth.txt", np.arange(frames) / RATE, files)
    camera_matrix = kinect.fx, kinect.fy, kinect.cx, kinect.cy
    write_intrinsics(
        folder / "kinect/intrinsics.yaml", Intrinsics(*camera_matrix, kinect.width, kinect.height)
    )
    options = ArticulationOptions.chosen(config.articulation)
    return Recording(folder, OmegaConf.to_object(config.dataset.depth), options, poses)
