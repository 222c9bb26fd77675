"""What a frame of a depth camera, and the camera's calibration, say of themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.bounds import read_whole
from pipeline.core.errors import PipelineError
from pipeline.formats.depth.cloud import FORMAT as CLOUD
from pipeline.formats.depth.cloud import UNTURNED, PointCloud, is_cloud
from pipeline.formats.depth.image import FORMAT as IMAGE
from pipeline.formats.depth.image import RawDepth, depth_size, read_depth
from pipeline.formats.format import Format
from pipeline.tools.inspect.finding import Finding

ANY_SIZE = 10**6  # px, holds every principal point
UNIT, ENCODING = "dataset.depth.units_per_metre", "dataset.depth.encoding"


def frame(file: Path) -> Finding:
    """A frame of a sequence, image or cloud; RecordingError where it is neither."""
    return cloud(CLOUD, file) if is_cloud(file) else image(IMAGE, file)


def image(form: Format, file: Path) -> Finding:
    """A depth image."""
    finding = Finding.read_by(form, file)
    height, width = depth_size(read_whole(file), file=file)
    finding.facts = {"width": width, "height": height}
    raw = read_depth(file, shape=(height, width))
    finding.version = f"{8 * raw.pixels.itemsize} bits"
    return _valued(finding, raw)


def cloud(form: Format, file: Path) -> Finding:
    """A point cloud."""
    finding, points = Finding.read_by(form, file), form.read(read_whole(file), file=file)
    stated = form.states(file)
    finding.version, finding.facts = stated.version, dict(stated.facts)
    finding.facts |= {"points": len(points.points), "without_position": points.missing}
    total = len(points.points) + points.missing
    finding.facts["share_without_position"] = round(points.missing / max(total, 1), 4)
    finding.facts |= points.counts
    if points.viewpoint != UNTURNED:
        finding.facts["viewpoint"] = _viewpoint(points)
    if len(points.points):
        extent = [float(edge(np.abs(points.points).max(axis=1))) for edge in (np.min, np.max)]
        finding.facts["greatest_coordinate_of_points"] = [round(value, 4) for value in extent]
    finding.open.append(
        ("the unit of the coordinates is not stated (1 for metres, 1000 for millimetres)", UNIT)
    )
    return finding


def _viewpoint(cloud: PointCloud) -> str:
    """Describe the VIEWPOINT of a cloud and the frame of its points."""
    from scipy.spatial.transform import Rotation

    *position, w, x, y, z = cloud.viewpoint
    rotation = Rotation.from_quat([x, y, z, w])
    angle, turn = np.degrees(rotation.magnitude()), rotation.as_rotvec()
    parts = []
    if any(position):
        parts.append(f"at {' '.join(f'{value:g}' for value in position)}")
    if angle > 1e-9:
        axis = " ".join(f"{value + 0.0:.3g}" for value in turn / np.linalg.norm(turn))
        parts.append(f"turned by {angle:.4g}° about {axis}")
    return f"{' and '.join(parts) or 'of no turn'}, not applied: points are in the sensor's frame"


def intrinsics(form: Format, file: Path) -> Finding:
    """The calibration of a camera."""
    finding, size = Finding.read_by(form, file), form.states(file).facts
    finding.facts = dict(size)
    try:
        camera = form.read(file, **(size or {"width": ANY_SIZE, "height": ANY_SIZE}))
    except PipelineError as error:
        return finding.refused(error)
    finding.facts |= {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
    finding.facts["distortion"] = list(camera.distortion)
    if not size:
        finding.open.append(
            (
                "the size of the images that it holds for is not stated",
                "dataset.depth.width, .height",
            )
        )
    return finding


def _valued(finding: Finding, raw: RawDepth) -> Finding:
    """With the range of the values, from which somebody who knows the scene can tell their unit."""
    measured = raw.pixels[raw.pixels > 0]
    # which values stand for no depth, the encoding says
    finding.facts["share_not_above_zero"] = round(1 - measured.size / raw.pixels.size, 4)
    if raw.description:
        finding.facts["description"] = raw.description[:200]
    span = ""
    if measured.size:
        low, high = float(np.min(measured)), float(np.max(measured))
        finding.facts["values"] = [low, high]
        span = f", {low:g} to {high:g}"
    finding.open.append(
        (
            f"the unit of the values{span}, is not stated (1000 for millimetres, 5000 for TUM "
            "RGB-D, 1 for metres)",
            UNIT,
        )
    )
    finding.open.append(
        (
            "nor whether the values are depth itself (plain), rotated_bits (SUN RGB-D) or "
            "disparity (NYU Depth v2)",
            ENCODING,
        )
    )
    return finding
