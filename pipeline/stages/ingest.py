"""ingest: raw logs → typed tables in SI units on the motion clock, with a quality record per take."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pandas as pd

from pipeline import config, contracts
from pipeline.arm.model import load_arm
from pipeline.compute.trials import run_trials
from pipeline.errors import ConfigError, RecordingError
from pipeline.recordings import depth_camera, motion_capture
from pipeline.recordings.force_transducer import force_rows
from pipeline.recordings.joint_logs import joint_log_rows

OUT = Path("data/ingest")


def run() -> None:
    """Read what the dataset has; say of every instrument it lacks that its part of the analysis falls away."""
    settings = config.sections("ingest")
    dataset = settings.dataset
    raw = Path(dataset.recordings)
    if not raw.is_dir():
        raise RecordingError("the folder of the recordings does not exist; see its datasheet for how to get them", file=raw)
    if dataset.depth is not None and dataset.mocap is None:
        raise ConfigError("a depth camera needs the motion capture that its clock is set by", key="dataset.depth")
    arm = load_arm(dataset.robot.urdf, dataset.robot.joints, dataset.robot.tool, dataset.robot.locked)
    with contracts.replacing(OUT) as folder:
        quality = []

        def write(name: str, takes: list[tuple[pd.DataFrame, list[dict]]]) -> pd.DataFrame:
            table = pd.concat([rows for rows, _ in takes], ignore_index=True)
            contracts.write(table, name, folder)
            quality.extend(row for _, rows in takes for row in rows)
            return table

        if dataset.joint_log is not None:
            trajectory, *joints = joint_log_rows(raw, dataset, arm)
            contracts.write(trajectory, "trajectory", folder)
            write("joint_log", [tuple(joints)])
            for row in quality:
                if row["quantity"] == "repetitions" or row["quantity"].endswith("_from_row"):
                    print(f"ingest: {row['take']}: {row['quantity'].replace('_', ' ')} {row['value']:.0f}")
        if dataset.trajectory is not None:
            contracts.write(motion_capture.trajectory_rows(raw / dataset.trajectory, dataset.motion), "trajectory", folder)
        if dataset.mocap is not None:
            takes = motion_capture.find_takes(raw, dataset.mocap)
            markers = write("markers", [motion_capture.marker_rows(*take, dataset) for take in takes])
        if dataset.depth is not None:
            read = partial(depth_camera.frame_rows, depth=dataset.depth, arm=arm, raw=raw)
            takes = depth_camera.find_takes(raw, dataset.depth, markers, arm)
            write("frames", list(run_trials(read, takes, compute=settings.compute, label="ingest: depth takes")))
        if dataset.force is not None:
            write("force", [force_rows(raw, name, dataset.force) for name in dataset.force.configurations])
        for instrument in ("mocap", "depth", "force"):
            if getattr(dataset, instrument) is None:
                print(f"ingest: the dataset {dataset.name} has no {instrument}; what needs it is left out")
        contracts.write(pd.DataFrame(quality), "quality", folder)
