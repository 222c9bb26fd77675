"""track: markers (or the controller's own log) → measured joint angles, the ground truth of everything that follows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts, schema
from pipeline.arm.model import Arm, load_arm
from pipeline.perception.markers import JointTrack, track_joints

INGEST, OUT = Path("data/ingest"), Path("data/track")


def run() -> None:
    """Joint angles of every take, and what was repaired to get them."""
    settings = config.sections("track")
    robot, mocap = settings.dataset.robot, settings.dataset.mocap
    arm = load_arm(robot.urdf, robot.joints, robot.tool, robot.locked)
    with contracts.replacing(OUT) as folder:
        if mocap is None:
            joints = contracts.read("joint_log", INGEST).assign(residual=np.nan)
            print("track: no motion capture; the controller's log is taken for the measured joint angles")
        else:
            takes = contracts.read("markers", INGEST).groupby(["take", "part"], sort=False)
            tracks = {key: _track(rows, mocap, arm, key[0]) for key, rows in takes}
            joints = pd.concat([_joint_rows(*key, track, settings.dataset.motion.rate) for key, track in tracks.items()], ignore_index=True)
            contracts.write(pd.concat([_quality_rows(*key, track) for key, track in tracks.items()], ignore_index=True), "quality", folder)
        contracts.write(joints, "joints", folder)


def _track(rows: pd.DataFrame, mocap: schema.Mocap, arm: Arm, take: str) -> JointTrack:
    template = np.array([list(link.values()) for link in mocap.markers.values()])
    positions = rows.sort_values(["link", "marker", "k"], kind="stable")
    labelled, stray = positions[positions.link > 0], positions[positions.link == 0]
    frames = labelled.k.nunique()
    xyz = labelled[["x", "y", "z"]].to_numpy().reshape(3, 3, frames, 3).transpose(2, 0, 1, 3)
    extra = stray[["x", "y", "z"]].to_numpy().reshape(-1, frames, 3).transpose(1, 0, 2)
    return track_joints(xyz, template, arm, unlabelled=extra, gate=mocap.gate, max_gap=mocap.max_gap, take=take)


def _joint_rows(take: str, part: str, track: JointTrack, rate: float) -> pd.DataFrame:
    k = np.arange(len(track.q))
    angles = {f"q{j + 1}": track.q[:, j] for j in range(3)}
    return pd.DataFrame({"take": take, "part": part, "k": k, "t": k / rate} | angles | {"residual": track.residual})


def _quality_rows(take: str, part: str, track: JointTrack) -> pd.DataFrame:
    rows = [(name, float(count), "1") for name, count in track.counts.items()]
    rows.append(("residual_rms", float(np.sqrt(np.nanmean(track.residual**2))), "m"))
    quality = pd.DataFrame(rows, columns=["quantity", "value", "unit"])
    return quality.assign(take=take, part=part, instrument="motion capture")
