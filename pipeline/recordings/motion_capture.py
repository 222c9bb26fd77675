"""Motive's takes and the commanded trajectory as tables: SI units, the arm's base frame, the motion's grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline import schema
from pipeline.errors import RecordingError
from pipeline.instruments.motive import read_motive
from pipeline.instruments.trajectory import read_trajectory
from pipeline.recordings.quality import quality_row


def trajectory_rows(file: Path, motion: schema.Motion) -> pd.DataFrame:
    """The table ``trajectory`` from its file; RecordingError where it is not on the grid of ``motion``."""
    table = read_trajectory(file)
    if len(table) != motion.steps + 1 or not np.isclose(table.t.iloc[1] - table.t.iloc[0], 1 / motion.rate, rtol=1e-6):
        raise RecordingError(
            f"the trajectory has {len(table)} rows; dataset.motion asks for {motion.steps + 1} at {motion.rate} per second", file=file
        )
    return table.assign(k=np.arange(len(table)))


def find_takes(raw: Path, mocap: schema.Mocap) -> list[tuple[Path, str]]:
    """File and part of every take below ``raw``; RecordingError where a pattern matches none."""
    found = []
    for part, pattern in (("training", mocap.training), ("test", mocap.test)):
        files = sorted(raw.glob(pattern)) if pattern else []
        if pattern and not files:
            raise RecordingError(f"no {part} take matches {pattern!r}", file=raw)
        found += [(file, part) for file in files]
    return found


def marker_rows(file: Path, part: str, dataset: schema.Dataset) -> tuple[pd.DataFrame, list[dict]]:
    """The markers of one take in the arm's base frame: those of the template by link, all others as unlabelled; and its quality.

    Raises RecordingError for a take of another rate or length, with a gap, or without a marker of the template.
    """
    take, frames = read_motive(file), dataset.motion.steps + 1
    if not np.isclose(take.rate, dataset.motion.rate):
        raise RecordingError(f"the take is exported at {take.rate} Hz; dataset.motion asks for {dataset.motion.rate}", file=file)
    if len(take.frame) != frames or np.any(np.diff(take.frame) != 1):
        raise RecordingError(f"the take has {len(take.frame)} frames; the motion has {frames} without a gap: export it whole", file=file)
    rotation = Rotation.from_euler("xyz", dataset.mocap.base.rpy).as_matrix()
    template = {name: (j, i) for j, link in enumerate(dataset.mocap.markers.values(), 1) for i, name in enumerate(link, 1)}
    # Motive prefixes the marker's name by that of its asset
    columns = {name.rsplit(":", 1)[-1]: positions for name, positions in take.markers.items()}
    if absent := sorted(set(template) - set(columns)):
        raise RecordingError(f"no marker named {', '.join(absent)} in the take; it has {', '.join(sorted(columns))}", file=file)
    stray = [name for name in columns if name not in template]
    places = template | {name: (0, i) for i, name in enumerate(stray, 1)}
    k = np.arange(frames)
    rows = []
    for name, (link, marker) in places.items():
        xyz = (columns[name] - np.array(dataset.mocap.base.position)) @ rotation
        identity = {"take": file.stem, "part": part, "k": k, "t": k / dataset.motion.rate, "link": link, "marker": marker}
        rows.append(pd.DataFrame(identity | dict(zip("xyz", xyz.T, strict=True))))
    missing = sum(int(np.isnan(columns[name][:, 0]).sum()) for name in template)
    counts = take.counts | {"missing_samples": missing, "unlabelled_markers": len(stray)}
    return pd.concat(rows, ignore_index=True), [quality_row(file.stem, part, "motion capture", key, value) for key, value in counts.items()]
