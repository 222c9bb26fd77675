"""Tables of motion-capture takes and the commanded trajectory, in SI units at the motion's rate."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.arm.interface import trajectory_table
from pipeline.arm.model import chain_of
from pipeline.core.columns import columns, members
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Dataset, Mocap, Pose
from pipeline.formats import motion as motion_formats
from pipeline.formats.format import Kind, format_of, formats_in
from pipeline.formats.motion.take import MotionTake, RigidBody
from pipeline.formats.trajectory import STEP_TOLERANCE, read_trajectory
from pipeline.recordings.commands import require_velocities
from pipeline.recordings.inventory import named_takes
from pipeline.recordings.movement import require_speeds
from pipeline.recordings.quality import quality_row

ANOTHER_UNIT = 1.5  # least factor of distances between markers that is of a wrong unit


def trajectory_rows(file: Path, dataset: Dataset) -> pd.DataFrame:
    """Return the table ``trajectory`` of a file; RecordingError for another length or rate than
    ``dataset.motion``, and where neither the joints nor the task coordinates are the arm's.
    """
    motion, table, joints = dataset.motion, read_trajectory(file), dataset.robot.joints
    duration = table["t"].iloc[-1] - table["t"].iloc[0]
    # times may be rounded to microseconds: 1/120 s is written as 0.008333
    rated = abs(duration - motion.steps / motion.rate) < STEP_TOLERANCE
    if len(table) != motion.steps + 1 or not rated:
        message = (
            f"the trajectory has {len(table)} rows in {duration:.6f} s; dataset.motion"
        )
        message += (
            f" requires {motion.steps + 1} in {motion.steps / motion.rate:.6f} s, at"
        )
        message += f" {motion.rate:g} per second"
        raise RecordingError(message, file=file)
    chain, names, task = (
        chain_of(dataset.robot),
        members(table, "q"),
        members(table, "x"),
    )
    if chain.task == task:
        table.insert(0, "k", np.arange(len(table)))
        require_velocities(table, motion.rate, file)
        return table.drop(columns=columns("q", names))
    if sorted(names) != sorted(joints):
        message = (
            f"the trajectory has the joints {', '.join(names) or 'none'} and the task"
        )
        message += f" {', '.join(task) or 'none'}; the arm has the joints {', '.join(joints)} and"
        message += (
            f" the task {', '.join(chain.task)}: export t and one q:JOINT per joint"
        )
        raise RecordingError(message, file=file, key="dataset.robot.joints")
    q = table[columns("q", joints)].to_numpy()
    require_speeds(
        table["t"].to_numpy(), {"target": q}, joints, dataset.robot.urdf, file=file
    )
    return trajectory_table(chain, q, motion.rate, joints)


def find_takes(raw: Path, mocap: Mocap) -> list[tuple[str, Path, str]]:
    """Return name, file and part of every take; RecordingError for no take, or two of one name."""
    takes: dict[str, tuple[Path, str]] = {}
    for part in ("training", "test"):
        key, pattern = f"dataset.mocap.{part}", getattr(mocap, part)
        files = (
            named_takes(raw, pattern, key=key, what=f"{part} take") if pattern else {}
        )
        for name in files.keys() & takes.keys():
            message = f"the training take {takes[name][0]} has the same name {name!r}; rename one"
            raise RecordingError(message, file=files[name], key=key)
        takes |= {name: (file, part) for name, file in files.items()}
    return [(name, *take) for name, take in takes.items()]


def read_take(file: Path, unit: str | None) -> MotionTake:
    """Return the take in ``file`` by its format; ``unit`` of lengths if the file states none."""
    formats = formats_in(motion_formats, Kind.MOTION)
    if chosen := format_of(file, formats):
        return chosen.read(file, unit)
    known = " or ".join(one.name for one in formats)
    raise RecordingError(f"this is no take of motion capture in {known}", file=file)


def marker_rows(
    name: str, file: Path, part: str, dataset: Dataset
) -> tuple[pd.DataFrame, list[dict]]:
    """Return the markers of the take ``name`` in m in the arm's base frame, and the quality rows.

    Markers of the template have the number of their link, from 1. Other markers have link 0, and
    are left out if rigid bodies track the links. Skipped frames and ``frozen_frames`` (all
    positions equal to the frame before) are missing samples; ``named_otherwise`` counts another
    name in the header. Raises RecordingError for another rate or length, for a missing marker or
    body, and for the name of another file in the header.
    """
    mocap, motion = dataset.mocap, dataset.motion
    take = read_take(file, mocap.unit)
    frames = take.frame - take.frame[0]
    if not np.isclose(take.rate, motion.rate) or frames[-1] != motion.steps:
        message = (
            f"the take spans {frames[-1] + 1} frames at {take.rate} Hz; the motion has"
        )
        message += f" {motion.steps + 1} at {motion.rate} Hz (dataset.motion): export all frames"
        raise RecordingError(message, file=file)
    tracks, stray = _tracks(take, mocap, file)
    _require_size(tracks, mocap, take.unit, file)
    positions = np.stack([*tracks.values(), *stray], axis=1)
    known = positions[:, : len(tracks)]
    gone = np.isnan(known)
    same = ((known[1:] == known[:-1]) | (gone[1:] & gone[:-1])).all(axis=(1, 2))
    frozen = np.append(False, same & ~gone[1:].all(axis=(1, 2)))
    positions[frozen] = np.nan
    rotation = Rotation.from_euler("xyz", mocap.base.rpy).as_matrix()
    k, rows, missing = np.arange(motion.steps + 1), [], 0
    identities = [*tracks, *((0, i) for i in range(1, len(stray) + 1))]
    for (link, marker), track in zip(identities, positions.swapaxes(0, 1), strict=True):
        xyz = np.full((len(k), 3), np.nan)
        xyz[frames] = (
            np.ascontiguousarray(track) - np.array(mocap.base.position)
        ) @ rotation
        missing += int(np.isnan(xyz[:, 0]).sum()) if link else 0
        row = {"take": name, "part": part, "k": k, "t": k / motion.rate}
        row |= {"link": link, "marker": marker}
        rows.append(pd.DataFrame(row | dict(zip("xyz", xyz.T, strict=True))))
    counts = take.counts | {
        "missing_samples": missing,
        "unlabelled_markers": len(stray),
    }
    counts |= {"frozen_frames": int(frozen.sum())}
    if not _is_named_by(take.name, file):
        counts["named_otherwise"] = 1
    quality = [
        quality_row(name, part, "motion capture", *count) for count in counts.items()
    ]
    return pd.concat(rows, ignore_index=True), quality


def _is_named_by(stated: str, file: Path) -> bool:
    """Return whether the name ``stated`` in a take agrees with its ``file``, but for signs and an
    appended word; RecordingError where it is the name of another file beside it.
    """

    def plain(name: str) -> str:
        return re.sub(r"[\W_]+", "_", name.casefold())

    if f"{plain(file.stem)}_".startswith(f"{plain(stated)}_"):
        return True
    beside = {plain(path.stem) for path in file.parent.glob(f"*{file.suffix}")}
    if plain(stated) in beside:
        message = f"the take is {stated!r} by its header, and another file has this name: restore "
        raise RecordingError(
            f"{message}the files' names, or export both again", file=file
        )
    print(
        f"ingest: {file.name}: the take is {stated!r} by its header; the file's name is used"
    )
    return False


def _tracks(
    take: MotionTake, mocap: Mocap, file: Path
) -> tuple[dict[tuple[int, int], np.ndarray], list[np.ndarray]]:
    """Return (link, marker) → positions (N, 3) m in the world frame, and other markers'."""
    if unknown := sorted(set(mocap.bodies) - set(mocap.markers)):
        message = f"no link {', '.join(unknown)}; there are {', '.join(mocap.markers)}"
        raise ConfigError(message, key="dataset.mocap.bodies")

    def find(
        kind: str, names: Iterable[str], recorded: Iterable[str], key: str
    ) -> dict[str, str]:
        fits = {
            n: [r for r in recorded if n in (r, r.rpartition(":")[2])] for n in names
        }
        fits = {n: [n] if n in own else own for n, own in fits.items()}
        several = (
            f"{n!r} may be {' or '.join(own)}"
            for n, own in fits.items()
            if len(own) > 1
        )
        fault = "; ".join(f"{words}: write the full name" for words in several)
        if missing := [name for name, own in fits.items() if not own]:
            there = ", ".join(sorted(recorded)) or "none"
            fault = f"no {kind} named {', '.join(missing)} in the take; it has {there}"
        if fault:
            raise RecordingError(fault, file=file, key=f"dataset.mocap.{key}")
        return {name: own for name, (own,) in fits.items()}

    free = [at for link, at in mocap.markers.items() if link not in mocap.bodies]
    marker = find(
        "marker", [name for at in free for name in at], take.markers, "markers"
    )
    named = find(
        "rigid body", [b.name for b in mocap.bodies.values()], take.bodies, "bodies"
    )
    tracks = {}
    for number, (link, places) in enumerate(mocap.markers.items(), 1):
        if body := mocap.bodies.get(link):
            pose = take.bodies[named[body.name]]
            positions = _carry(pose, body.mount, np.array([*places.values()]))
        else:
            positions = [take.markers[marker[name]] for name in places]
        tracks |= {(number, i): track for i, track in enumerate(positions, 1)}
    used = {*marker.values()}
    others = [name for name in take.markers if name not in used and not mocap.bodies]
    return tracks, [take.markers[name] for name in others]


def _require_size(
    tracks: Mapping[tuple, np.ndarray], mocap: Mocap, unit: str, file: Path
) -> None:
    """Raise RecordingError where the root mean square distance of a link's markers from their
    centre is ANOTHER_UNIT times the template's or more, or as small, in the median over the rows;
    ``tracks`` (N, 3) in m. Labels that are exchanged leave it as it is.
    """
    for number, (link, places) in enumerate(mocap.markers.items(), 1):
        if link in mocap.bodies or len(places) < 2:
            continue
        seen = np.stack([tracks[number, n] for n in range(1, len(places) + 1)])
        sizes = np.sort(np.linalg.norm(seen.std(axis=0), axis=1))
        middle = sizes[np.isfinite(sizes).sum() // 2]  # NaN if no row has all
        size = middle / np.linalg.norm(np.std([*places.values()], axis=0))
        if size >= ANOTHER_UNIT or size <= 1 / ANOTHER_UNIT:
            message = f"the markers of {link} are {size:.3g} times as far apart as in the template:"
            message += (
                f" are lengths in {unit}, the template's in m? Export in the right unit"
            )
            raise RecordingError(
                message, file=file, key=f"dataset.mocap.markers.{link}"
            )


def _carry(pose: RigidBody, mounted: Pose, places: np.ndarray) -> np.ndarray:
    """Return the positions (P, N, 3) m of ``places`` (P, 3) m on a link by a body's ``pose``."""
    tracked = np.isfinite(pose.position).all(axis=-1) & np.isfinite(
        pose.quaternion
    ).all(axis=-1)
    mount = Rotation.from_euler("xyz", mounted.rpy).as_matrix()
    local = (places - np.array(mounted.position)) @ mount
    carried = np.full((len(places), len(tracked), 3), np.nan)
    if tracked.any():
        turn = Rotation.from_quat(pose.quaternion[tracked]).as_matrix()
        carried[:, tracked] = pose.position[tracked] + np.einsum(
            "nab,mb->mna", turn, local
        )
    return carried
