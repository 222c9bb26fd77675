"""What one take of a depth camera says of itself: its frames, with an index or numbered."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.bounds import read_whole
from pipeline.core.errors import RecordingError
from pipeline.formats.depth.image import depth_size
from pipeline.formats.depth.index import dropped_frames, numbered_frames
from pipeline.formats.format import Format, Kind
from pipeline.tools.inspect import depth
from pipeline.tools.inspect.finding import Finding

NUMBERED = "depth sequence, numbered"


def indexed(form: Format, file: Path) -> Finding:
    """The take that an index lists; its frames stand in ``files``."""
    finding, index = Finding.read_by(form, file), form.read(file)
    frames = [file.parent / name for name in index.files]
    finding.gaps = {name: count for name, count in index.counts.items() if count}
    if outside := [
        frame for frame in frames if file.parent.resolve() not in frame.resolve().parents
    ]:
        finding.stops.append(f"the index names {outside[0].name}, which is outside its folder")
        return finding
    if missing := [
        name for name, frame in zip(index.files, frames, strict=True) if not frame.is_file()
    ]:
        finding.stops.append(
            f"{len(missing)} of {len(frames)} frames of the index are not there: {missing[0]} …"
        )
        finding.gaps["missing_frames"] = len(missing)
    steps = np.diff(index.time)
    if len(steps):
        finding.duration = float(index.time[-1] - index.time[0])
        dropped = dropped_frames(index.time)
        finding.rate = round((len(steps) + dropped) / finding.duration, 3)
        if dropped:
            finding.gaps["dropped_frames"] = dropped
    return _framed(finding, frames)


def numbered(folder: Path, pattern: str) -> Finding:
    """The take of numbered frames in ``folder`` whose names match ``pattern``; its frames stand in
    ``files``.
    """
    index = numbered_frames(folder, pattern, rate=1.0)
    finding = Finding(folder / pattern, NUMBERED, Kind.SEQUENCE)
    if absent := int(index.time[-1]) + 1 - len(index.files):
        finding.gaps["dropped_frames"] = absent
    finding.open.append(
        ("numbered frames have no times: their rate is not stated", "dataset.depth.rate")
    )
    return _framed(finding, [folder / name for name in index.files])


def _framed(finding: Finding, frames: list[Path]) -> Finding:
    """With what the first frame says, and which of the others is no frame of the same kind."""
    finding.files = frames
    finding.facts["frames"] = len(frames)
    there = [frame for frame in frames if frame.is_file()]
    if not there:
        return finding
    try:
        first = depth.frame(there[0])
    except RecordingError as error:
        finding.stops.append(f"{there[0].name}: {error.message}")
        return finding
    finding.version = ", ".join(filter(None, [first.format, first.version]))
    finding.facts["frames_are"] = str(first.kind)
    finding.facts |= {
        name if name in ("width", "height") else f"first_{name}": value
        for name, value in first.facts.items()
    }
    finding.open += first.open
    damaged = []
    for frame in [] if first.kind is Kind.CLOUD else there[1:]:
        try:
            height, width = depth_size(read_whole(frame), file=frame)
            if (height, width) != (first.facts["height"], first.facts["width"]):
                damaged.append(
                    f"{frame.name}: {width} × {height} pixels where the first frame has others"
                )
        except RecordingError as error:
            damaged.append(f"{frame.name}: {error.message}")
    if damaged:
        finding.stops.append(
            f"{len(damaged)} frames: {damaged[0]}" if len(damaged) > 1 else damaged[0]
        )
    return finding
