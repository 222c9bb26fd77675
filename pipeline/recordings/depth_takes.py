"""Depth takes after ingest: their frames on the motion capture's clock, points on the arm, and the
joint angles that fit the points.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.model import Arm, arm_of
from pipeline.core import contracts
from pipeline.core.columns import columns, members, spread, values
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import RecordingError
from pipeline.core.options.analysis import ArticulationSection, Compute
from pipeline.core.options.dataset import Depth, Robot
from pipeline.perception.articulation import fit_sequence
from pipeline.recordings.clocks import Offset, find_offset
from pipeline.recordings.quality import DEPTH_CAMERA, quality_rows, residual_share

INGEST = Path("data/ingest")
TRACK = Path("data/track")
MOTION = INGEST / "motion"
DEPTH = INGEST / "depth"
# rad: ≤ 0.006 in the laboratory; 0.025 for 2 % of fx, 0.042 or more for 5 %
MOST_BIAS = 0.02
# rad: bias of another arm or camera; mirrored images make 0.7 or more
REFUSED_BIAS = 0.2
# images of another take: takes that are compared, and frames that separate their residuals
OTHERS = 5
FEWEST_FRAMES = 40


class CameraTake(NamedTuple):
    """Rows of a depth take: frames, markers, joints, and as a comparison of other takes."""

    rows: pd.DataFrame
    markers: pd.DataFrame
    joints: list[pd.DataFrame]


def with_markers(
    frames: pd.DataFrame,
    markers: pd.DataFrame,
    joints: pd.DataFrame,
) -> list[CameraTake]:
    """Return the depth takes with markers and joint angles; RecordingError without markers."""
    by_take = dict(list(markers.groupby("take")))
    tracked = dict(list(joints.groupby("take")))
    names = [*tracked]
    takes = []
    for take, rows in frames.groupby("take", sort=False):
        if take not in by_take:
            message = "no motion-capture take has this name, so that the clock offset is unknown"
            raise RecordingError(message, file=rows["file"].iloc[0], take=take)
        place = names.index(take)
        in_turn = names[place:] + names
        compared = [tracked[name] for name in in_turn[: OTHERS + 1]]
        takes.append(CameraTake(rows, by_take[take], compared))
    return takes


def camera_residuals(
    seen: tuple[np.ndarray, np.ndarray],
    joints: list[pd.DataFrame],
    arm: Arm,
    search: tuple,
) -> list[float]:
    """Return the residuals in m of the centroids ``seen`` (times (F,) s, (F, 2) m) from the affine
    maps of the arm's joints and tip in each of the takes ``joints``; infinite for a take that does
    not move alike.
    """
    residuals = []
    for rows in joints:
        table = rows.drop(columns="residual").dropna()
        nodes = arm.chain.points(values(table, "q"))[:, 1:]
        nodes = nodes.reshape(len(table), -1)
        path = table["t"].to_numpy(), np.ascontiguousarray(nodes)
        try:
            residuals.append(find_offset(*seen, *path, search=search).residual)
        except RecordingError:
            residuals.append(np.inf)
    return residuals


def on_motion_clock(
    take: CameraTake,
    depth: Depth,
    arm: Arm,
) -> tuple[pd.DataFrame, list[dict]]:
    """Return the rows of the table ``frames`` of a ``take`` on the motion capture's clock, and the
    quality of the offset. Unless stated, :func:`find_offset` compares the centroids of the arm's
    points and of the labelled markers in the arm's plane, and :func:`residual_share` compares the
    :func:`camera_residuals` of the take with the residuals of other takes.
    """
    rows = take.rows
    offset = depth.clock_offset
    name = rows["take"].iloc[0]
    quality: dict[str, tuple[float, str]] = {}
    if offset is None:
        estimate, quality = _estimated_offset(take, depth, arm)
        offset = estimate.value
    values = {"clock_offset": (offset, "s")} | quality
    notes = [(quantity, *value) for quantity, value in values.items()]
    of_offset = quality_rows(name, "test", DEPTH_CAMERA, notes)
    return rows.assign(t=rows["t"] + offset), of_offset


def _estimated_offset(
    take: CameraTake,
    depth: Depth,
    arm: Arm,
) -> tuple[Offset, dict[str, tuple[float, str]]]:
    """Return the offset of the camera's clock in a ``take``, and quantity → value and unit of its
    quality; RecordingError where no frame shows the arm.
    """
    rows = take.rows
    search = (-depth.search, depth.search)
    name = rows["take"].iloc[0]
    observed = rows[rows["points"] > 0]
    if observed.empty:
        raise RecordingError(
            "no frame shows the arm: check the unit of depth, the camera's pose and the "
            "workspace",
            file=rows["file"].iloc[0],
            take=name,
        )
    centroids = np.ascontiguousarray(observed[["x", "z"]].to_numpy())
    signal = observed["t"].to_numpy(), centroids
    offset = find_offset(*signal, *_marker_path(take.markers, arm), search, name)
    quality = {
        "clock_offset_standard_error": (offset.standard_error, "s"),
        "clock_drift": (offset.drift, "s/s"),
        "clock_drift_standard_error": (offset.drift_standard_error, "s/s"),
        "clock_correlation": (offset.correlation, "1"),
    }
    if len(take.joints) > 1 and len(observed) >= FEWEST_FRAMES:
        residual, *of_other_takes = camera_residuals(signal, take.joints, arm, search)
        share = residual_share(centroids, residual, of_other_takes)
        quality["camera_residual"] = residual, "m"
        quality["camera_residual_share"] = share, "share"
    return offset, quality


def _marker_path(markers: pd.DataFrame, arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    """Return times (K,) s and centroids (K, 2) m in the arm's plane of the labelled markers."""
    labelled = markers[markers["link"] > 0]
    positions = labelled[["x", "y", "z"]].to_numpy()
    x_and_z = arm.to_plane(positions)[:, [0, 2]]
    points = pd.DataFrame(x_and_z, index=labelled["t"])
    centroids = points.groupby(level="t").mean(skipna=False)
    path = centroids.dropna()
    times = path.index.to_numpy()
    return times, np.ascontiguousarray(path)


def arm_points(rows: pd.DataFrame, folder: Path) -> list[np.ndarray]:
    """Return the arm's points (I, 2), m in the arm's plane, of all frames of a take."""
    take = rows["take"].iloc[0]
    points = np.load(folder / f"{take}.npy")
    ends = np.cumsum(rows["points"])
    return np.split(points, ends[:-1])


def kept_takes() -> list[pd.DataFrame]:
    """Return the rows of the table ``frames`` of every take that the stage ``track`` kept."""
    frames = contracts.read("frames", TRACK)
    joints = contracts.read("joints", TRACK)
    tracked = frames[frames["take"].isin(joints["take"])]
    return [rows for _, rows in tracked.groupby("take")]


def articulate_takes(
    takes: list[pd.DataFrame],
    robot: Robot,
    options: ArticulationSection,
    compute: Compute,
) -> pd.DataFrame:
    """Return the table ``angles`` of ``takes`` (from :func:`kept_takes`)."""
    joints = contracts.read("joints", TRACK)
    first = joints[(joints.part == "training") & (joints.k == 0)]
    start = first[columns("q", robot.joints)].mean().to_numpy()
    fit = partial(
        _articulate,
        arm=arm_of(robot),
        joints=robot.joints,
        trajectory=contracts.read("trajectory", MOTION),
        options=options,
        start=start,
    )
    tables = run_trials(fit, takes, compute=compute, label="articulate: takes")
    return pd.concat(tables, ignore_index=True)


def _articulate(rows: pd.DataFrame, **settings: object) -> pd.DataFrame:
    return articulate_rows(rows, arm_points(rows, DEPTH), **settings)


def articulate_rows(
    rows: pd.DataFrame,
    clouds: Sequence[np.ndarray],
    arm: Arm,
    joints: Sequence[str],
    trajectory: pd.DataFrame,
    options: ArticulationSection,
    start: np.ndarray,
) -> pd.DataFrame:
    """Return the rows of the table ``angles`` of one take by :func:`fit_sequence`, without gaps;
    ``rows`` are of the table ``frames``, ``start`` (3,) rad is the pose about the first frame.
    """
    x = np.interp(rows["t"], trajectory["t"], trajectory["x:x"])
    z = np.interp(rows["t"], trajectory["t"], trajectory["x:z"])
    fitted = fit_sequence(
        clouds,
        arm.chain.origin,
        np.stack([x, z], axis=-1),
        arm.chain,
        options,
        start,
        take=rows["take"].iloc[0],
    )
    coordinates = fitted.nodes[:, 1:].reshape(-1, 6).T
    names = ["x2", "z2", "x3", "z3", "xe", "ze"]

    columns = spread("q", joints, fitted.q)
    columns |= dict(zip(names, coordinates, strict=True))
    columns["points"] = [len(cloud) for cloud in clouds]
    columns["objective"] = fitted.objective
    table = rows[["take", "part", "frame", "t"]].assign(**columns)
    return table[np.isfinite(fitted.objective)]


def bias_warning(errors: pd.DataFrame) -> str:
    """Return a warning if the mean of one joint's angle ``errors`` (family e, rad; depth camera
    minus motion capture) exceeds MOST_BIAS, else ""; RecordingError beyond REFUSED_BIAS.
    """
    mean = errors[columns("e", members(errors, "e"))].mean()
    worst = str(mean.abs().idxmax())
    if abs(mean[worst]) <= MOST_BIAS:
        return ""
    message = (
        f"{worst[2:]} in the depth images is {mean[worst]:+.3g} rad off the motion capture on "
        f"average, more than {MOST_BIAS:g}: check the camera's intrinsics (fx, fy, cx, cy; "
        "5 % of fx make about 0.05 rad) and dataset.depth.camera"
    )
    if abs(mean[worst]) > REFUSED_BIAS:
        remedy = "mirrored images are not this camera's: turn them back"
        raise RecordingError(f"{message}; {remedy}")
    return message
