"""Files of every text format, depth images and clouds that are cut at any byte, and logs whose rows
are dropped, doubled or swapped: refused by name, or read with no more than what was whole.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from depth_files import CALIBRATIONS, CLOUDS, PGM, SMALL, encoded
from hypothesis import given, settings
from hypothesis import strategies as st
from motive_files import START, frame_row, in_metres, random_take, rows_file
from PIL import Image
from written_logs import CALIBRATION, write_joint_log, write_netft

from pipeline.core.errors import RecordingError
from pipeline.formats.depth import intrinsics
from pipeline.formats.depth.cloud import read_cloud
from pipeline.formats.depth.image import read_depth
from pipeline.formats.depth.index import read_index, write_index
from pipeline.formats.depth.intrinsics import Intrinsics, read_intrinsics, write_intrinsics
from pipeline.formats.force.calibration import read_calibration
from pipeline.formats.force.daqft import read_daqft, read_netft, write_daqft
from pipeline.formats.force.record import ForceLogOptions, ForceRecord, read_force_table
from pipeline.formats.joints.log import JointLog, LogOptions
from pipeline.formats.joints.table import read_joint_table
from pipeline.formats.motion.motive import read_motive, write_motive
from pipeline.formats.trajectory import read_trajectory, write_trajectory

SAMPLES = np.random.default_rng(5).normal(size=(5, 6)).round(4)
AXES = ("t", "fx", "fy", "fz", "tx", "ty", "tz")
FORCE_TABLE = ForceLogOptions(
    columns={name: name for name in AXES}, force_unit="N", torque_unit="N-m", time_unit="s"
)
RECORD = ForceRecord(np.arange(5) / 500, SAMPLES[:, :3], SAMPLES[:, 3:], 500.0, "", "4/2/13", {})
JOINTS = JointLog(np.arange(5) / 125, {"actual": SAMPLES}, {})
JOINT_TABLE = LogOptions(joints=6, signals={"actual": None})
POSES = pd.DataFrame(
    np.c_[np.arange(5) / 100, SAMPLES],
    columns=["t", *(f"{family}:{row}" for family in "xv" for row in ("x", "z", "phi"))],
)
WRITTEN = Intrinsics(365.456, 365.123, 254.878, 205.395, 640, 480, (0.125,) * 5)
ARE_WHOLE = None  # instead of a number of lines: nothing of the file is read unless all is there


def take(file: Path) -> None:
    original = random_take(4, 2, 7)
    original.markers["Link1:Marker2"][-1] = np.nan
    write_motive(file, original, start=START)


def samples(file: Path) -> np.ndarray:
    read = read_motive(file)
    poses = [np.hstack([body.position, body.quaternion]) for body in read.bodies.values()]
    return np.hstack([*read.markers.values(), *poses])


def wrenches(read: Callable[..., ForceRecord], *options: object) -> Callable[[Path], np.ndarray]:
    def rows(file: Path) -> np.ndarray:
        record = read(file, *options)
        return np.hstack([record.force, record.torque])

    return rows


def force_table(file: Path, separator: str, decimal: str) -> None:
    cells = [list(AXES), *([k / 8, *row] for k, row in enumerate(SAMPLES.tolist()))]
    lines = [separator.join(str(cell).replace(".", decimal) for cell in row) for row in cells]
    file.write_text("\n".join([*lines, ""]))


def pixels(file: Path) -> np.ndarray:
    return read_depth(file, shape=SMALL.shape).pixels


def camera(file: Path) -> np.ndarray:
    read = read_intrinsics(file, width=640, height=480)
    return np.array([read.fx, read.fy, read.cx, read.cy, *read.distortion])


# what writes a file, what is read of it by rows, and the lines above the first row
CASES = {
    "Motive": (take, samples, 7),
    "index": (
        lambda file: write_index(file, np.arange(3) / 30, ("a.png", "b.png", "c.png")),
        lambda file: np.array(read_index(file).files), 2),
    "trajectory": (lambda file: write_trajectory(file, POSES),
                   lambda file: read_trajectory(file).to_numpy(), 1),
    "joint table": (lambda file: write_joint_log(file, JOINTS),
                    lambda file: read_joint_table(file, JOINT_TABLE).signals["actual"], 0),
    "PNG": (lambda file: file.write_bytes(encoded(".png", SMALL)), pixels,
            ARE_WHOLE),
    "PGM": (lambda file: file.write_bytes(PGM), pixels, ARE_WHOLE),
    "calibration": (lambda file: write_intrinsics(file, WRITTEN), camera, ARE_WHOLE),
    "ATI calibration": (partial(Path.write_text, data=CALIBRATION),
                        lambda file: read_calibration(file).matrix, ARE_WHOLE),
}  # fmt: skip
for mark in ".,":
    daq = partial(write_daqft, record=RECORD, decimal=mark)
    CASES[f"DAQ F/T {mark}"] = (daq, wrenches(read_daqft), 1)
for counts in (None, 1000):
    net = partial(write_netft, record=RECORD, counts_per_unit=counts)
    CASES[f"Net F/T, counts {counts}"] = (net, wrenches(read_netft, ForceLogOptions()), 7)
for marks in (",.", ";,", ";.", "\t,"):
    table = partial(force_table, separator=marks[0], decimal=marks[1])
    CASES[f"force table {marks!r}"] = (table, wrenches(read_force_table, FORCE_TABLE), 1)
for compression in ("raw", "tiff_lzw"):
    image = partial(Image.fromarray(SMALL).save, format="TIFF", compression=compression)
    CASES[f"TIFF {compression}"] = (image, pixels, ARE_WHOLE)
for name, text in CALIBRATIONS.items():
    CASES[name] = (partial(Path.write_text, data=text), camera, ARE_WHOLE)
for name, content in CLOUDS.items():
    written = partial(Path.write_bytes, data=content)
    CASES[name] = (written, lambda file: read_cloud(file).points, ARE_WHOLE)


@pytest.mark.parametrize("name", CASES)
def test_a_file_cut_at_any_byte_is_refused_or_holds_only_rows_that_were_whole(
    tmp_path, monkeypatch, name
):
    # without a process for each cut
    monkeypatch.setattr(intrinsics, "read_alone", lambda read, *held, **_: read(*held))
    write, rows, above = CASES[name]
    file, refused = tmp_path / "cut", 0
    write(file)
    whole, content = rows(file), file.read_bytes()
    # all cuts in the last rows, where numbers can lose digits
    for cut in [*range(0, len(content) - 40, 31), *range(len(content) - 40, len(content))]:
        file.write_bytes(content[:cut])
        try:
            result = rows(file)
        except RecordingError as error:
            assert error.evidence["file"] == file
            refused += 1
            continue
        lines = content[:cut].replace(b"\r\n", b"\n").replace(b"\r", b"\n").count(b"\n")
        assert len(result) == (len(whole) if above is ARE_WHOLE else lines - above) > 0
        # the last number of a text cloud without its line end may lack digits
        sure = len(result) - (name in ("ascii.pcd", "ascii.ply", "crlf.ply"))
        np.testing.assert_array_equal(result[:sure], whole[:sure])
    assert refused > 1


def typed_rows(file: Path) -> None:
    rows = [frame_row(k, f"1,{k},0.5,1,{k + 7},a", tracked=False) for k in range(5)]
    rows_file(file.parent, *rows).replace(file)


def stray(file: Path) -> np.ndarray:
    return in_metres(file).markers["a"]


CASES["Motive of five"] = (
    lambda file: write_motive(file, random_take(5, 2), start=START),
    samples,
    7,
)
CASES["Motive, typed rows"] = (typed_rows, stray, 2)
READERS = {  # of logs of five rows
    "Motive of five": read_motive,
    "Motive, typed rows": in_metres,
    "DAQ F/T .": read_daqft,
    "DAQ F/T ,": read_daqft,
    "Net F/T, counts None": read_netft,
    "force table ';,'": partial(read_force_table, options=FORCE_TABLE),
    "joint table": partial(read_joint_table, options=JOINT_TABLE),
}


@pytest.mark.parametrize("name", READERS)
@settings(derandomize=True, max_examples=50, deadline=None)
@given(picks=st.lists(st.integers(0, 4), min_size=3, max_size=9))
def test_dropped_doubled_and_swapped_rows_are_counted_or_refused(tmp_path_factory, name, picks):
    (write, rows, above), file = CASES[name], tmp_path_factory.getbasetemp() / "rows.csv"
    write(file)
    whole, lines = rows(file), file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join([*lines[:above], *(lines[above + k] for k in picks)]))
    kept, counted = sorted({*picks}), "repeated_rows" if "Motive" in name else "doubled_rows"
    if name.startswith("DAQ"):  # without a time, doubled rows can only be counted
        kept, counted = picks, "repeated_rows"
    elif picks != sorted(picks) or (name == "Motive, typed rows" and len(kept) < 2):
        with pytest.raises(RecordingError, match=r"goes back|not increase"):
            rows(file)
        return
    np.testing.assert_array_equal(rows(file), whole[kept])
    doubled = sum(before == after for before, after in pairwise(picks))
    assert READERS[name](file).counts.get(counted, 0) == doubled
