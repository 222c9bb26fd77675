"""The recordings that faults are inflicted on, and how the paper's stages recover values from them:
joint angles from markers and from depth frames, moments of force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd

from pipeline.arm.model import Arm
from pipeline.core.columns import columns, values
from pipeline.core.options.dataset import Dataset
from pipeline.core.options.force import Force
from pipeline.perception.articulation import ArticulationOptions, articulate_rows
from pipeline.perception.markers import track_rows
from pipeline.recordings import depth_camera, motion_capture
from pipeline.recordings.depth_clock import on_motion_clock
from pipeline.recordings.depth_points import arm_points
from pipeline.recordings.depth_sequence import take_paths
from pipeline.recordings.force_transducer import force_rows
from pipeline.studies.faults.bench import Bench, Recovered, recovered_from

# of the frames of a depth take, from its start on, is used: the motion out, without the one back
DEPTH_SHARE = 0.5


def joint_angles_of_markers(raw: Path, dataset: Dataset, arm: Arm) -> Recovered:
    """Measured joint angles of the one training take below ``raw``: ingest and track."""
    take, *_ = motion_capture.find_takes(raw, dataset.mocap)
    rows, quality = motion_capture.marker_rows(*take, dataset)
    track = track_rows(rows, dataset.mocap, arm, take=take[0])
    time = np.arange(len(track.q)) / dataset.motion.rate
    return Recovered(time, track.q, _counts(quality) | track.counts)


def joint_angles_of_depth(
    raw: Path,
    dataset: Dataset,
    arm: Arm,
    markers: pd.DataFrame,
    options: ArticulationOptions,
    start: np.ndarray,
) -> Recovered:
    """Joint angles of the one depth take below ``raw``: ingest, track and articulate.

    Args:
        raw: folder of the recordings, with calibration and commanded trajectory; the arm's points
            are written there too.
        dataset: its options.
        arm: the robot's.
        markers: rows of the take's table ``markers``, which set its clock.
        options: of the articulation.
        start: (3,) rad, nominal pose of the first frame.
    """
    trajectory = motion_capture.trajectory_rows(raw / dataset.trajectory, dataset)
    take = next(iter(take_paths(raw, dataset.depth).items()))
    frames, quality = depth_camera.frame_rows(take, dataset.depth, arm, raw, raw)
    clouds = arm_points(frames, raw)
    frames, clock = on_motion_clock((frames, markers), dataset.depth, arm)
    joints = dataset.robot.joints
    angles = articulate_rows(frames, clouds, arm, joints, trajectory, options, start)
    counts = {
        "frames_without_fit": len(frames) - len(angles),
        "valid": float(frames["valid"].mean()),
    }
    return Recovered(
        angles["t"].to_numpy(), values(angles, "q"), _counts([*quality, *clock]) | counts
    )


def moments_of_force(raw: Path, name: str, force: Force) -> Recovered:
    """Means and standard deviations, (1, 4) N, of the horizontal forces of the configuration
    ``name``: ingest.
    """
    rows, quality = force_rows(raw, name, force)
    forces = rows[["fx", "fy"]].to_numpy()
    moments = np.hstack([forces.mean(axis=0), forces.std(axis=0)])[None]
    return Recovered(np.zeros(1), moments, _counts(quality))


def marker_bench(take: str, dataset: Dataset, arm: Arm, truth: pd.DataFrame) -> Bench:
    """One take of the motion capture; ``truth``: the table ``true_joints``."""
    one = SimpleNamespace(
        **vars(dataset) | {"mocap": replace(dataset.mocap, training="optitrack/*.csv", test=None)}
    )
    files = _read(Path(dataset.recordings), [f"optitrack/{take}.csv"])
    recover = partial(joint_angles_of_markers, dataset=one, arm=arm)
    return _bench(files, recover, take, truth, dataset.robot.joints)


def depth_bench(
    take: str,
    dataset: Dataset,
    arm: Arm,
    truth: pd.DataFrame,
    markers: pd.DataFrame,
    options: ArticulationOptions,
    start: np.ndarray,
) -> Bench:
    """The first DEPTH_SHARE of the frames of a depth take.

    Args:
        take: its name.
        dataset: its options.
        arm: the robot's.
        truth: the table ``true_joints``.
        markers: the table ``markers``.
        options: of the articulation.
        start: (3,) rad, nominal pose of the first frame.
    """
    raw, depth = Path(dataset.recordings), dataset.depth
    folder = next(path.relative_to(raw) for path in raw.glob(depth.takes) if path.name == take)
    index = (raw / folder / depth.index).read_text().splitlines(keepends=True)
    comments = [line for line in index if line.startswith("#")]
    frames = [line for line in index if not line.startswith("#")]
    frames = frames[: round(DEPTH_SHARE * len(frames))]
    images = [f"{folder}/{line.split()[1]}" for line in frames]
    files = _read(raw, [dataset.trajectory, depth.intrinsics, *images])
    files[f"{folder}/{depth.index}"] = "".join(comments + frames).encode()
    recover = partial(
        joint_angles_of_depth,
        dataset=dataset,
        arm=arm,
        markers=markers[markers["take"] == take],
        options=options,
        start=start,
    )
    return _bench(files, recover, take, truth, dataset.robot.joints)


def force_bench(dataset: Dataset) -> Bench:
    """Of a force record no truth is known: what a fault changes is measured against the record
    without it.
    """
    name, configuration = next(iter(dataset.force.configurations.items()))
    files = _read(Path(dataset.recordings), [configuration.file])
    recover = partial(moments_of_force, name=name, force=dataset.force)
    clean = recovered_from(files, recover)
    return Bench(files, recover, clean, clean.time, clean.values)


def _bench(
    files: dict[str, bytes], recover, take: str, truth: pd.DataFrame, joints: Sequence[str]
) -> Bench:
    rows = truth[truth["take"] == take]
    poses = rows[columns("q", joints)].to_numpy()
    return Bench(files, recover, recovered_from(files, recover), rows["t"].to_numpy(), poses)


def _read(folder: Path, names: list[str]) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in names}


def _counts(quality: list[dict]) -> dict[str, float]:
    return {row["quantity"]: row["value"] for row in quality}
