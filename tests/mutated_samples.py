"""A small sound file of every format, and what is read of it, as plain values by name."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.io import savemat
from zoo import SHAPE, write_zoo

from pipeline.arm.model import chain_of
from pipeline.core import datasheet
from pipeline.core.options.dataset import Motion, Robot
from pipeline.core.validation import validated
from pipeline.formats.depth.cloud import read_cloud
from pipeline.formats.depth.image import read_depth
from pipeline.formats.depth.index import read_index
from pipeline.formats.depth.intrinsics import read_intrinsics
from pipeline.formats.depth.messages import image_pixels
from pipeline.formats.force.calibration import read_calibration
from pipeline.formats.force.daqft import read_daqft, read_netft
from pipeline.formats.joints.arrays import read_arrays
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.table import read_joint_table
from pipeline.formats.motion.c3d import read_c3d
from pipeline.formats.motion.motive import read_motive
from pipeline.formats.rosbag import messages, seconds
from pipeline.formats.trajectory import read_trajectory

STATED = ("file", "name", "units", "marks", "format", "organised")  # words that no analysis reads
TABLE = LogOptions(joints=6, signals={"actual": None})


def _pixels(message: object) -> tuple[float, np.ndarray]:
    return seconds(message), image_pixels(message, shape=SHAPE)


def _images(file: Path, bag: str = ".") -> dict[str, np.ndarray]:
    held = [*messages((file.parent / bag) if bag else file, "/depth", _pixels)]
    times, pixels = zip(*held, strict=True)
    return {"time": np.array(times), "pixels": np.array(pixels)}


def _chain(file: Path) -> object:
    return chain_of(Robot(str(file), ["j1", "j2", "j3"], "tip", plane=True, task=["x", "z"]))


def _sheet(file: Path) -> dict:
    sheet = datasheet.read(file)
    return {"motion": validated(Motion, sheet.values.get("motion"), "motion")}


@dataclass(frozen=True)
class Sample:
    """Where a file lies in the zoo, what reads it, and whether it is text."""

    place: str
    read: Callable[[Path], object]
    text: bool = True


camera = partial(read_intrinsics, width=SHAPE[1], height=SHAPE[0])
depth, arrays = partial(read_depth, shape=SHAPE), partial(read_arrays, options=LogOptions())
SAMPLES = {
    "Motive, columns": Sample("columns.csv", partial(read_motive, unit="m")),
    "Motive, rows": Sample("rows.csv", partial(read_motive, unit="m")),
    "C3D": Sample("take.c3d", partial(read_c3d, unit="mm"), text=False),
    "DAQ F/T": Sample("points.csv", read_daqft),
    "DAQ F/T, decimal commas": Sample("commas.csv", read_daqft),
    "Net F/T": Sample("netft.csv", read_netft),
    "ATI calibration": Sample("FT7.cal", read_calibration),
    "depth, PNG": Sample("single.png", depth, text=False),
    "depth, TIFF": Sample("metres.tiff", depth, text=False),
    "depth, PGM": Sample("single.pgm", depth, text=False),
    "intrinsics, OpenCV": Sample("camera.yaml", camera),
    "intrinsics, JSON": Sample("sized.json", camera),
    "intrinsics, YAML": Sample("plain.yaml", camera),
    "cloud, PLY": Sample("cloud.ply", read_cloud),
    "cloud, PCD": Sample("cloud.pcd", read_cloud),
    "cloud, compressed PCD": Sample("packed.pcd", read_cloud, text=False),
    "index of frames": Sample("indexed/depth.txt", read_index),
    "table of joints": Sample("q.csv", partial(read_joint_table, options=TABLE)),
    "MATLAB": Sample("q.mat", arrays, text=False),
    "Parquet": Sample("q.parquet", arrays, text=False),
    "NumPy archive": Sample("q.npz", arrays, text=False),
    "trajectory": Sample("path.csv", read_trajectory),
    "ROS 1 bag": Sample("ros1/take.bag", partial(_images, bag=""), text=False),
    "ROS 2 bag, MCAP": Sample("mcap/take/take.mcap", _images, text=False),
    "ROS 2 bag, SQLite": Sample("sqlite3/take/take.db3", _images, text=False),
    "ROS 2 bag, metadata": Sample("sqlite3/take/metadata.yaml", _images),
    "URDF": Sample("three.urdf", _chain),
    "datasheet": Sample("sheet.yaml", _sheet),
}


def write_samples(folder: Path) -> None:
    """The zoo, and what it lacks of the formats."""
    write_zoo(folder)
    rng = np.random.default_rng(4)
    rows, columns = SHAPE
    pixels = rng.integers(900, 1101, SHAPE).astype(">u2").tobytes()
    (folder / "single.pgm").write_bytes(b"P5 %d %d 65535\n" % (columns, rows) + pixels)
    (folder / "plain.yaml").write_text(
        "image_width: 32\nimage_height: 24\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        "  data: [30.0, 0.0, 16.0, 0.0, 30.0, 12.0, 0.0, 0.0, 1.0]\n"
        "distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n"
        "  data: [0.1, 0.0, 0.0, 0.0, 0.0]\n"
    )
    (folder / "sheet.yaml").write_text(
        "about:\n  subject: an arm\n  source: our laboratory\n  licence: MIT\n"
        "recordings: data/raw/lab\nmotion: {rate: 100.0, steps: 250}\n"
    )
    data = rng.normal(size=(3, 40)).astype("<f4").tobytes()
    runs = [data[start : start + 32] for start in range(0, len(data), 32)]
    packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
    (folder / "packed.pcd").write_bytes(
        b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 40\nHEIGHT 1\n"
        b"POINTS 40\nDATA binary_compressed\n" + struct.pack("<II", len(packed), len(data)) + packed
    )
    time = np.arange(50) / 125
    log = {"t": time, "q": rng.normal(size=(50, 6)), "q_target": np.ones((50, 6))}
    np.savez(folder / "q.npz", **log)
    savemat(folder / "q.mat", log)
    content = (folder / "q.mat").read_bytes()
    # what stands for the time of day
    (folder / "q.mat").write_bytes(b"MATLAB 5.0 MAT-file".ljust(116) + content[116:])
    columns = {f"{name}_{j}": log[name][:, j] for name in ("q", "q_target") for j in range(6)}
    pd.DataFrame({"t": time} | columns).to_parquet(folder / "q.parquet")


def values(record: object) -> dict[str, np.ndarray | str]:
    """What ``record`` holds, by the names of its fields and what is in them."""
    return dict(_flat(record, ""))


def _flat(value: object, name: str) -> Iterator[tuple[str, np.ndarray | str]]:
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, tuple) and all(isinstance(part, float) for part in value):
        value = np.array(value)
    if isinstance(value, pd.DataFrame):
        value = {column: value[column].to_numpy() for column in value}
    if isinstance(value, Mapping):
        for key, part in value.items():
            if key not in STATED:
                yield from _flat(part, f"{name}/{key}" if name else str(key))
    elif isinstance(value, np.ndarray | float | int):
        yield name, np.asarray(value)
    else:
        yield name, repr(value)
