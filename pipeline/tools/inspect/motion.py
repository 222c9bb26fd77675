"""What a motion-capture take or a commanded trajectory says of itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.errors import PipelineError
from pipeline.formats.format import Format
from pipeline.formats.motion.take import RATE_TOLERANCE, STRAY, MotionTake
from pipeline.tools.inspect.finding import Finding, counted

UNIT = "dataset.mocap.unit"
LOST = (
    "gaps",
    "skipped_frames",
    "cut_rows",
    "repeated_rows",
    "blank_rows",
    "time_mismatches",
    "missing_samples",
    "missing_poses",
    "zero_samples",
    "partial_samples",
)
ODD = (
    "stray_ids",
    "stray_samples",
    "lacking_body_rows",
    "solved_replaced",
    "solved_only",
    "skipped_bones",
    "skipped_model_outputs",
    "skipped_labels",
    "skipped_analog_channels",
    "skipped_force_plates",
    "unused_columns",
)


def take(form: Format, file: Path) -> Finding:
    """A take of motion capture."""
    finding, unit = Finding.read_by(form, file), None
    stated = form.states(file)
    finding.version, finding.facts = stated.version, stated.facts
    try:
        recorded = form.read(file, None)
    except PipelineError as error:
        finding.refused(error)
        if error.evidence.get("key") != UNIT:
            return finding
        # every length is left out of what is said: the unit is the file's reader's to know, not
        # ours to guess; in the smallest nothing is too far away
        recorded, unit = form.read(file, "mm"), "not stated"
    return _filled(finding, recorded, unit or recorded.unit)


def trajectory(form: Format, file: Path) -> Finding:
    """The commanded end-effector."""
    finding = Finding.read_by(form, file)
    table = form.read(file)
    finding.rate = round(float((len(table) - 1) / (table.t.iloc[-1] - table.t.iloc[0])), 6)
    finding.duration = float(table.t.iloc[-1] - table.t.iloc[0])
    finding.facts["steps"] = len(table) - 1
    return finding


def _filled(finding: Finding, take: MotionTake, unit: str) -> Finding:
    finding.version = take.version if take.version != finding.format else None
    finding.rate, finding.units = take.rate, {"length": unit}
    if take.printed_rate and abs(take.printed_rate / take.rate - 1) > RATE_TOLERANCE:
        finding.facts["rate_by_the_printed_times"] = f"{take.printed_rate:.4g} Hz"
    finding.duration = float(take.frame[-1] - take.frame[0]) / take.rate
    finding.bodies = list(take.bodies)
    finding.markers = [name for name in take.markers if not STRAY.fullmatch(name)]
    if unlabelled := len(take.markers) - len(finding.markers):
        finding.facts["unlabelled_markers"] = unlabelled
    if not (finding.markers or finding.bodies):
        finding.open.append(
            (
                "no marker has a name of its own, and there is no rigid body: label them",
                "dataset.mocap.markers",
            )
        )
    finding.gaps = counted(take.counts, *LOST)
    finding.facts |= {
        "frames": len(take.frame),
        "first_frame": int(take.frame[0]),
        "steps": int(take.frame[-1] - take.frame[0]),
    }
    announced = take.counts.get("announced_frames", len(take.frame))
    if announced != len(take.frame):
        finding.facts["announced_frames"] = announced
    never = [name for name in finding.markers if np.isnan(take.markers[name]).all()]
    if never:
        finding.facts["markers_never_seen"] = never
    finding.facts |= counted(take.counts, *ODD)
    return finding
