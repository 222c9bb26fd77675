"""What a motion-capture take or a commanded trajectory says of itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.errors import PipelineError
from pipeline.inspection.finding import Finding, counted
from pipeline.instruments.c3d import read_c3d
from pipeline.instruments.delimited import cells_of, read_text
from pipeline.instruments.motion_take import MotionTake
from pipeline.instruments.motive import read_motive
from pipeline.instruments.motive_rows import STRAY
from pipeline.instruments.trajectory import read_trajectory

UNIT = "dataset.mocap.unit"
LOST = (
    "gaps", "skipped_frames", "cut_rows", "repeated_rows", "blank_rows", "time_mismatches", "missing_samples", "missing_poses",
    "zero_samples", "partial_samples",
)  # fmt: skip
ODD = (
    "stray_ids", "stray_samples", "lacking_body_rows", "solved_replaced", "solved_only", "skipped_bones", "skipped_analog_channels",
    "skipped_force_plates", "unused_columns",
)  # fmt: skip


def motive(file: Path) -> Finding:
    """A take of Motive's CSV in either grammar."""
    stated = _header(file)
    rows = "Format Version" not in stated
    finding = Finding(file, "Motive CSV, row-typed" if rows else "Motive CSV, columnar", version=stated.get("Format Version"))
    finding.facts |= {key: stated[key] for key in ("Capture Frame Rate", "Export Frame Rate", "Length Units") if stated.get(key)}
    finding = _take(finding, read_motive, file)
    if finding.rate and not (stated.get("Capture Frame Rate") or stated.get("Export Frame Rate")):
        finding.facts["rate_from"] = "the printed times: the file states none"
    return finding


def c3d(file: Path) -> Finding:
    """A take in C3D."""
    return _take(Finding(file, "C3D"), read_c3d, file)


def trajectory(file: Path) -> Finding:
    """The commanded end-effector."""
    finding = Finding(file, "commanded trajectory")
    table = read_trajectory(file)
    finding.rate = round(float((len(table) - 1) / (table.t.iloc[-1] - table.t.iloc[0])), 6)
    finding.duration = float(table.t.iloc[-1] - table.t.iloc[0])
    finding.facts["steps"] = len(table) - 1
    return finding


def _take(finding: Finding, read, file: Path) -> Finding:
    unit = None
    try:
        take = read(file)
    except PipelineError as error:
        finding.refused(error)
        if error.evidence.get("key") != UNIT:
            return finding
        # every length is left out of what is said: the unit is the file's reader's to know, not ours to guess
        take = read(file, "m")
        unit = "not stated"
    return _filled(finding, take, unit or take.unit)


def _filled(finding: Finding, take: MotionTake, unit: str) -> Finding:
    finding.version = take.version if take.version != finding.format else None
    finding.rate, finding.units = take.rate, {"length": unit}
    finding.duration = float(take.frame[-1] - take.frame[0]) / take.rate
    finding.bodies = list(take.bodies)
    finding.markers = [name for name in take.markers if not STRAY.fullmatch(name)]
    if unlabelled := len(take.markers) - len(finding.markers):
        finding.facts["unlabelled_markers"] = unlabelled
    if not (finding.markers or finding.bodies):
        finding.open.append(("no marker has a name of its own, and there is no rigid body: label them", "dataset.mocap.markers"))
    finding.gaps = counted(take.counts, *LOST)
    finding.facts |= {"frames": len(take.frame), "first_frame": int(take.frame[0]), "steps": int(take.frame[-1] - take.frame[0])}
    announced = take.counts.get("announced_frames", len(take.frame))
    if announced != len(take.frame):
        finding.facts["announced_frames"] = announced
    never = [name for name in finding.markers if np.isnan(take.markers[name]).all()]
    if never:
        finding.facts["markers_never_seen"] = never
    finding.facts |= counted(take.counts, *ODD)
    return finding


def _header(file: Path) -> dict[str, str]:
    """Keys and values of the first row of a columnar take."""
    text = read_text(file)
    cells = cells_of(text.lines[0], ",", file=file, number=1) if text.lines else []
    return dict(zip(cells[::2], cells[1::2], strict=False)) if cells[:1] == ["Format Version"] else {}
