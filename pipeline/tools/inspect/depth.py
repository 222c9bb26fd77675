"""What a frame of a depth camera, and the camera's calibration, say of themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline import formats
from pipeline.core.bounds import read_whole
from pipeline.core.errors import PipelineError
from pipeline.formats.depth.image import RawDepth, depth_size, no_image, read_depth
from pipeline.formats.format import Format, Head, Kind, formats_in, recognised
from pipeline.tools.inspect.finding import Finding

ANY_SIZE = 10**6  # px, holds every principal point
UNIT, ENCODING = "dataset.depth.units_per_metre", "dataset.depth.encoding"


def frame(file: Path) -> Finding:
    """A frame of a sequence, image or cloud; RecordingError where it is neither."""
    form = recognised(Head.read(file), formats_in(formats.depth, Kind.IMAGE, Kind.CLOUD))
    if form is None:
        raise no_image(file)
    return (cloud if form.kind is Kind.CLOUD else image)(form, file)


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
    if len(points.points):
        extent = [float(edge(np.abs(points.points).max(axis=1))) for edge in (np.min, np.max)]
        finding.facts["greatest_coordinate_of_points"] = [round(value, 4) for value in extent]
    finding.open.append(
        ("the unit of the coordinates is not stated (1 for metres, 1000 for millimetres)", UNIT)
    )
    return finding


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
