"""track: measured joint angles, and the process noise of the training takes (Eq. OmgReal)."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.model import arm_of, chain_of
from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.columns import columns, spread, values
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import SingularJacobianError
from pipeline.models.steps import process_noise
from pipeline.perception.markers import JointTrack, follower
from pipeline.recordings import commands
from pipeline.recordings.depth_takes import on_motion_clock, with_markers
from pipeline.recordings.paths import take_paths
from pipeline.recordings.quality import (
    WITHIN,
    beside_limits,
    compare_takes,
    lag_of_take,
    quality_row,
    reasons,
    require_enough,
)

INGEST = Path("data/ingest")
OUT = Path("data/track")
MOTION = INGEST / "motion"


def run() -> None:
    """Write joint angles, repairs and limits of every take, and the noise of the training takes."""
    settings = config.sections("track")
    dataset = settings.dataset
    with contracts.replacing(OUT) as folder:
        if dataset.robot is None:
            print("track: the dataset has no robot; nothing to do")
            if contracts.exists("take_paths", MOTION):
                paths = contracts.read("take_paths", MOTION)
                contracts.write(paths, "take_paths", folder)
            return
        quality = _quality_of_ingest(dataset)
        repairs: list[dict] = []
        disturbed = pd.DataFrame()
        if dataset.mocap is None:
            source = "joint log"
            print(
                "track: no motion capture; the joint angles are from the controller's log",
            )
            joints = contracts.read("joint_log", MOTION).assign(residual=np.nan)
            disturbed = contracts.read("disturbed_log", MOTION).assign(residual=np.nan)
        else:
            source = "motion capture"
            joints, repairs = _track(dataset)
            quality = quality[quality["instrument"] != "joint log"]
            if dataset.depth is not None:
                repairs += _write_frames(settings, joints, folder)

        takes = pd.concat([quality, pd.DataFrame(repairs)], ignore_index=True)
        takes = beside_limits(takes, vars(dataset.limits))
        _print_lags_and_copies(takes)
        require_enough(takes)
        _print_left_out(takes)
        for row in takes.drop_duplicates("take").itertuples():
            left_out = row.left_out
            repairs.append(
                quality_row(row.take, row.part, source, "left_out", left_out),
            )
        recorded = pd.concat([joints, disturbed])
        paths = take_paths(recorded, takes, chain_of(dataset.robot))
        joints = joints[~joints["take"].isin(takes.loc[takes["left_out"], "take"])]
        if dataset.mocap is not None:
            _cross_check(joints, dataset)
        tables = {
            "take_paths": paths,
            "takes": takes,
            "quality": pd.DataFrame(repairs),
            "joints": joints,
            "process_noise": _process_noise(joints, dataset),
        }
        for name, table in tables.items():
            contracts.write(table, name, folder)


def _quality_of_ingest(dataset) -> pd.DataFrame:
    """Return the losses and repairs of the takes; those of force records belong to no take."""
    tables = [contracts.read("quality", MOTION)]
    if dataset.depth is not None:
        tables.append(contracts.read("quality", INGEST / "depth"))
    return pd.concat(tables)


def _print_left_out(takes: pd.DataFrame) -> None:
    """Print which takes are left out, and why."""
    if left_out := reasons(takes):
        count = takes["take"].nunique()
        print(
            f"track: {len(left_out)} of {count} takes left out: {'; '.join(left_out)}",
        )


def _write_frames(settings, joints: pd.DataFrame, folder: Path) -> list[dict]:
    """Write the table ``frames`` on the motion's clock; return quality rows of the clocks."""
    dataset = settings.dataset
    frames = contracts.read("frames", INGEST / "depth")
    takes = with_markers(frames, contracts.read("markers", MOTION), joints)
    align = partial(on_motion_clock, depth=dataset.depth, arm=arm_of(dataset.robot))
    workers = {"compute": settings.compute, "label": "track: clocks"}
    tables = []
    rows = []
    for table, of_take in run_trials(align, takes, **workers):
        tables.append(table)
        rows += of_take
    contracts.write(pd.concat(tables), "frames", folder)
    return rows


def _track(dataset) -> tuple[pd.DataFrame, list[dict]]:
    """Return the joint angles of every take from its markers, and rows of losses and repairs."""
    mocap = dataset.mocap
    if dataset.limits.longest_gap is not None:
        # a take with a longer gap is left out later, and the gap's length is reported
        mocap = replace(mocap, max_gap=dataset.motion.steps)
    follow = follower(dataset.robot, mocap)
    markers_by_take = contracts.read("markers", MOTION).groupby(
        ["take", "part"],
        sort=False,
    )
    joints = []
    repairs = []
    for (take, part_of_take), markers in markers_by_take:
        track = follow(markers, take=take)
        k = np.arange(len(track.q))
        place = {"take": take, "part": part_of_take, "k": k}
        place["t"] = k / dataset.motion.rate
        angles = spread("q", dataset.robot.joints, track.q)
        joints.append(pd.DataFrame(place | angles | {"residual": track.residual}))
        for row in _losses(track):
            repairs.append(quality_row(take, part_of_take, "motion capture", *row))
    table = pd.concat(joints, ignore_index=True)
    return table, repairs + _beside_others(table, dataset)


def _losses(track: JointTrack) -> list[tuple]:
    """Return quantity, value and unit of each loss and repair of a take."""
    counts = track.counts
    solved = np.flatnonzero(np.isfinite(track.residual))
    distances = np.diff(solved, prepend=-1, append=len(track.residual))
    rows = [
        *counts.items(),
        ("missing_share", counts["missing"] / track.samples, "share"),
        ("longest_gap", int(distances.max()) - 1, "frames"),
        ("residual_rms", float(np.sqrt(np.nanmean(track.residual**2))), "m"),
    ]
    if "relabelled" in counts:
        share = counts["relabelled"] / track.samples
        rows.append(("relabelled_share", share, "share"))
    return rows


def _beside_others(joints: pd.DataFrame, dataset) -> list[dict]:
    """Return the quality rows of each take beside the other takes and the command."""
    rate = dataset.motion.rate
    chain = chain_of(dataset.robot)
    names, q = contracts.stacked(joints, "q")
    measures = compare_takes(q, q, rate, dataset.limits.likeness)
    path = values(contracts.read("trajectory", MOTION), "x")
    late = [lag_of_take(path, chain.coordinates(take), rate) for take in q]
    measures["lag_behind_command"] = np.array(late), "s"
    take_parts = joints.drop_duplicates("take")["part"]
    rows = []
    for quantity, (of_takes, unit) in measures.items():
        for row in zip(names, take_parts, of_takes, strict=True):
            take, part_of_take, value = row
            measured = ("motion capture", quantity, value, unit)
            rows.append(quality_row(take, part_of_take, *measured))
    return rows


def _print_lags_and_copies(takes: pd.DataFrame) -> None:
    """Print the lags behind the command, and takes that are all equal within the noise."""
    by_measure = dict(list(takes.groupby("measure")["value"]))
    late = 1e3 * by_measure["lag_behind_command"]
    print(
        f"track: lag behind the command: median {late.median():.3g} ms, from {late.min():.3g} to"
        f" {late.max():.3g} ms in {len(late)} takes",
    )
    if (by_measure["nearest_take"] <= WITHIN).all():
        print(
            "track: ! each take is equal to another one within the noise: either the arm repeats"
            " within the noise of its instrument, or takes are copies",
        )


def _cross_check(joints: pd.DataFrame, dataset) -> None:
    """Raise RecordingError where tracked ``joints`` contradict the command or the encoders."""
    names = dataset.robot.joints
    chain = chain_of(dataset.robot)
    trajectory = contracts.read("trajectory", MOTION)
    tracked = dict(list(joints.groupby("take")))
    for take, rows in tracked.items():
        q = rows[columns("q", names)].to_numpy()
        commands.require_commanded(q, trajectory, chain, take)
    if contracts.exists("encoders", MOTION):
        for take, rows in contracts.read("encoders", MOTION).groupby("take"):
            if take in tracked:
                commands.require_encoders(tracked[take], rows, names, take)


def _process_noise(joints: pd.DataFrame, dataset) -> pd.DataFrame:
    """Return the table ``process_noise`` of the training takes."""
    training = joints[joints.part == "training"]
    names, q = contracts.stacked(training, "q")
    trajectory = contracts.read("trajectory", MOTION)
    v = commands.commanded_steps(trajectory, dataset.motion.rate)
    try:
        noise = process_noise(chain_of(dataset.robot), q, v)
    except SingularJacobianError as error:
        take, k = error.evidence["index"]
        where = {"take": names[take], "step": k, "q": error.evidence["q"]}
        raise SingularJacobianError(error.message, **where) from None
    rows = training.loc[training.k > 0, ["take", "part", "k", "t"]]
    return rows.assign(**spread("w", dataset.robot.joints, noise))
