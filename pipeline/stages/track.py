"""track: markers (or the controller's own log) → measured joint angles, the ground truth of everything that follows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts
from pipeline.arm.model import load_arm
from pipeline.perception.markers import JointTrack, track_rows

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
            tracks = {key: track_rows(rows, mocap, arm, take=key[0]) for key, rows in takes}
            joints = pd.concat([_joint_rows(*key, track, settings.dataset.motion.rate) for key, track in tracks.items()], ignore_index=True)
            contracts.write(pd.concat([_quality_rows(*key, track) for key, track in tracks.items()], ignore_index=True), "quality", folder)
        contracts.write(joints, "joints", folder)


def _joint_rows(take: str, part: str, track: JointTrack, rate: float) -> pd.DataFrame:
    k = np.arange(len(track.q))
    angles = {f"q{j + 1}": track.q[:, j] for j in range(3)}
    return pd.DataFrame({"take": take, "part": part, "k": k, "t": k / rate} | angles | {"residual": track.residual})


def _quality_rows(take: str, part: str, track: JointTrack) -> pd.DataFrame:
    rows = [(name, float(count), "1") for name, count in track.counts.items()]
    rows.append(("residual_rms", float(np.sqrt(np.nanmean(track.residual**2))), "m"))
    quality = pd.DataFrame(rows, columns=["quantity", "value", "unit"])
    return quality.assign(take=take, part=part, instrument="motion capture")
