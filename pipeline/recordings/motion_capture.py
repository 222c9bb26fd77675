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
from pipeline.recordings.quality import quality_rows

ANOTHER_UNIT = 1.5  # least factor of distances between markers that is of a wrong unit


def trajectory_rows(file: Path, dataset: Dataset) -> pd.DataFrame:
    """Return the table ``trajectory`` of a file; RecordingError for another length or rate than
    ``dataset.motion``, and where neither the joints nor the task coordinates are the arm's.
    """
    motion = dataset.motion
    table = read_trajectory(file)
    joints = dataset.robot.joints
    times = table["t"]
    duration = times.iloc[-1] - times.iloc[0]
    # times may be rounded to microseconds: 1/120 s is written as 0.008333
    rated = abs(duration - motion.steps / motion.rate) < STEP_TOLERANCE
    if len(table) != motion.steps + 1 or not rated:
        raise RecordingError(
            f"the trajectory has {len(table)} rows in {duration:.6f} s; dataset.motion "
            f"requires {motion.steps + 1} in {motion.steps / motion.rate:.6f} s, at "
            f"{motion.rate:g} per second",
            file=file,
        )
    chain = chain_of(dataset.robot)
    names = members(table, "q")
    task = members(table, "x")
    if chain.task == task:
        table.insert(0, "k", np.arange(len(table)))
        require_velocities(table, motion.rate, file)
        return table.drop(columns=columns("q", names))
    if sorted(names) != sorted(joints):
        raise RecordingError(
            f"the trajectory has the joints {', '.join(names) or 'none'} and the task "
            f"{', '.join(task) or 'none'}; the arm has the joints {', '.join(joints)} and "
            f"the task {', '.join(chain.task)}: export t and one q:JOINT per joint",
            file=file,
            key="dataset.robot.joints",
        )
    q = table[columns("q", joints)].to_numpy()
    time = table["t"].to_numpy()
    urdf = dataset.robot.urdf
    require_speeds(time, {"target": q}, joints, urdf, file=file)
    return trajectory_table(chain, q, motion.rate, joints)


def find_takes(raw: Path, mocap: Mocap) -> list[tuple[str, Path, str]]:
    """Return name, file and part of every take; RecordingError for no take, or two of one name."""
    takes = []
    training = {}
    if mocap.training:
        key = "dataset.mocap.training"
        training = named_takes(raw, mocap.training, key=key, what="training take")
        takes += [(name, file, "training") for name, file in training.items()]
    if mocap.test:
        key = "dataset.mocap.test"
        test = named_takes(raw, mocap.test, key=key, what="test take")
        for name, file in test.items():
            if name in training:
                same = f"the training take {training[name]} has the same name {name!r}"
                raise RecordingError(f"{same}; rename one", file=file, key=key)
            takes.append((name, file, "test"))
    return takes


def read_take(file: Path, unit: str | None) -> MotionTake:
    """Return the take in ``file`` by its format; ``unit`` of lengths if the file states none."""
    formats = formats_in(motion_formats, Kind.MOTION)
    chosen = format_of(file, formats)
    if chosen is None:
        names = " or ".join(motion_format.name for motion_format in formats)
        message = f"this is no take of motion capture in {names}"
        raise RecordingError(message, file=file)
    return chosen.read(file, unit)


def marker_rows(
    name: str,
    file: Path,
    part_name: str,
    dataset: Dataset,
) -> tuple[pd.DataFrame, list[dict]]:
    """Return the markers of the take ``name`` in m in the arm's base frame, and the quality rows.

    Markers of the template have the number of their link, from 1. Other markers have link 0, and
    are left out if rigid bodies track the links. Skipped frames and ``frozen_frames`` (all
    positions equal to the frame before) are missing samples; ``named_otherwise`` counts another
    name in the header. Raises RecordingError for another rate or length, for a missing marker or
    body, and for the name of another file in the header.
    """
    mocap = dataset.mocap
    motion = dataset.motion
    take = read_take(file, mocap.unit)
    frames = take.frame - take.frame[0]
    if not np.isclose(take.rate, motion.rate) or frames[-1] != motion.steps:
        raise RecordingError(
            f"the take spans {frames[-1] + 1} frames at {take.rate} Hz; the motion has "
            f"{motion.steps + 1} at {motion.rate} Hz (dataset.motion): export all frames",
            file=file,
        )
    tracks, stray = _tracks(take, mocap, file)
    _require_size(tracks, mocap, take.unit, file)
    labelled = len(tracks)
    for number, track in enumerate(stray, start=1):
        tracks[0, number] = track
    positions = np.stack([*tracks.values()], axis=1)
    frozen = _frozen_frames(positions[:, :labelled])
    positions[frozen] = np.nan

    rotation = Rotation.from_euler("xyz", mocap.base.rpy).as_matrix()
    origin = np.array(mocap.base.position)
    k = np.arange(motion.steps + 1)
    tables = []
    for (link, marker), track in zip(tracks, positions.swapaxes(0, 1), strict=True):
        xyz = np.full((len(k), 3), np.nan)
        xyz[frames] = (np.ascontiguousarray(track) - origin) @ rotation
        columns_of_marker = {"take": name, "part": part_name, "k": k}
        columns_of_marker |= {"t": k / motion.rate, "link": link, "marker": marker}
        columns_of_marker |= zip("xyz", xyz.T, strict=True)
        tables.append(pd.DataFrame(columns_of_marker))

    table = pd.concat(tables, ignore_index=True)
    missing = table.loc[table["link"] > 0, "x"].isna()
    counts = dict(take.counts)
    counts["missing_samples"] = int(missing.sum())
    counts["unlabelled_markers"] = len(stray)
    counts["frozen_frames"] = int(frozen.sum())
    if not _is_named_by(take.name, file):
        counts["named_otherwise"] = 1
    quality = quality_rows(name, part_name, "motion capture", counts.items())
    return table, quality


def _frozen_frames(positions: np.ndarray) -> np.ndarray:
    """Return the mask (N,) of the frames with markers whose ``positions`` (N, P, 3) m all equal the
    positions in the frame before.
    """
    gone = np.isnan(positions)
    equal = positions[1:] == positions[:-1]
    both_gone = gone[1:] & gone[:-1]
    same = (equal | both_gone).all(axis=(1, 2))
    empty = gone[1:].all(axis=(1, 2))
    return np.append(False, same & ~empty)


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
        raise RecordingError(
            f"the take is {stated!r} by its header, and another file has this name: restore "
            "the files' names, or export both again",
            file=file,
        )
    header = f"the take is {stated!r} by its header"
    print(f"ingest: {file.name}: {header}; the file's name is used")
    return False


def _tracks(
    take: MotionTake,
    mocap: Mocap,
    file: Path,
) -> tuple[dict[tuple[int, int], np.ndarray], list[np.ndarray]]:
    """Return (link, marker) → positions (N, 3) m in the world frame, and other markers'."""
    unknown = sorted({*mocap.bodies} - {*mocap.markers})
    if unknown:
        message = f"no link {', '.join(unknown)}; there are {', '.join(mocap.markers)}"
        raise ConfigError(message, key="dataset.mocap.bodies")
    wanted = []
    for link, places in mocap.markers.items():
        if link not in mocap.bodies:
            wanted += places
    bodies = [body.name for body in mocap.bodies.values()]
    where = {"file": file, "key": "dataset.mocap.markers"}
    markers = _full_names("marker", wanted, take.markers, **where)
    where["key"] = "dataset.mocap.bodies"
    rigid_bodies = _full_names("rigid body", bodies, take.bodies, **where)

    tracks = {}
    for number, (link, places) in enumerate(mocap.markers.items(), 1):
        body = mocap.bodies.get(link)
        if body:
            pose = take.bodies[rigid_bodies[body.name]]
            positions = _carry(pose, body.mount, np.array([*places.values()]))
        else:
            positions = [take.markers[markers[name]] for name in places]
        for i, track in enumerate(positions, 1):
            tracks[number, i] = track
    stray = []
    if not mocap.bodies:
        used = {*markers.values()}
        stray = [track for name, track in take.markers.items() if name not in used]
    return tracks, stray


def _full_names(
    kind: str,
    names: Iterable[str],
    recorded: Iterable[str],
    **where: object,
) -> dict[str, str]:
    """Return name → name in the take of each marker or body, which may have its asset's name and a
    colon before it; RecordingError for a missing or ambiguous one.
    """
    full_names = {}
    missing = []
    ambiguous = []
    for name in names:
        fits = [full for full in recorded if name in (full, full.rpartition(":")[2])]
        if name in fits:
            fits = [name]
        if len(fits) > 1:
            may_be = f"{name!r} may be {' or '.join(fits)}"
            ambiguous.append(f"{may_be}: write the full name")
        elif fits:
            full_names[name] = fits[0]
        else:
            missing.append(name)
    if missing:
        present = ", ".join(sorted(recorded)) or "none"
        message = f"no {kind} named {', '.join(missing)} in the take; it has {present}"
        raise RecordingError(message, **where)
    if ambiguous:
        raise RecordingError("; ".join(ambiguous), **where)
    return full_names


def _require_size(
    tracks: Mapping[tuple, np.ndarray],
    mocap: Mocap,
    unit: str,
    file: Path,
) -> None:
    """Raise RecordingError where the root mean square distance of a link's markers from their
    centre is ANOTHER_UNIT times the template's or more, or as small, in the median over the rows;
    ``tracks`` (N, 3) in m. Labels that are exchanged leave it as it is.
    """
    for number, (link, places) in enumerate(mocap.markers.items(), 1):
        if link in mocap.bodies or len(places) < 2:
            continue
        markers = range(1, len(places) + 1)
        positions = np.stack([tracks[number, marker] for marker in markers])
        sizes = np.sort(np.linalg.norm(positions.std(axis=0), axis=1))
        middle = sizes[np.isfinite(sizes).sum() // 2]  # NaN if no row has all
        planned = np.std([*places.values()], axis=0)
        size = middle / np.linalg.norm(planned)
        if size >= ANOTHER_UNIT or size <= 1 / ANOTHER_UNIT:
            raise RecordingError(
                f"the markers of {link} are {size:.3g} times as far apart as in the template: "
                f"are lengths in {unit}, the template's in m? Export in the right unit",
                file=file,
                key=f"dataset.mocap.markers.{link}",
            )


def _carry(pose: RigidBody, mounted: Pose, places: np.ndarray) -> np.ndarray:
    """Return the positions (P, N, 3) m of ``places`` (P, 3) m on a link by a body's ``pose``."""
    position, quaternion = pose
    tracked = np.isfinite(np.hstack(pose)).all(axis=1)
    mount = Rotation.from_euler("xyz", mounted.rpy).as_matrix()
    on_body = (places - np.array(mounted.position)) @ mount
    carried = np.full((len(places), len(tracked), 3), np.nan)
    if tracked.any():
        turn = Rotation.from_quat(quaternion[tracked]).as_matrix()
        turned = np.einsum("nab,mb->mna", turn, on_body)
        carried[:, tracked] = position[tracked] + turned
    return carried
