"""The raw files of a dataset, and which instrument's part of the analysis reads each."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pandas as pd

from pipeline.core.bounds import MIB
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.formats.patterns import matching

PARTS = ("motion", "depth", "force")


def listing(folder: Path) -> pd.DataFrame:
    """Every file below ``folder``: path from there, bytes, SHA-256; RecordingError where there is
    none.
    """
    files = sorted(path for path in Path(folder).rglob("*") if path.is_file())
    if not files:
        raise RecordingError(
            "there are no recordings in this folder, or it does not exist; see the dataset's "
            "datasheet for how to get them",
            file=folder,
        )
    rows = []
    for path in files:
        digest, size = hashlib.sha256(), 0
        with path.open("rb", buffering=0) as data:
            while part := data.read(MIB):
                digest.update(part)
                size += len(part)
        name = path.relative_to(folder).as_posix()
        rows.append({"file": name, "bytes": size, "sha256": digest.hexdigest()})
    return pd.DataFrame(rows)


def by_part(files: pd.DataFrame, dataset: Dataset) -> dict[str, pd.DataFrame]:
    """The rows of a :func:`listing` that each of :data:`PARTS` may read.

    A file that the patterns of one part match belongs to it; one that none matches might be read
    with any of them, so that it belongs to all.
    """
    raw = Path(dataset.recordings)
    claims = {part: _claimed(raw, patterns) for part, patterns in _patterns(dataset).items()}
    paths = [raw / name for name in files["file"]]
    folders = {path.parent for path in paths}
    reads = {}
    for part, places in claims.items():
        inside = {place for place in folders if not places.isdisjoint([place, *place.parents])}
        reads[part] = [path in places or path.parent in inside for path in paths]
    unclaimed = ~pd.DataFrame(reads).any(axis=1).to_numpy()
    return {part: files[mine | unclaimed] for part, mine in pd.DataFrame(reads).items()}


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


def _claimed(raw: Path, patterns: list[tuple[str, str]]) -> set[Path]:
    return {
        place for key, pattern in patterns for place in matching(raw, pattern, key=f"dataset.{key}")
    }
