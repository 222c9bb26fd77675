"""Damaged files of all formats, in every kind of damage: none crashes or holds up its reader, or
takes more than 1 GiB.
"""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from mutants import BYTES, TEXT, mutants
from scipy.io import savemat
from zoo import SHAPE, write_zoo

from pipeline.arm.model import chain_of
from pipeline.core import datasheet
from pipeline.core.bounds import Reading, Sandbox, within
from pipeline.core.errors import PipelineError
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
from pipeline.formats.rosbag import messages
from pipeline.formats.trajectory import read_trajectory

COUNT = 2 * len(BYTES | TEXT)  # mutants of a sample
BOUNDS = Reading(seconds=10, memory_mib=1024)
# words of the sandbox for an end that no reader's own check has prevented
FAILURES = ("its reader fails", "ends the process", "not read within", "of memory")
PLAIN = """image_width: 32\nimage_height: 24\ncamera_matrix:\n  rows: 3\n  cols: 3
  data: [30.0, 0.0, 16.0, 0.0, 30.0, 12.0, 0.0, 0.0, 1.0]\ndistortion_model: plumb_bob
distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, 0.0, 0.0, 0.0, 0.0]\n"""
SHEET = """about:\n  subject: an arm\n  source: our laboratory\n  licence: MIT
recordings: data/raw/lab\nmotion: {rate: 100.0, steps: 250}\n"""


class Sample(NamedTuple):
    """Place of a file in the zoo, its reader, and whether it is text."""

    place: str
    read: Callable[[Path], object]
    text: bool = True


def _images(file: Path, bag: str = ".") -> None:
    pixels = partial(image_pixels, shape=SHAPE)
    assert len([*messages((file.parent / bag) if bag else file, "/depth", pixels)]) == 3


def _chain(file: Path) -> None:
    chain_of(Robot(str(file), ["j1", "j2", "j3"], "tip", plane=True, task=["x", "z"]))


def _sheet(file: Path) -> None:
    validated(Motion, datasheet.read(file).values.get("motion"), "motion")


camera = partial(read_intrinsics, width=SHAPE[1], height=SHAPE[0])
depth, arrays = partial(read_depth, shape=SHAPE), partial(read_arrays, options=LogOptions())
joints = partial(read_joint_table, options=LogOptions(joints=6, signals={"actual": None}))
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
    "table of joints": Sample("q.csv", joints),
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


@pytest.fixture(scope="module")
def samples(tmp_path_factory) -> Path:
    """The zoo, and what it lacks of the formats."""
    folder, rng = tmp_path_factory.mktemp("samples"), np.random.default_rng(4)
    write_zoo(folder)
    pixels = rng.integers(900, 1101, SHAPE).astype(">u2").tobytes()
    (folder / "single.pgm").write_bytes(b"P5 %d %d 65535\n" % SHAPE[::-1] + pixels)
    (folder / "plain.yaml").write_text(PLAIN)
    (folder / "sheet.yaml").write_text(SHEET)
    data = rng.normal(size=(3, 40)).astype("<f4").tobytes()
    packed = b"".join(b"\x1f" + data[start : start + 32] for start in range(0, len(data), 32))
    (folder / "packed.pcd").write_bytes(
        b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 40\nHEIGHT 1\n"
        b"POINTS 40\nDATA binary_compressed\n" + struct.pack("<II", len(packed), len(data)) + packed
    )
    log = {"t": np.arange(50) / 125, "q": rng.normal(size=(50, 6)), "q_target": np.ones((50, 6))}
    np.savez(folder / "q.npz", **log)
    savemat(folder / "q.mat", log)
    columns = {f"{name}_{j}": log[name][:, j] for name in ("q", "q_target") for j in range(6)}
    pd.DataFrame({"t": log["t"]} | columns).to_parquet(folder / "q.parquet")
    return folder


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    """One process for all mutants, until one of them ends it."""
    with Sandbox() as started:
        yield started


def failures(sandbox: Sandbox, sample: Sample, folder: Path, scratch: Path) -> list[str]:
    """The kinds of damage, and the ends, of mutants in ``scratch`` that no reader's check stops; of
    a library in a process of the reader's own the refusal names the file, and is none.
    """
    sound, copy, found = folder / sample.place, scratch / sample.place, []
    if sound.parent == folder:
        scratch.mkdir(exist_ok=True)
    else:
        shutil.copytree(sound.parent, copy.parent)
    for kind, mutant in mutants(sound.read_bytes(), COUNT, text=sample.text):
        copy.write_bytes(mutant)
        try:
            within(BOUNDS, sandbox.call, _read, sample.read, copy)
        except PipelineError as error:
            failed = any(words in error.message for words in FAILURES)
            found += [f"{kind}: {error.message}"] * (failed and "file" not in error.evidence)
    return found


def _read(read: Callable[[Path], object], file: Path) -> None:
    read(file)


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLES)
def test_no_damage_ends_or_holds_up_a_reader(samples, sandbox, tmp_path, name):
    SAMPLES[name].read(samples / SAMPLES[name].place)
    assert failures(sandbox, SAMPLES[name], samples, tmp_path / "mutants") == []


def test_mutants_are_the_same_each_time_and_most_are_another_file(samples):
    content = (samples / "points.csv").read_bytes()
    once, again = (list(mutants(content, 45, text=True)) for _ in range(2))
    assert once == again
    assert sum(mutant != content for _, mutant in once) > 35


def test_a_reader_that_takes_what_it_is_given_is_found_out(samples, sandbox, tmp_path):
    """The control: float and split take every word for a number that they can."""
    found = failures(sandbox, Sample("q.csv", _credulous), samples, tmp_path)
    assert any(failure.startswith("number seven: its reader fails on it (V") for failure in found)


def _credulous(file: Path) -> None:
    cells = file.read_text().replace(",", " ").split()
    assert sum(map(float, cells)) is not None
