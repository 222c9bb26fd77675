"""The raw files of a dataset, and which instrument's part of the analysis reads each."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path, PurePosixPath

import pandas as pd

from pipeline.core.bounds import MIB
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.formats.format import matching

PARTS = ("motion", "depth", "force")


def listing(folder: Path) -> pd.DataFrame:
    """Every file below ``folder``: path from there, bytes, SHA-256; RecordingError where there is
    none.
    """
    files = []
    for place, _, names in os.walk(folder):
        above = Path(place).relative_to(folder).parts
        files += [(*above, name) for name in names if Path(place, name).is_file()]
    if not files:
        raise RecordingError(
            "there are no recordings in this folder, or it does not exist; see the dataset's "
            "datasheet for how to get them",
            file=folder,
        )
    rows, part = [], memoryview(bytearray(MIB))
    for parts in sorted(files):  # as paths are sorted: folder by folder
        name, digest, size = "/".join(parts), hashlib.sha256(), 0
        with open(os.path.join(folder, name), "rb", buffering=0) as data:
            while read := data.readinto(part):
                digest.update(part[:read])
                size += read
        rows.append((name, size, digest.hexdigest()))
    return pd.DataFrame(rows, columns=["file", "bytes", "sha256"])


def by_part(files: pd.DataFrame, dataset: Dataset) -> dict[str, pd.DataFrame]:
    """The rows of a :func:`listing` that each of :data:`PARTS` may read.

    A file that the patterns of one part match belongs to it; one that none matches might be read
    with any of them, so that it belongs to all.
    """
    raw, names = Path(dataset.recordings), files["file"].tolist()
    folders = [name.rpartition("/")[0] for name in names]
    above = {folder: _with_parents(folder) for folder in {*folders}}
    reads = {}
    for part, patterns in _patterns(dataset).items():
        places = _claimed(raw, patterns)
        inside = {folder for folder in above if not places.isdisjoint(above[folder])}
        reads[part] = [
            name in places or folder in inside for name, folder in zip(names, folders, strict=True)
        ]
    unclaimed = ~pd.DataFrame(reads).any(axis=1).to_numpy()
    return {part: files[mine | unclaimed] for part, mine in pd.DataFrame(reads).items()}


def _with_parents(folder: str) -> list[str]:
    """``folder`` and what it lies in, as :func:`_claimed` writes them."""
    place = PurePosixPath(folder)
    return [str(place), *map(str, place.parents)]


def _patterns(dataset: Dataset) -> dict[str, list[tuple[str, str]]]:
    """Key and glob of what each part names."""
    mocap, log, depth, force = dataset.mocap, dataset.joint_log, dataset.depth, dataset.force
    named = {part: [] for part in PARTS}
    if dataset.trajectory is not None:
        named["motion"].append(("trajectory", dataset.trajectory))
    if mocap is not None:
        named["motion"] += [("mocap.training", mocap.training), ("mocap.test", mocap.test)]
    if log is not None:
        named["motion"].append(("joint_log.movements", log.movements))
    if dataset.encoders is not None:
        named["motion"] += [
            (f"encoders.{part}", getattr(dataset.encoders, part)) for part in ("training", "test")
        ]
    if depth is not None:
        named["depth"] += [("depth.takes", depth.takes), ("depth.intrinsics", depth.intrinsics)]
    if force is not None:
        files = [("force.configurations", c.file) for c in force.configurations.values()]
        named["force"] += [*files, ("force.log.calibration", force.log.calibration)]
    return {part: [pair for pair in pairs if pair[1]] for part, pairs in named.items()}


def _claimed(raw: Path, patterns: list[tuple[str, str]]) -> set[str]:
    """Paths below ``raw`` that the ``patterns`` match, relative to it."""
    return {
        place.relative_to(raw).as_posix()
        for key, pattern in patterns
        for place in matching(raw, pattern, key=f"dataset.{key}")
    }
