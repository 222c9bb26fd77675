"""Findings of depth images, point clouds and their sequences."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.depth import cloud, image
from pipeline.formats.depth.image import dropped_frames, median_step, named_frames
from pipeline.formats.format import Format, Kind
from pipeline.tools.inspect.finding import Finding

SIZE = ("width", "height")


def add_image(finding: Finding, form: Format) -> None:
    """Add size, range and share of missing values of a depth image."""
    pixels = form.read(finding.file).pixels
    height, width = pixels.shape
    measured = pixels[pixels > 0]
    # values above 0 may also be missing depths, depending on the encoding
    share = round(1 - measured.size / pixels.size, 4)
    finding.facts = {"width": width, "height": height, "share_not_above_zero": share}
    finding.version = f"{8 * pixels.itemsize} bits"
    span = ""
    if measured.size:
        span = f", {float(measured.min()):g} to {float(measured.max()):g}"
    finding.ask("image_unit", span=span)
    finding.ask("image_encoding")


def add_cloud(finding: Finding, form: Format) -> None:
    from scipy.spatial.transform import Rotation

    read = form.read(finding.file)
    share = round(read.missing / max(len(read.points) + read.missing, 1), 4)
    finding.facts = {"points": len(read.points), "organised": read.organised}
    finding.facts["share_without_position"] = share
    finding.version = read.format
    finding.count(read.counts)
    if read.viewpoint != cloud.UNTURNED:
        *place, w, x, y, z = read.viewpoint
        turn = np.degrees(Rotation.from_quat([x, y, z, w]).as_rotvec())
        angle = float(np.linalg.norm(turn))
        at = _coordinates(place)
        axis = _coordinates(turn / (angle or 1.0))
        turned = f"at {at}, turned by {angle:.4g}° about {axis}"
        finding.facts["viewpoint"] = (
            f"{turned}, not applied: points are in the sensor's frame"
        )
    finding.ask("cloud_unit")


def _coordinates(vector: Iterable[float]) -> str:
    """Return the coordinates of a ``vector``, without negative zeros."""
    return " ".join(f"{value + 0.0:.3g}" for value in vector)


def add_index(finding: Finding, form: Format) -> None:
    index = form.read(finding.file)
    finding.count(index.counts)
    dropped = dropped_frames(index.time)
    finding.count({"dropped_frames": dropped})
    if len(index.time) > 1:
        finding.timed(index.time, dropped)
    _add_frames(finding, index.files)


def describe_numbered(pattern: Path) -> Finding:
    """Return the finding of the numbered frames that match ``pattern``."""
    frames = named_frames(pattern.parent, pattern.name)
    finding = Finding(pattern, "depth sequence, numbered", Kind.SEQUENCE)
    time = (np.array(frames.values) - frames.values[0]) * (1e-9 if frames.timed else 1)
    dropped = dropped_frames(time)
    finding.count({"dropped_frames": dropped})
    if frames.timed:
        finding.facts["times"] = "in the names"
        finding.timed(time, dropped)
    else:
        step = median_step(time)
        note = ""
        if step != 1:
            note = f"; the numbers step by {step:g}: state how many a second has"
        finding.ask("frame_rate", step=note)
    _add_frames(finding, [file.name for file in frames.files])
    return finding


def _add_frames(finding: Finding, names: Sequence[str]) -> None:
    """Add the frames ``names``, and the finding of the first frame that exists."""
    finding.files = [finding.file.parent / name for name in names]
    finding.facts["frames"] = len(names)
    exists = [frame.is_file() for frame in finding.files]
    if not all(exists):
        count = (
            f"{exists.count(False)} of {len(names)} frames of the index do not exist"
        )
        finding.stops.append(f"{count}: {names[exists.index(False)]} …")
    if not any(exists):
        return
    first = Finding(frame := finding.files[exists.index(True)])
    form, add = (
        (cloud.FORMAT, add_cloud) if cloud.is_cloud(frame) else (image.IMAGE, add_image)
    )
    first.format, first.kind = form.name, form.kind
    try:
        add(first, form)
    except RecordingError as error:
        finding.stops.append(f"{frame.name}: {error.message}")
        return
    finding.version = ", ".join(filter(None, [first.format, first.version]))
    finding.facts |= {name: first.facts[name] for name in first.facts if name in SIZE}
    finding.facts["frames_are"] = str(first.kind)
    finding.open += first.open
