"""track: markers (or the controller's own log) → measured joint angles, the ground truth of everything that follows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts
from pipeline.arm.model import load_arm
from pipeline.errors import ConfigError
from pipeline.perception.markers import JointTrack, track_rows
from pipeline.recordings.limits import beside_limits, reasons, require_enough
from pipeline.recordings.quality import quality_row

INGEST, OUT = Path("data/ingest"), Path("data/track")


def run() -> None:
    """Joint angles of every take within the limits, what was repaired to get them, and how good every take is."""
    settings = config.sections("track")
    dataset = settings.dataset
    limits = dict(vars(dataset.limits))
    with contracts.replacing(OUT) as folder:
        quality = contracts.read("quality", INGEST)
        if dataset.mocap is None:
            joints = contracts.read("joint_log", INGEST).assign(residual=np.nan)
            print("track: no motion capture; the controller's log is taken for the measured joint angles")
            source, found = "joint log", []
            limits |= {"disturbance": dataset.joint_log.disturbed_beyond, "greatest_residual": dataset.joint_log.residual_limit}
        else:
            tracks = _tracks(dataset)
            joints = pd.concat([_joint_rows(*key, track, dataset.motion.rate) for key, track in tracks.items()], ignore_index=True)
            source, found = "motion capture", [row for key, track in tracks.items() for row in _quality_rows(*key, track)]
            quality = quality[quality["instrument"] != "joint log"]
        takes = beside_limits(pd.concat([quality, pd.DataFrame(found)], ignore_index=True), limits)
        require_enough(takes)
        if left_out := reasons(takes):
            print(f"track: {len(left_out)} of {takes['take'].nunique()} takes left out: {'; '.join(left_out)}")
        found += [quality_row(row.take, row.part, source, "left_out", row.left_out) for row in takes.drop_duplicates("take").itertuples()]
        contracts.write(takes, "takes", folder)
        contracts.write(pd.DataFrame(found), "quality", folder)
        contracts.write(joints[~joints["take"].isin(takes.loc[takes["left_out"], "take"])], "joints", folder)


def _tracks(dataset) -> dict[tuple[str, str], JointTrack]:
    """By name and part of each take."""
    robot, mocap, longest = dataset.robot, dataset.mocap, dataset.limits.longest_gap
    arm = load_arm(robot.urdf, robot.joints, robot.tool, robot.locked)
    if longest is not None:
        if longest > mocap.max_gap:
            message = f"a gap of {longest} frames is longer than the {mocap.max_gap} that are interpolated, dataset.mocap.max_gap"
            raise ConfigError(message, key="dataset.limits.longest_gap")
        # a take with a longer gap is left out, and has to be followed to its end to be measured
        mocap = replace(mocap, max_gap=dataset.motion.steps)
    takes = contracts.read("markers", INGEST).groupby(["take", "part"], sort=False)
    return {key: track_rows(rows, mocap, arm, take=key[0]) for key, rows in takes}


def _joint_rows(take: str, part: str, track: JointTrack, rate: float) -> pd.DataFrame:
    k = np.arange(len(track.q))
    angles = {f"q{j + 1}": track.q[:, j] for j in range(3)}
    return pd.DataFrame({"take": take, "part": part, "k": k, "t": k / rate} | angles | {"residual": track.residual})


def _quality_rows(take: str, part: str, track: JointTrack) -> list[dict]:
    frames, samples = np.flatnonzero(np.isfinite(track.residual)), 9 * len(track.q)
    gap = int(np.diff(frames, prepend=-1, append=len(track.q)).max()) - 1
    rows = [(name, count, "1") for name, count in track.counts.items()]
    rows += [
        ("missing_share", track.counts["missing"] / samples, "share"),
        ("relabelled_share", track.counts["relabelled"] / samples, "share"),
        ("longest_gap", gap, "frames"),
        ("residual_rms", float(np.sqrt(np.nanmean(track.residual**2))), "m"),
    ]
    return [quality_row(take, part, "motion capture", *row) for row in rows]
