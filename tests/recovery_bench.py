"""Valid recordings in memory, and what the stages recover from them, damaged or not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from damage import Files

from pipeline.arm.model import Arm
from pipeline.core.columns import values
from pipeline.core.errors import PipelineError
from pipeline.core.options.analysis import ArticulationSection
from pipeline.core.options.dataset import Dataset
from pipeline.core.options.instruments import Force
from pipeline.perception.articulation import articulate_rows
from pipeline.perception.markers import follower
from pipeline.recordings import depth, motion_capture
from pipeline.recordings.clocks import on_motion_clock
from pipeline.recordings.depth import take_paths
from pipeline.recordings.depth_angles import arm_points
from pipeline.recordings.force import force_rows
from pipeline.recordings.joint_logs import joint_log_rows

SAME = 1e-9  # rad or N: above the rounding of a sum, below the resolution of any instrument


@dataclass(frozen=True)
class Recovered:
    """Joint angles in rad or moments of force in N, ``values`` (N, d) at ``time`` (N,) in s, and
    the counts of the table ``quality``.
    """

    time: np.ndarray
    values: np.ndarray
    counts: dict[str, float]


@dataclass(frozen=True, repr=False)
class Bench:
    """A valid recording, the values recovered from it, and the truth (K, d) at ``time`` (K,)."""

    files: Files
    recover: Callable[[Path], Recovered]
    clean: Recovered
    time: np.ndarray
    truth: np.ndarray

    def error(self, recovered: Recovered) -> float:
        """Root mean square of the recovered values minus the truth, interpolated linearly."""
        due = [np.interp(recovered.time, self.time, column) for column in self.truth.T]
        return float(np.sqrt(np.mean((recovered.values - np.stack(due, axis=-1)) ** 2)))


def recovered_from(files: Files, recover: Callable[[Path], Recovered]) -> Recovered:
    """Recover values from ``files``, written into a folder of their own."""
    with TemporaryDirectory() as folder:
        for name, content in files.items():
            file = Path(folder) / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        return recover(Path(folder))


def outcome(bench: Bench, files: Files, counted: tuple[str, ...]) -> tuple[str, object]:
    """``refused`` with the error, or one of ``repaired``, ``unharmed`` and ``unnoticed`` with the
    recovered values. A repair changes one of the counts ``counted``, an estimate by more than three
    of its standard errors. Any exception but a refusal of the pipeline's own passes through.
    """
    try:
        recovered = recovered_from(files, bench.recover)
    except PipelineError as error:
        return "refused", error
    clean = bench.clean
    for name in counted:
        margin = 3 * clean.counts.get(f"{name}_standard_error", 0.0)
        if abs(recovered.counts.get(name, 0.0) - clean.counts.get(name, 0.0)) > margin:
            return "repaired", recovered
    same = recovered.values.shape == clean.values.shape and np.allclose(
        recovered.values, clean.values, rtol=0, atol=SAME
    )
    return "unharmed" if same else "unnoticed", recovered


def angles_of_markers(raw: Path, dataset: Dataset) -> Recovered:
    """Joint angles of the one take of the motion capture."""
    take, *_ = motion_capture.find_takes(raw, dataset.mocap)
    rows, quality = motion_capture.marker_rows(*take, dataset)
    track = follower(dataset.robot, dataset.mocap)(rows, take=take[0])
    time = np.arange(len(track.q)) / dataset.motion.rate
    return Recovered(time, track.q, _counts(quality) | track.counts)


def angles_of_depth(
    raw: Path,
    dataset: Dataset,
    arm: Arm,
    markers: pd.DataFrame,
    options: ArticulationSection,
    start: np.ndarray,
) -> Recovered:
    """Joint angles of the one take of the depth camera, its clock set by the ``markers``."""
    trajectory = motion_capture.trajectory_rows(raw / dataset.trajectory, dataset)
    take = next(iter(take_paths(raw, dataset.depth).items()))
    frames, quality = depth.frame_rows(take, dataset.depth, arm, raw, raw)
    clouds = arm_points(frames, raw)
    frames, clock = on_motion_clock((frames, markers), dataset.depth, arm)
    joints = dataset.robot.joints
    angles = articulate_rows(frames, clouds, arm, joints, trajectory, options, start)
    counts = {
        "frames_without_fit": len(frames) - len(angles),
        "valid": float(frames["valid"].mean()),
    }
    counts |= _counts([*quality, *clock])
    return Recovered(angles["t"].to_numpy(), values(angles, "q"), counts)


def angles_of_logs(raw: Path, dataset: Dataset, arm: Arm) -> Recovered:
    """Joint angles of the repetitions in a folder of joint logs."""
    _, joints, quality = joint_log_rows(raw, dataset, arm.chain)
    counts = pd.DataFrame(quality).groupby("quantity")["value"].sum().to_dict()
    return Recovered(joints["t"].to_numpy(), values(joints, "q"), counts)


def moments_of_force(raw: Path, name: str, force: Force) -> Recovered:
    """Means and standard deviations (1, 4) in N of the horizontal forces."""
    rows, quality = force_rows(raw, name, force)
    forces = rows[["fx", "fy"]].to_numpy()
    moments = np.hstack([forces.mean(axis=0), forces.std(axis=0)])[None]
    return Recovered(np.zeros(1), moments, _counts(quality))


def _counts(quality: list[dict]) -> dict[str, float]:
    return {row["quantity"]: row["value"] for row in quality}
