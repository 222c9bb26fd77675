"""ingest@part: raw logs → typed tables in SI units, with a quality record. Each part imports what
it reads with: a reader of depth frames is no force's business.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pandas as pd

from pipeline.core import config, contracts
from pipeline.core.bounds import within
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError

OUT = Path("data/ingest")

Takes = list[tuple[pd.DataFrame, list[dict]]]  # of each take its rows and its quality


def run(part: str) -> None:
    """Read what the dataset has of the ``part`` motion, depth or force; say what it lacks."""
    settings = config.sections("ingest")
    parts = {"motion": _motion, "depth": _depth, "force": _force}
    with contracts.replacing(OUT / part) as folder:
        raw = Path(settings.dataset.recordings)
        quality = within(settings.dataset.reading, parts[part], settings, raw, folder)
        if quality:
            contracts.write(pd.DataFrame(quality), "quality", folder)
        else:
            name = settings.dataset.name
            print(f"ingest: the dataset {name} has no {part}; what needs it is left out")


def _motion(settings, raw: Path, folder: Path) -> list[dict]:
    """Markers, the commanded trajectory, and the joints that the robot's controller logged or its
    encoders read.
    """
    from pipeline.recordings import motion_capture

    dataset, quality = settings.dataset, []
    if dataset.joint_log is not None:
        from pipeline.arm.model import chain_of
        from pipeline.recordings.joint_logs import joint_log_rows
        from pipeline.recordings.quality import REPETITIONS

        trajectory, joints, quality = joint_log_rows(raw, dataset, chain_of(dataset.robot))
        contracts.write(trajectory, "trajectory", folder)
        contracts.write(joints, "joint_log", folder)
        for row in quality:
            if row["quantity"] == REPETITIONS or row["unit"] == "row":
                what = row["quantity"].replace("_", " ")
                print(f"ingest: {row['take']}: {what} {row['value']:.0f}")
    if dataset.trajectory is not None:
        trajectory = motion_capture.trajectory_rows(raw / dataset.trajectory, dataset)
        contracts.write(trajectory, "trajectory", folder)
    if dataset.mocap is not None:
        takes = motion_capture.find_takes(raw, dataset.mocap)
        read = [motion_capture.marker_rows(*take, dataset) for take in takes]
        quality = quality + _write(read, "markers", folder)
    if dataset.encoders is not None:
        from pipeline.recordings.encoders import encoder_rows

        quality = quality + _write(encoder_rows(raw, dataset), "encoders", folder)
    return quality


def _depth(settings, raw: Path, folder: Path) -> list[dict]:
    """Of every depth frame its time on the camera's clock and the arm's points."""
    from pipeline.arm.model import arm_of
    from pipeline.recordings.depth_camera import frame_rows
    from pipeline.recordings.depth_sequence import take_paths

    dataset = settings.dataset
    if dataset.depth is None:
        return []
    if dataset.mocap is None:
        message = "a depth camera needs the motion capture that its clock is set by"
        raise ConfigError(message, key="dataset.depth")
    arm = arm_of(dataset.robot)
    takes = take_paths(raw, dataset.depth)
    read = partial(frame_rows, depth=dataset.depth, arm=arm, raw=raw, folder=folder.resolve())
    # workers do not share the bounds of this process
    bounded = partial(within, dataset.reading, read)
    rows = run_trials(
        bounded, list(takes.items()), compute=settings.compute, label="ingest: depth takes"
    )
    return _write(list(rows), "frames", folder)


def _force(settings, raw: Path, folder: Path) -> list[dict]:
    """Force records without their bias."""
    from pipeline.recordings.force_transducer import force_rows

    force = settings.dataset.force
    if force is None:
        return []
    return _write([force_rows(raw, name, force) for name in force.configurations], "force", folder)


def _write(takes: Takes, name: str, folder: Path) -> list[dict]:
    contracts.write(pd.concat([rows for rows, _ in takes], ignore_index=True), name, folder)
    return [row for _, rows in takes for row in rows]
