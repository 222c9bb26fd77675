"""articulate: depth frames → joint angles, by the paper's least-squares articulation (Eq. KinObj)."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts
from pipeline.arm.model import Arm, load_arm
from pipeline.compute.trials import run_trials
from pipeline.perception.articulation import ArticulationOptions
from pipeline.perception.depth_angles import articulate_rows
from pipeline.perception.depth_sequence import DepthSequence, take_paths

INGEST, TRACK, OUT = Path("data/ingest"), Path("data/track"), Path("data/articulate")


def run() -> None:
    """Joint angles of every depth frame, and two frames with their points for the figure."""
    settings = config.sections("articulate")
    dataset = settings.dataset
    with contracts.replacing(OUT) as folder:
        if dataset.depth is None:
            print("articulate: the dataset has no depth camera; nothing to do")
            return
        arm = load_arm(dataset.robot.urdf, dataset.robot.joints, dataset.robot.tool, dataset.robot.locked)
        trajectory = contracts.read("trajectory", INGEST)
        joints = contracts.read("joints", TRACK)
        start = joints[(joints.part == "training") & (joints.k == 0)][["q1", "q2", "q3"]].mean().to_numpy()
        frames = contracts.read("frames", INGEST)
        # track leaves out the takes beyond a limit
        takes = [rows for _, rows in frames[frames["take"].isin(joints["take"])].groupby("take")]
        fit = partial(_articulate, settings=settings, arm=arm, trajectory=trajectory, start=start)
        angles = pd.concat(run_trials(fit, takes, compute=settings.compute, label="articulate: takes"), ignore_index=True)
        contracts.write(angles, "angles", folder)
        views = [_view(name, angles, takes[0], settings, arm) for name in ("initial", "extended")]
        contracts.write(pd.concat([cloud for cloud, _ in views], ignore_index=True), "cloud", folder)
        contracts.write(pd.concat([skeleton for _, skeleton in views], ignore_index=True), "skeleton", folder)


def _sequence(rows: pd.DataFrame, settings, arm: Arm) -> DepthSequence:
    raw = Path(settings.dataset.recordings)
    path = take_paths(raw, settings.dataset.depth)[rows["take"].iloc[0]]
    return DepthSequence(path, settings.dataset.depth, arm, raw)


def _articulate(rows: pd.DataFrame, settings, arm: Arm, trajectory: pd.DataFrame, start: np.ndarray) -> pd.DataFrame:
    o = settings.articulation
    options = ArticulationOptions(o.gamma1, o.gamma2, o.length_range, o.minimum_points, o.max_gap)
    return articulate_rows(rows, _sequence(rows, settings, arm), arm, trajectory, options, start)


def _view(name: str, angles: pd.DataFrame, rows: pd.DataFrame, settings, arm: Arm) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The arm's points and the fitted nodes of the first take's first frame, or of the frame with EE farthest from O1."""
    take = angles[angles["take"] == rows["take"].iloc[0]]
    reach = np.hypot(take["xe"] - arm.chain.origin[0], take["ze"] - arm.chain.origin[1])
    shown = take.iloc[0 if name == "initial" else int(reach.argmax())]
    points, _ = next(_sequence(rows, settings, arm).points([int(shown["frame"])]))
    nodes = np.vstack([arm.chain.origin, *([shown[f"x{node}"], shown[f"z{node}"]] for node in "23e")]).astype(float)
    cloud = pd.DataFrame({"view": name, "x": points[:, 0], "z": points[:, 1]})
    return cloud, pd.DataFrame({"view": name, "node": np.arange(4), "x": nodes[:, 0], "z": nodes[:, 1]})
