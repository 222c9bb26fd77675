"""Motion-capture takes and the commanded trajectory as tables: SI units, the arm's base frame, the
motion's grid.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.model import chain_of
from pipeline.core.columns import columns, members
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.core.options.instruments import Body, Mocap
from pipeline.formats import motion as motion_formats
from pipeline.formats.format import Kind, format_of, formats_in
from pipeline.formats.motion.take import MotionTake
from pipeline.formats.trajectory import read_trajectory
from pipeline.recordings.cross_check import require_velocities
from pipeline.recordings.quality import quality_row
from pipeline.recordings.take_names import named_takes


def trajectory_rows(file: Path, dataset: Dataset) -> pd.DataFrame:
    """The table ``trajectory`` from its file.

    Raises RecordingError where it is not on the grid of the motion, holds the angles of other
    joints than the arm's, or leaves open what the joints do beside the task.
    """
    motion, table = dataset.motion, read_trajectory(file)
    if len(table) != motion.steps + 1 or not np.isclose(
        table.t.iloc[1] - table.t.iloc[0], 1 / motion.rate, rtol=1e-6
    ):
        raise RecordingError(
            f"the trajectory has {len(table)} rows; dataset.motion asks for {motion.steps + 1} "
            f"at {motion.rate} per second",
            file=file,
        )
    chain, names, joints = chain_of(dataset.robot), members(table, "q"), dataset.robot.joints
    task = members(table, "x")
    if names and chain.task != task:
        if sorted(names) != sorted(joints):
            raise RecordingError(
                f"the trajectory has the joints {', '.join(names)}; the arm's are "
                f"{', '.join(joints)}",
                file=file,
                key="dataset.robot.joints",
            )
        q = table[columns("q", joints)].to_numpy()
        return trajectory_table(chain, q, motion.rate, joints)
    if chain.task != task:
        raise RecordingError(
            f"the trajectory commands {', '.join(task)}, which is not the task of the arm; export "
            "the commanded joints, t and q:JOINT of each",
            file=file,
            key="dataset.robot.task",
        )
    table.insert(0, "k", np.arange(len(table)))
    require_velocities(table, motion.rate, file)
    return table.drop(columns=columns("q", names))


def find_takes(raw: Path, mocap: Mocap) -> list[tuple[str, Path, str]]:
    """Name, file and part of every take below ``raw``; RecordingError where a pattern matches none,
    or two takes have one name.
    """
    takes: dict[str, tuple[Path, str]] = {}
    for part, pattern in (("training", mocap.training), ("test", mocap.test)):
        key = f"dataset.mocap.{part}"
        files = named_takes(raw, pattern, key=key) if pattern else {}
        if pattern and not files:
            raise RecordingError(f"no {part} take matches {pattern!r}", file=raw)
        for name in files.keys() & takes.keys():
            raise RecordingError(
                f"the training take {takes[name][0]} is named {name!r} too",
                file=files[name],
                key=key,
            )
        takes |= {name: (file, part) for name, file in files.items()}
    return [(name, *take) for name, take in takes.items()]


def read_take(file: Path, unit: str | None) -> MotionTake:
    """The take in ``file``, of whichever format it begins like; ``unit`` where the file does not
    say that of its lengths. RecordingError for a file of no format, or that cannot be opened.
    """
    formats = formats_in(motion_formats, Kind.MOTION)
    chosen = format_of(file, formats)
    if chosen is None:
        known = " or ".join(one.name for one in formats)
        raise RecordingError(f"this is no take of motion capture in {known}", file=file)
    return chosen.read(file, unit)


def marker_rows(
    name: str, file: Path, part: str, dataset: Dataset
) -> tuple[pd.DataFrame, list[dict]]:
    """The markers of the take ``name`` in the arm's base frame: those of the template by link, all
    others as unlabelled; and its quality.

    Frames that the file skips are missing samples, and so are ``frozen_frames``: those that repeat
    every position of the one before. Where links are followed by rigid bodies, no marker of another
    name is carried along: nobody can tell it from the bodies' own. Raises RecordingError for a take
    of another rate or length, or without a marker or body of the template.
    """
    from scipy.spatial.transform import Rotation

    mocap, motion = dataset.mocap, dataset.motion
    take = read_take(file, mocap.unit)
    if not np.isclose(take.rate, motion.rate):
        raise RecordingError(
            f"the take is exported at {take.rate} Hz; dataset.motion asks for {motion.rate}",
            file=file,
        )
    steps = take.frame - take.frame[0]
    if steps[-1] != motion.steps:
        raise RecordingError(
            f"the take spans {steps[-1] + 1} frames; the motion has {motion.steps + 1}: export it "
            "whole",
            file=file,
        )
    tracks, stray = _tracks(take, mocap, file)
    frozen = _frozen(np.stack(list(tracks.values()), axis=1))
    for positions in (*tracks.values(), *stray):
        positions[frozen] = np.nan
    rotation = Rotation.from_euler("xyz", mocap.base.rpy).as_matrix()
    k, rows, missing = np.arange(motion.steps + 1), [], 0
    for (link, marker), positions in (
        tracks | {(0, i): positions for i, positions in enumerate(stray, 1)}
    ).items():
        xyz = np.full((len(k), 3), np.nan)
        xyz[steps] = (positions - np.array(mocap.base.position)) @ rotation
        missing += int(np.isnan(xyz[:, 0]).sum()) if link else 0
        identity = {
            "take": name,
            "part": part,
            "k": k,
            "t": k / motion.rate,
            "link": link,
            "marker": marker,
        }
        rows.append(pd.DataFrame(identity | dict(zip("xyz", xyz.T, strict=True))))
    counts = take.counts | {
        "missing_samples": missing,
        "unlabelled_markers": len(stray),
        "frozen_frames": int(frozen.sum()),
    }
    return pd.concat(rows, ignore_index=True), [
        quality_row(name, part, "motion capture", key, value) for key, value in counts.items()
    ]


def _frozen(positions: np.ndarray) -> np.ndarray:
    """(N,) whether a frame of ``positions`` (N, markers, 3) repeats all of the one before: the
    noise of a working tracker prevents it.
    """
    gone = np.isnan(positions)
    same = ((positions[1:] == positions[:-1]) | (gone[1:] & gone[:-1])).all(axis=(1, 2))
    return np.append(False, same & ~gone[1:].all(axis=(1, 2)))


def _tracks(
    take: MotionTake, mocap: Mocap, file: Path
) -> tuple[dict[tuple[int, int], np.ndarray], list[np.ndarray]]:
    """(link, marker) from 1: (N, 3) m in the world frame, and the markers of other names."""
    if unknown := sorted(set(mocap.bodies) - set(mocap.markers)):
        raise ConfigError(
            f"no link {', '.join(unknown)}; there are {', '.join(mocap.markers)}",
            key="dataset.mocap.bodies",
        )
    by_marker = [
        name
        for link, places in mocap.markers.items()
        if link not in mocap.bodies
        for name in places
    ]
    full = _full_names(by_marker, list(take.markers), file)
    tracks = {}
    for link, (name, places) in enumerate(mocap.markers.items(), 1):
        if name in mocap.bodies:
            positions = _carried(take, mocap.bodies[name], np.array(list(places.values())), file)
        else:
            positions = [take.markers[full[marker]] for marker in places]
        tracks |= {(link, i): track for i, track in enumerate(positions, 1)}
    stray = (
        []
        if mocap.bodies
        else [positions for name, positions in take.markers.items() if name not in full.values()]
    )
    return tracks, stray


def _full_names(wanted: list[str], names: list[str], file: Path) -> dict[str, str]:
    """The take's own name of each wanted marker: that name, or the one marker that has it after its
    asset's and a colon.
    """
    full = {}
    for name in wanted:
        fitting = (
            [name]
            if name in names
            else [other for other in names if other.rsplit(":", 1)[-1] == name]
        )
        if len(fitting) > 1:
            raise RecordingError(
                f"{name!r} may be {' or '.join(fitting)}: name it in full",
                file=file,
                key="dataset.mocap.markers",
            )
        if fitting:
            full[name] = fitting[0]
    if absent := sorted(set(wanted) - set(full)):
        having = ", ".join(sorted(names)) or "none"
        raise RecordingError(
            f"no marker named {', '.join(absent)} in the take; it has {having}",
            file=file,
            key="dataset.mocap.markers",
        )
    return full


def _carried(take: MotionTake, body: Body, places: np.ndarray, file: Path) -> np.ndarray:
    """(3, N, 3) m in the world frame: where the body, by its poses, carries the points at
    ``places`` (3, 3) m of its link's segment.
    """
    from scipy.spatial.transform import Rotation

    if body.name not in take.bodies:
        having = ", ".join(sorted(take.bodies)) or "none"
        raise RecordingError(
            f"no rigid body named {body.name} in the take; it has {having}",
            file=file,
            key="dataset.mocap.bodies",
        )
    pose = take.bodies[body.name]
    tracked = np.isfinite(pose.position).all(axis=-1) & np.isfinite(pose.quaternion).all(axis=-1)
    local = (places - np.array(body.mount.position)) @ Rotation.from_euler(
        "xyz", body.mount.rpy
    ).as_matrix()
    carried = np.full((len(places), len(tracked), 3), np.nan)
    if tracked.any():
        turn = Rotation.from_quat(pose.quaternion[tracked]).as_matrix()
        carried[:, tracked] = pose.position[tracked] + np.einsum("nab,mb->mna", turn, local)
    return carried
