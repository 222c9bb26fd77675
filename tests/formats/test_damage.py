"""Damaged files of all formats: cut at any byte they are refused or hold only rows that were whole;
rows that are dropped, doubled or swapped are counted or refused; no damage ends or holds up a
reader, or takes more than 1 GiB.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from depth_files import CALIBRATIONS, CLOUDS, PGM, SMALL, encoded, tiff
from hypothesis import given, settings
from hypothesis import strategies as st
from motive_files import START, frame_row, random_take, rows_file
from numpy.random import default_rng
from numpy.testing import assert_array_equal
from sample_recordings import SHAPE, write_zoo
from scipy.io import savemat
from text_mutations import mutants
from written_logs import CALIBRATION, write_joint_log, write_netft

from pipeline.arm.model import chain_of
from pipeline.configuration import datasheet
from pipeline.core.bounds import Reading, Sandbox, within
from pipeline.core.errors import PipelineError, RecordingError
from pipeline.core.options.dataset import Motion, Robot
from pipeline.core.validation import validated
from pipeline.formats.depth import intrinsics
from pipeline.formats.depth.cloud import read_cloud
from pipeline.formats.depth.image import read_depth, read_index, write_index
from pipeline.formats.depth.intrinsics import (
    Intrinsics,
    read_intrinsics,
    write_intrinsics,
)
from pipeline.formats.force.calibration import read_calibration
from pipeline.formats.force.daqft import read_daqft, read_netft, write_daqft
from pipeline.formats.force.record import ForceRecord
from pipeline.formats.joints.arrays import read_arrays
from pipeline.formats.joints.log import JointLog, LogOptions
from pipeline.formats.joints.table import read_joint_table
from pipeline.formats.motion.c3d import read_c3d
from pipeline.formats.motion.motive import read_motive, write_motive
from pipeline.formats.motion.take import MotionTake
from pipeline.formats.rosbag import image_pixels, messages
from pipeline.formats.trajectory import read_trajectory, write_trajectory

SAMPLES = default_rng(5).normal(size=(5, 6)).round(4)
RECORD = ForceRecord(
    np.arange(5) / 500,
    SAMPLES[:, :3],
    SAMPLES[:, 3:],
    500.0,
    "",
    "4/2/13",
    {},
)
JOINTS = JointLog(np.arange(5) / 125, {"actual": SAMPLES}, {})
POSES = pd.DataFrame(
    np.c_[np.arange(5) / 100, SAMPLES],
    columns=["t", *(f"{family}:{row}" for family in "xv" for row in ("x", "z", "phi"))],
)
CAMERA = Intrinsics(365.456, 365.123, 254.878, 205.395, 640, 480, (0.125,) * 5)
ARE_WHOLE = None  # instead of a number of lines: nothing of the file is read unless all is there


class Sound(NamedTuple):
    """Function that writes a sound file, its reader, the rows of what is read as an array, and the
    number of lines above the first row.
    """

    write: Callable[[Path], object]
    read: Callable[[Path], object]
    rows: Callable[..., np.ndarray] = np.asarray
    above: int | None = ARE_WHOLE


def write_take(file: Path) -> None:
    original = random_take(5, 2, 7)
    original.markers["Link1:Marker2"][3] = np.nan
    write_motive(file, original, start=START)


def write_typed_rows(file: Path) -> None:
    rows = [frame_row(k, f"1,{k},0.5,1,{k + 7},a", tracked=False) for k in range(5)]
    rows_file(file.parent, *rows).replace(file)


def samples(take: MotionTake) -> np.ndarray:
    poses = [
        np.hstack([body.position, body.quaternion]) for body in take.bodies.values()
    ]
    return np.hstack([*take.markers.values(), *poses])


def wrenches(record: ForceRecord) -> np.ndarray:
    return np.hstack([record.force, record.torque])


def pinhole(camera: Intrinsics) -> np.ndarray:
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


def content(written: bytes) -> Callable[[Path], object]:
    return partial(Path.write_bytes, data=written)


camera = partial(read_intrinsics, width=640, height=480)
image = partial(read_depth, shape=SMALL.shape)
joints = partial(
    read_joint_table,
    options=LogOptions(joints=6, signals={"actual": None}),
)
SOUND = {
    "Motive": Sound(write_take, read_motive, samples, 7),
    "Motive, typed rows": Sound(
        write_typed_rows, partial(read_motive, unit="m"), lambda take: take.markers["a"], 2),
    "index": Sound(
        lambda file: write_index(file, np.arange(3) / 30, ("a.png", "b.png", "c.png")),
        read_index, lambda index: np.array(index.files), 2),
    "trajectory": Sound(partial(write_trajectory, trajectory=POSES), read_trajectory, above=1),
    "joint table": Sound(
        partial(write_joint_log, log=JOINTS), joints, lambda log: log.signals["actual"], 0),
    "calibration": Sound(partial(write_intrinsics, intrinsics=CAMERA), camera, pinhole),
    "ATI calibration": Sound(
        content(CALIBRATION.encode()), read_calibration, attrgetter("matrix")),
}  # fmt: skip
for mark in ".,":
    write = partial(write_daqft, record=RECORD, decimal=mark)
    SOUND[f"DAQ F/T {mark}"] = Sound(write, read_daqft, wrenches, 1)
for counts in (None, 1000):
    write = partial(write_netft, record=RECORD, counts_per_unit=counts)
    SOUND[f"Net F/T, counts {counts}"] = Sound(write, read_netft, wrenches, 7)
IMAGES = {"PNG": encoded(".png", SMALL), "PGM": PGM, "TIFF": tiff(SMALL)}
IMAGES["TIFF, LZW"] = tiff(SMALL, compression="tiff_lzw")
for name, encoded_image in IMAGES.items():
    SOUND[name] = Sound(content(encoded_image), image, attrgetter("pixels"))
for name, text in CALIBRATIONS.items():
    SOUND[name] = Sound(content(text.encode()), camera, pinhole)
for name, cloud in CLOUDS.items():
    SOUND[name] = Sound(content(cloud), read_cloud, attrgetter("points"))


@pytest.mark.parametrize("name", SOUND)
def test_a_file_cut_at_any_byte_is_refused_or_holds_only_rows_that_were_whole(
    tmp_path,
    monkeypatch,
    name,
):
    # without a process for each cut
    monkeypatch.setattr(intrinsics, "read_alone", lambda read, *args, **_: read(*args))
    sound = SOUND[name]
    file = tmp_path / "cut"
    refused = 0
    sound.write(file)
    whole = sound.rows(sound.read(file))
    content = file.read_bytes()
    # all cuts in the last rows, where numbers can lose digits
    last = len(content) - 40
    for cut in [*range(0, last, 31), *range(last, len(content))]:
        file.write_bytes(content[:cut])
        try:
            result = sound.rows(sound.read(file))
        except RecordingError as error:
            assert error.evidence["file"] == file
            refused += 1
            continue
        lines = content[:cut].replace(b"\r\n", b"\n").replace(b"\r", b"\n").count(b"\n")
        expected = len(whole) if sound.above is ARE_WHOLE else lines - sound.above
        assert len(result) == expected > 0
        # the last number of a text cloud without its line end may lack digits
        sure = len(result) - (name in ("ascii.pcd", "ascii.ply", "crlf.ply"))
        assert_array_equal(result[:sure], whole[:sure])

    assert refused > 1


OF_FIVE_ROWS = [
    "Motive",
    "Motive, typed rows",
    "DAQ F/T .",
    "DAQ F/T ,",
    "Net F/T, counts None",
]
OF_FIVE_ROWS += ["joint table"]


@pytest.mark.parametrize("name", OF_FIVE_ROWS)
@settings(derandomize=True, max_examples=50, deadline=None)
@given(picks=st.lists(st.integers(0, 4), min_size=3, max_size=9))
def test_dropped_doubled_and_swapped_rows_are_counted_or_refused(
    tmp_path_factory,
    name,
    picks,
):
    sound = SOUND[name]
    file = tmp_path_factory.getbasetemp() / "rows.csv"
    sound.write(file)
    whole = sound.rows(sound.read(file))
    lines = file.read_bytes().splitlines(keepends=True)
    picked = [lines[sound.above + k] for k in picks]
    file.write_bytes(b"".join([*lines[: sound.above], *picked]))
    distinct = sorted({*picks})
    has_time = not name.startswith("DAQ")
    single = name == "Motive, typed rows" and len(distinct) < 2
    if has_time and (picks != sorted(picks) or single):
        with pytest.raises(RecordingError, match=r"goes back|not increase"):
            sound.read(file)
        return
    result = sound.read(file)
    # without a time, doubled rows can only be counted
    rows = distinct if has_time else picks
    counted = "doubled_rows" if has_time and "Motive" not in name else "repeated_rows"
    assert_array_equal(sound.rows(result), whole[rows])

    doubled = sum(before == after for before, after in pairwise(picks))
    assert result.counts.get(counted, 0) == doubled


def images(file: Path, bag: str = ".") -> None:
    pixels = partial(image_pixels, shape=SHAPE)
    assert len([*messages((file.parent / bag) if bag else file, "/depth", pixels)]) == 3


def chain(file: Path) -> None:
    chain_of(Robot(str(file), ["j1", "j2", "j3"], "tip", plane=True, task=["x", "z"]))


def motion(file: Path) -> None:
    validated(Motion, datasheet.read(file).values.get("motion"), "motion")


def of_zoo(place: str) -> Callable[[Path], Path]:
    """Function that writes the zoo beside a file and returns one of its files."""

    def write(file: Path) -> Path:
        write_zoo(file.parent)
        return file.parent / place

    return write


SHEET = b"""about:\n  subject: an arm\n  source: our laboratory\n  licence: MIT
recordings: data/raw/lab\nmotion: {rate: 100.0, steps: 250}\n"""
LOG = {"t": np.arange(50) / 125, "q": default_rng(4).normal(size=(50, 6))}
COLUMNS = pd.DataFrame({"t": LOG["t"]} | {f"q_{j}": LOG["q"][:, j] for j in range(6)})
arrays = partial(read_arrays, options=LogOptions(signals={"actual": ["q"]}))
MUTATED = SOUND | {
    "C3D": Sound(of_zoo("take.c3d"), partial(read_c3d, unit="mm")),
    "ROS 1 bag": Sound(of_zoo("ros1/take.bag"), partial(images, bag="")),
    "ROS 2 bag, MCAP": Sound(of_zoo("mcap/take/take.mcap"), images),
    "ROS 2 bag, SQLite": Sound(of_zoo("sqlite3/take/take.db3"), images),
    "ROS 2 bag, metadata": Sound(of_zoo("sqlite3/take/metadata.yaml"), images),
    "URDF": Sound(of_zoo("three.urdf"), chain),
    "datasheet.yaml": Sound(content(SHEET), motion),
    "q.npz": Sound(lambda file: np.savez(file, **LOG), arrays),
    "q.mat": Sound(lambda file: savemat(file, LOG), arrays),
    "q.parquet": Sound(COLUMNS.to_parquet, arrays),
}
COUNT = 32  # mutants of a file
BOUNDS = Reading(seconds=10, memory_mib=1024)
# words of the sandbox for an end that no reader's own check has prevented
FAILURES = ("its reader fails", "ends the process", "not read within", "of memory")


@pytest.fixture(scope="module")
def sandbox():
    """One process for all mutants, until one of them ends it."""
    with Sandbox() as started:
        yield started


def _credulous(file: Path) -> None:
    cells = file.read_text().replace(",", " ").split()
    assert sum(map(float, cells)) is not None


MUTATED["credulous"] = SOUND["joint table"]._replace(read=_credulous)


def _read(name: str, file: Path) -> None:
    MUTATED[name].read(file)


def failures(sandbox: Sandbox, name: str, folder: Path) -> list[str]:
    """The kinds of damage, and the ends, of mutants that no reader's check stops; of a library in a
    process of the reader's own the refusal names the file, and is none.
    """
    file = folder / name.replace("/", " ")
    failed = []
    written = MUTATED[name].write(file)
    file = written if isinstance(written, Path) else file
    MUTATED[name].read(file)

    sound = file.read_bytes()
    for kind, mutant in mutants(sound, COUNT, text=b"\0" not in sound):
        file.write_bytes(mutant)
        try:
            within(BOUNDS, sandbox.call, _read, name, file)
        except PipelineError as error:
            is_failure = any(words in error.message for words in FAILURES)
            if is_failure and "file" not in error.evidence:
                failed.append(f"{kind}: {error.message}")
    return failed


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in MUTATED if name != "credulous"])
def test_no_damage_ends_or_holds_up_a_reader(sandbox, tmp_path, name):
    assert failures(sandbox, name, tmp_path) == []


def test_a_reader_that_takes_what_it_is_given_is_found_out(sandbox, tmp_path):
    """The control: float and split take every word for a number that they can."""
    words = "block zeroed: its reader fails on it (V"
    failed = failures(sandbox, "credulous", tmp_path)
    assert any(failure.startswith(words) for failure in failed)
