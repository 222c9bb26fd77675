"""Depth cameras' ROS messages as images, point clouds and intrinsics (sensor_msgs; REP 118 for
depth images, REP 103 for units).
"""

from __future__ import annotations

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.intrinsics import Intrinsics, pinhole, require_model, require_size

IMAGE, CLOUD, CAMERA_INFO = (
    f"sensor_msgs/msg/{name}" for name in ("Image", "PointCloud2", "CameraInfo")
)
PIXELS = dict.fromkeys(("16UC1", "mono16"), np.dtype(np.uint16))
PIXELS["32FC1"] = np.dtype(np.float32)
DATATYPES = {7: np.dtype(np.float32), 8: np.dtype(np.float64)}  # of a PointField


def image_pixels(message: object, *, shape: tuple[int, int], **evidence: object) -> np.ndarray:
    """Return (H, W) uint16 (16UC1) or float32 (32FC1) of an Image of ``shape`` = (H, W), of either
    byte order, its rows padded or not.

    Raises RecordingError (with ``evidence``) for another encoding or size, and for data that are
    shorter or longer than rows × step.
    """
    if message.encoding not in PIXELS:
        said = f"an image of the encoding {message.encoding!r}; depth is {', '.join(PIXELS)}"
        raise RecordingError(said, **evidence)
    if (message.height, message.width) != tuple(shape):
        raise RecordingError(
            f"the image has {message.width} × {message.height} pixels where the camera has "
            f"{shape[1]} × {shape[0]}",
            **evidence,
        )
    pixel = PIXELS[message.encoding]
    cells = _cells(message, message.step, pixel.itemsize, "pixels", evidence)
    return cells.view(pixel.newbyteorder(_order(message)))[..., 0].astype(pixel)


def _order(message: object) -> str:
    return ">" if message.is_bigendian else "<"


def _cells(message: object, row: int, size: int, what: str, evidence: dict) -> np.ndarray:
    """Return (height, width, ``size``) bytes of the pixels or points of a message whose rows have
    ``row`` bytes.
    """
    height, width = message.height, message.width
    data = np.asarray(message.data, np.uint8)
    if row < width * size or len(data) != height * row:
        said = f"{len(data)} bytes in {height} rows of {row} for {width} {what} of {size} bytes"
        raise RecordingError(said, **evidence)
    rows = np.ascontiguousarray(data.reshape(height, row)[:, : width * size])
    return rows.reshape(height, width, size)


def cloud_points(message: object, **evidence: object) -> np.ndarray:
    """Return (N, 3) float64 points x, y, z of a PointCloud2, in m in its own frame, NaN where
    the sensor saw nothing.

    The fields may be float32 or float64 at any offset, of either byte order, organised or not, rows
    padded or not. Raises RecordingError (with ``evidence``) for a field that is missing or of
    another type, and for data that do not hold the points announced.
    """
    fields = {field.name: field for field in message.fields}
    if missing := [name for name in "xyz" if name not in fields]:
        raise RecordingError(
            f"the cloud has no field {', '.join(missing)}; there are {', '.join(fields) or 'none'}",
            **evidence,
        )
    step = message.point_step
    rows = _cells(message, message.row_step, step, "points", evidence).reshape(-1, step)
    points = np.empty((len(rows), 3))
    for column, name in enumerate("xyz"):
        field = fields[name]
        kind = DATATYPES.get(field.datatype)
        if kind is None or field.count != 1 or field.offset + kind.itemsize > step:
            raise RecordingError(
                f"the field {name} is no single float32 or float64 within the point's {step} bytes",
                **evidence,
            )
        cells = np.ascontiguousarray(rows[:, field.offset : field.offset + kind.itemsize])
        points[:, column] = cells.view(kind.newbyteorder(_order(message)))[:, 0]
    return points


def camera_info(message: object, *, width: int, height: int, **evidence: object) -> Intrinsics:
    """Return the intrinsics from the K and D of a CameraInfo of ``width`` × ``height`` pixels.

    Raises RecordingError (with ``evidence``) for another size, a camera that was never calibrated
    (K of zeros) or whose distortion is not OpenCV's.
    """
    require_size((message.width, message.height), width, height, **evidence)
    # ROS 1 writes K and D, ROS 2 k and d
    matrix, distortion = (
        np.array(getattr(message, name, getattr(message, name.lower(), None)), dtype=float)
        for name in "KD"
    )
    require_model(message.distortion_model or "of no name", distortion, **evidence)
    distortion = distortion if distortion.any() else np.zeros(0)
    return pinhole(matrix.reshape(3, 3), distortion, width=width, height=height, **evidence)
