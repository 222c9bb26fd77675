"""Depth images, calibrations and point clouds for tests."""

import io
import struct
from pathlib import Path

import cv2
import numpy as np
from numpy.random import default_rng
from PIL import Image

from pipeline.core.typed_yaml import read_yaml


def frame(shape: tuple[int, int]) -> np.ndarray:
    """A noisy slope in mm, a fifth of whose pixels have no depth."""
    generator = default_rng(1)
    rows, columns = np.indices(shape)
    slope = 1800 + 0.5 * columns + 0.3 * rows

    raw = slope + generator.normal(size=shape) * 5
    without_depth = generator.random(shape) < 0.2
    raw[without_depth] = 0
    return raw.astype(np.uint16)


def tiff(pixels: np.ndarray, description: str = "", **options: object) -> bytes:
    content = io.BytesIO()
    Image.fromarray(pixels).save(content, "TIFF", description=description, **options)
    return content.getvalue()


def encoded(ending: str, image: np.ndarray) -> bytes:
    return cv2.imencode(ending, image)[1].tobytes()


SMALL = frame((12, 16))
PGM = b"P5\n# a comment\n16 12\n65535\n" + SMALL.astype(">u2").tobytes()


def opencv(key: str, rows: int, columns: int, data: str) -> str:
    size = f"   rows: {rows}\n   cols: {columns}\n   dt: d\n"
    return f"{key}: !!opencv-matrix\n{size}   data: [ {data} ]\n"


CALIBRATIONS = read_yaml(Path(__file__).with_name("depth_calibrations.yaml"))

# points of the same records in every form of PCD and PLY
FIELDS = "FIELDS rgb z _ x label y _\nSIZE 4 8 1 8 2 8 1\nTYPE U F U F I F U\nCOUNT 1 1 3 1 1 1 5\n"
POINT = np.dtype(
    [
        ("rgb", "<u4"),
        ("z", "<f8"),
        ("pad", "u1", 3),
        ("x", "<f8"),
        ("label", "<i2"),
        ("y", "<f8"),
        ("tail", "u1", 5),
    ],
)


def records() -> np.ndarray:
    generator = default_rng(3)
    table = np.zeros(12, POINT)
    for axis in "xyz":
        table[axis] = generator.normal(size=12)
    table["rgb"] = 0x00FF7F00
    table["pad"] = 9
    table["label"] = -4
    table["z"][2] = np.nan
    table["y"][5] = np.inf
    return table


def positions(table: np.ndarray) -> np.ndarray:
    points = np.stack([table[axis] for axis in "xyz"], axis=-1)
    return points[np.isfinite(points).all(axis=1)]


def pcd(form: str, table: np.ndarray) -> bytes:
    header = (
        f"# .PCD v0.7\nVERSION 0.7\n{FIELDS}WIDTH 4\nHEIGHT {len(table) // 4}\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(table)}\nDATA {form}\n"
    ).encode()

    if form == "binary":
        return header + table.tobytes()
    if form == "binary_compressed":  # LZF of literal runs
        columns = [np.ascontiguousarray(table[name]) for name in POINT.names]
        data = b"".join(column.tobytes() for column in columns)
        runs = [data[i : i + 32] for i in range(0, len(data), 32)]
        packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
        return header + struct.pack("<II", len(packed), len(data)) + packed

    rows = [
        f"1 {p['z']} 9 9 9 {p['x']} {p['label']} {p['y']} 0 0 0 0 0\n" for p in table
    ]
    return header + "".join(rows).encode()


def ply(form: str, table: np.ndarray) -> bytes:
    header = (
        f"ply\nformat {form} 1.0\ncomment made for a test\nelement vertex {len(table)}\n"
        "property double z\nproperty uchar red\nproperty double x\nproperty float64 y\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        rows = "".join(f"{p['z']} 255 {p['x']} {p['y']}\n" for p in table)
        return header + rows.encode() + b"3 0 1 2\n"

    order = ">" if form == "binary_big_endian" else "<"
    real = order + "f8"
    vertex = np.dtype([("z", real), ("red", "u1"), ("x", real), ("y", real)])
    vertices = np.zeros(len(table), vertex)
    for axis in "xyz":
        vertices[axis] = table[axis]
    return header + vertices.tobytes() + struct.pack(order + "Biii", 3, 0, 1, 2)


PCDS = {
    f"{form}.pcd": pcd(form, records())
    for form in ("ascii", "binary", "binary_compressed")
}
CLOUDS = PCDS | {
    f"{form}.ply": ply(form, records())
    for form in ("ascii", "binary_little_endian", "binary_big_endian")
}
CLOUDS["crlf.ply"] = ply("ascii", records()).replace(b"\n", b"\r\n")
