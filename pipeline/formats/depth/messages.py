"""Depth cameras' ROS messages as images, point clouds and intrinsics (sensor_msgs; REP 118 for
depth images, REP 103 for units).
"""

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.intrinsics import Intrinsics, pinhole

IMAGE, CLOUD, CAMERA_INFO = (
    f"sensor_msgs/msg/{name}" for name in ("Image", "PointCloud2", "CameraInfo")
)
PIXELS = dict.fromkeys(("16UC1", "mono16"), np.dtype(np.uint16))
PIXELS["32FC1"] = np.dtype(np.float32)
DATATYPES = {7: np.dtype(np.float32), 8: np.dtype(np.float64)}  # of a PointField


def image_pixels(message: object, *, shape: tuple[int, int], **evidence: object) -> np.ndarray:
    """Return (H, W) uint16 (16UC1) or float32 (32FC1) of an Image of ``shape`` = (H, W), of either
    byte order, its rows padded or not; RecordingError (with ``evidence``) for another encoding or
    size, and for other data than rows × step.
    """
    pixel, size = PIXELS.get(message.encoding), (message.height, message.width)
    if pixel is None or size != tuple(shape):
        found = f"an image of {size[1]} × {size[0]} pixels encoded as {message.encoding!r}; depth "
        wanted = f"of the camera has {shape[1]} × {shape[0]} of {', '.join(PIXELS)}"
        raise RecordingError(found + wanted, **evidence)
    return _records(message, message.step, pixel, "pixels", evidence).astype(pixel)


def _records(message: object, row: int, kind: np.dtype, what: str, evidence: dict) -> np.ndarray:
    """Return (height, width) of ``kind`` in a message whose rows have ``row`` bytes."""
    height, width, size = message.height, message.width, kind.itemsize
    data = np.asarray(message.data, np.uint8)
    if row < width * size or len(data) != height * row:
        said = f"{len(data)} bytes in {height} rows of {row} for {width} {what} of {size} bytes"
        raise RecordingError(said, **evidence)
    rows = np.ascontiguousarray(data.reshape(height, row)[:, : width * size])
    return rows.view(kind.newbyteorder(">" if message.is_bigendian else "<"))


def cloud_points(message: object, **evidence: object) -> np.ndarray:
    """Return (N, 3) float64 points of a PointCloud2 in m in its own frame, NaN where the sensor saw
    nothing: float32 or float64 at any offset, of either byte order, rows padded or not.
    RecordingError (with ``evidence``) for another field, and for other data than announced.
    """
    fields, step = {field.name: field for field in message.fields}, message.point_step
    held = [fields[name] for name in "xyz" if name in fields]
    formats = [DATATYPES.get(field.datatype) for field in held if field.count == 1]
    ends = [f.offset + kind.itemsize for f, kind in zip(held, formats, strict=False) if kind]
    if len(ends) < 3 or max(ends) > step:
        said = f"x, y and z must be single float32 or float64 within the {step} bytes of a point; "
        raise RecordingError(f"{said}there are {', '.join(fields) or 'none'}", **evidence)
    layout = {"names": [*"xyz"], "formats": formats, "offsets": [field.offset for field in held]}
    kind = np.dtype(layout | {"itemsize": step})
    points = _records(message, message.row_step, kind, "points", evidence).ravel()
    return np.column_stack([points[name].astype(float) for name in "xyz"])


def camera_info(message: object, *, width: int, height: int, **evidence: object) -> Intrinsics:
    """Return the intrinsics from the K and D of a CameraInfo of ``width`` × ``height`` pixels;
    RecordingError (with ``evidence``) for another size, K of zeros and another distortion model.
    """
    # ROS 1 writes K and D, ROS 2 k and d
    matrix, distortion = (
        np.array(getattr(message, name, getattr(message, name.lower(), None)), dtype=float)
        for name in "KD"
    )
    own = {
        "stated": (message.width, message.height),
        "model": message.distortion_model or "of no name",
    }
    distortion = distortion if distortion.any() else np.zeros(0)
    return pinhole(matrix.reshape(3, 3), distortion, (width, height), **own, **evidence)
