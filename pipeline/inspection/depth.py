"""What the frames of a depth camera, their index, its calibration and ROS bags say of themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.errors import PipelineError, RecordingError
from pipeline.inspection.finding import Finding
from pipeline.instruments.depth import RawDepth, depth_size, read_depth
from pipeline.instruments.depth_index import DepthIndex, numbered_frames, read_index
from pipeline.instruments.depth_intrinsics import read_intrinsics, stated_size
from pipeline.instruments.depth_messages import CAMERA_INFO, CLOUD, IMAGE
from pipeline.instruments.force_bag import WRENCH
from pipeline.instruments.point_cloud import is_cloud, read_cloud
from pipeline.instruments.rosbag import summary

MAX_PIXELS = 1 << 25  # of one frame; depth cameras have a tenth of it
ANY_SIZE = 10**6  # px, holds every principal point
UNIT, ENCODING = "dataset.depth.units_per_metre", "dataset.depth.encoding"
LONG_STEP = 1.5  # of the median step: a frame was dropped


def image(file: Path) -> Finding:
    """A depth image."""
    size = depth_size(file.read_bytes(), file=file)
    finding = Finding(file, "depth image", facts={"width": size[1], "height": size[0]})
    if size[0] * size[1] > MAX_PIXELS:
        finding.stops.append(f"{size[1]} × {size[0]} pixels are more than any depth camera has")
        return finding
    raw = read_depth(file, shape=size)
    finding.version = f"{8 * raw.pixels.itemsize} bits"
    return _valued(finding, raw)


def cloud(file: Path) -> Finding:
    """A point cloud."""
    found = read_cloud(file)
    with file.open("rb") as stream:
        head = stream.read(4096).decode("latin-1")
    ply = head.startswith("ply")
    versions = [line.split()[1:] for line in head.splitlines() if line.split()[:1] == (["format"] if ply else ["VERSION"])]
    finding = Finding(file, "point cloud, PLY" if ply else "point cloud, PCD", version=" ".join(versions[0]) if versions else None)
    finding.facts |= {"points": len(found.points), "without_position": found.missing}
    if len(found.points):
        extent = [float(edge(np.abs(found.points).max(axis=1))) for edge in (np.min, np.max)]
        finding.facts["greatest_coordinate_of_points"] = [round(value, 4) for value in extent]
    finding.open.append(("the unit of the coordinates is not stated (1 for metres, 1000 for millimetres)", UNIT))
    return finding


def sequence(file: Path) -> tuple[Finding, list[Path]]:
    """The take that an index lists, and its frames."""
    index = read_index(file)
    frames = [file.parent / name for name in index.files]
    finding = Finding(file, "depth sequence with index")
    finding.gaps = {name: count for name, count in index.counts.items() if count}
    if outside := [frame for frame in frames if file.parent.resolve() not in frame.resolve().parents]:
        finding.stops.append(f"the index names {outside[0].name}, which is outside its folder")
        return finding, []
    if missing := [name for name, frame in zip(index.files, frames, strict=True) if not frame.is_file()]:
        finding.stops.append(f"{len(missing)} of {len(frames)} frames of the index are not there: {missing[0]} …")
        finding.gaps["missing_frames"] = len(missing)
    steps = np.diff(index.time)
    if len(steps):
        step = float(np.median(steps))
        finding.duration = float(index.time[-1] - index.time[0])
        dropped = int(np.sum(np.rint(steps[steps > LONG_STEP * step] / step) - 1))
        finding.rate = round((len(steps) + dropped) / finding.duration, 3)
        if dropped:
            finding.gaps["dropped_frames"] = dropped
    return _framed(finding, index, frames), frames


def numbered(folder: Path, pattern: str) -> tuple[Finding, list[Path]]:
    """The take of numbered frames in ``folder`` whose names match ``pattern``, and its frames."""
    index = numbered_frames(folder, pattern, rate=1.0)
    frames = [folder / name for name in index.files]
    finding = Finding(folder / pattern, "depth sequence, numbered")
    if absent := int(index.time[-1]) + 1 - len(frames):
        finding.gaps["dropped_frames"] = absent
    finding.open.append(("numbered frames have no times: their rate is not stated", "dataset.depth.rate"))
    return _framed(finding, index, frames), frames


def intrinsics(file: Path) -> Finding:
    """The calibration of a camera."""
    size = stated_size(file)
    width, height = size or (ANY_SIZE, ANY_SIZE)
    finding = Finding(file, "camera intrinsics", facts={"width": width, "height": height} if size else {})
    try:
        camera = read_intrinsics(file, width=width, height=height)
    except PipelineError as error:
        return finding.refused(error)
    finding.facts |= {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy, "distortion": list(camera.distortion)}
    if not size:
        finding.open.append(("the size of the images that it holds for is not stated", "dataset.depth.width, .height"))
    return finding


def bag(file: Path) -> Finding:
    """A ROS bag: its topics, by its index."""
    found = summary(file)
    finding = Finding(file, "ROS bag", version=f"ROS {found.version}", duration=found.duration)
    finding.facts["topics"] = {topic: {"type": kind, "messages": count} for topic, (kind, count) in sorted(found.topics.items())}
    for option, kinds in (
        ("dataset.depth.topic", (IMAGE, CLOUD)),
        ("dataset.depth.camera_info", (CAMERA_INFO,)),
        ("dataset.force.log.topic", WRENCH),
    ):
        several = sorted(topic for topic, (kind, count) in found.topics.items() if kind in kinds and count)
        if len(several) > 1:
            finding.open.append((f"several topics could be meant: {', '.join(several)}", option))
    held = {kind for kind, count in found.topics.values() if count}
    if IMAGE in held:
        finding.open.append(("the unit of images of 16 bits is not stated (ROS drivers: 1000; images of 32 bits: 1)", UNIT))
    if not held & {IMAGE, CLOUD, *WRENCH}:
        finding.stops.append("no topic of Image, PointCloud2 or WrenchStamped with a message: nothing that is analysed")
    return finding


def _framed(finding: Finding, index: DepthIndex, frames: list[Path]) -> Finding:
    """With what the first frame says, and which of the others is no frame of the same kind."""
    finding.facts["frames"] = len(frames)
    there = [frame for frame in frames if frame.is_file()]
    if not there:
        return finding
    try:
        first = cloud(there[0]) if is_cloud(there[0]) else image(there[0])
    except RecordingError as error:
        finding.stops.append(f"{there[0].name}: {error.message}")
        return finding
    finding.version = ", ".join(filter(None, [first.format, first.version]))
    finding.facts |= {f"first_{name}" if name not in ("width", "height") else name: value for name, value in first.facts.items()}
    finding.open += first.open
    damaged = []
    for frame in [] if is_cloud(there[0]) else there[1:]:
        try:
            size = depth_size(frame.read_bytes(), file=frame)
            if size != (first.facts["height"], first.facts["width"]):
                damaged.append(f"{frame.name}: {size[1]} × {size[0]} pixels where the first frame has others")
        except RecordingError as error:
            damaged.append(f"{frame.name}: {error.message}")
    if damaged:
        finding.stops.append(f"{len(damaged)} frames: {damaged[0]}" if len(damaged) > 1 else damaged[0])
    return finding


def _valued(finding: Finding, raw: RawDepth) -> Finding:
    """With the range of the values, from which somebody who knows the scene can tell their unit."""
    measured = raw.pixels[raw.pixels > 0]
    finding.facts["without_depth"] = round(1 - measured.size / raw.pixels.size, 4)
    if raw.description:
        finding.facts["description"] = raw.description[:200]
    seen = ""
    if measured.size:
        low, high = float(np.min(measured)), float(np.max(measured))
        finding.facts["values"] = [low, high]
        seen = f", {low:g} to {high:g}"
    finding.open.append((f"the unit of the values{seen}, is not stated (1000 for millimetres, 5000 for TUM RGB-D, 1 for metres)", UNIT))
    finding.open.append(("nor whether the values are depth itself (plain), rotated_bits (SUN RGB-D) or disparity (NYU Depth v2)", ENCODING))
    return finding
