"""One table of refusals a format, in refusals.yaml if it is text: what is changed in a sound file,
the words of the message, and the line or key that it names.
"""

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from depth_files import CALIBRATIONS, CLOUDS, PGM, SMALL, encoded, frame, tiff
from motive_files import DEFINITION, MARKER, TOP, frame_row, seen_row
from written_logs import CALIBRATION, netft_text, refusal

from pipeline.core.typed_yaml import read_yaml
from pipeline.formats.depth.cloud import read_cloud
from pipeline.formats.depth.image import read_depth, read_index
from pipeline.formats.depth.intrinsics import read_intrinsics
from pipeline.formats.force.calibration import read_calibration
from pipeline.formats.force.daqft import read_daqft, read_netft
from pipeline.formats.force.record import ForceLogOptions, ForceRecord, read_force_table
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.table import read_joint_table
from pipeline.formats.motion.motive import read_motive
from pipeline.formats.trajectory import COLUMNS, read_trajectory

FORCE = "dataset.force.log"
VALUES = np.random.default_rng(1).normal(size=(12, 6))
WRENCHES = ForceRecord(
    np.arange(12) / 500,
    VALUES[:, :3],
    VALUES[:, 3:],
    500.0,
    "FT7",
    "4/2",
    {},
)
TABLE = {
    "t": "time",
    "fx": "F1",
    "fy": "F2",
    "fz": "F3",
    "tx": "M1",
    "ty": "M2",
    "tz": "M3",
}
FORCES = ForceLogOptions(TABLE, force_unit="N", torque_unit="N-m", time_unit="s")
TWO = LogOptions(joints=2, signals={"actual": None})
BY_NAME = LogOptions(joints=2, signals={"actual": ["q1", "q2"]})
DAQ = ",".join(f'"{kind} {axis} ({unit})"' for kind, unit in (("Force", "N"), ("Torque", "N-m"))
               for axis in "XYZ")  # fmt: skip
DAQ += ',Frequency = 1000,Averaging Level = 16,F/T Serial Number = FT1\n"1.5","2","3","4","5","6"\n'
SAMPLES = "0.5,1,2,3,4,5,6\n0.6,1,2,3,4,5,7\n0.7,1,2,3,4,5,8\n"
STEPS = "\n".join([",".join(COLUMNS), *(f"{k / 10},1,1,1,1,1,1" for k in range(9)), ""])
ROWS = "0,0,1,2,3\n1,0.01,1,2,3\n"
MOTIVE = TOP.format(rotation="Quaternion", unit="Meters") + "\n\n" + MARKER + ROWS
TYPED = "righthanded\ninfo,version,1.1\n"
PNG, TIFF = encoded(".png", SMALL), tiff(SMALL, "", compression="tiff_lzw")


class Sound(NamedTuple):
    """A sound file, its reader, and the changes: old (None: all), new, words, evidence."""

    content: bytes | str
    read: partial | object
    changes: list[tuple]
    name: str = "file.csv"


def gap(lacking: Iterable[int]) -> str:
    return "".join(f"{k / 100},{'' if k in lacking else 1.5},2\n" for k in range(40))


def typed(*rows: str) -> str:
    return TYPED + "\n".join([*rows, ""])


camera = partial(read_intrinsics, width=640, height=480)
motive = partial(read_motive, unit=None)
forces = partial(read_force_table, options=FORCES)
joints = partial(read_joint_table, options=TWO)
image = partial(read_depth, shape=SMALL.shape)
FORMATS = {
    "binary PCD": Sound(CLOUDS["binary.pcd"], read_cloud, [
        *((None, content, "", None) for content in (b"", b"VERSION 0.7\n")),
    ], "c.pcd"),
    "text PCD": Sound(CLOUDS["ascii.pcd"], read_cloud, [], "c.pcd"),
    "PLY": Sound(CLOUDS["ascii.ply"], read_cloud, [
        *((None, content, "", None) for content in (b"ply", bytes(20_000))),
    ], "c.ply"),
    "image": Sound(PNG, image, [
        (None, encoded(".png", frame((9, 9))), "9 × 9 pixels where the camera has", None),
        (None, encoded(".png", SMALL.astype(np.uint8)), "1 channel(s) of uint8", None),
        (None, encoded(".png", np.zeros((12, 16, 3), np.uint16)), "3 channel(s) of uint16", None),
        *((None, content, "no PNG", None) for content in (b"no image at all\n", b"")),
        *((None, content, "truncated or damaged", None) for content in (
            PNG[:-60], PGM[:-300], TIFF[:60] + b"\xff" * 30 + TIFF[90:])),
    ], "d.png"),
    "index": Sound("0.5 a.png\n0.6 b.png\n", read_index, []),
    "OpenCV's calibration": Sound(CALIBRATIONS["opencv.yaml"], camera, [], "c.yaml"),
    "calibration": Sound(CALIBRATIONS["plain.yaml"], camera, [
        (None, "{" * 2_000, "no calibration", None),
        (None, '{"fx": 1%s, "fy": 1, "cx": 4, "cy": 3}' % ("0" * 400), "decimal numbers", None),
    ], "c.yaml"),
    "DAQ F/T": Sound(DAQ, read_daqft, [
        (DAQ, "1.5,2,3,4,5,6\n" * 2, "labels: none", f"{FORCE}.columns"),
        (DAQ, netft_text(WRENCHES), "set format to netft", f"{FORCE}.format"),
        *((None, content, "", None) for content in (b"", b"0.1,0.2,0.3\n", PNG)),
    ]),
    "Net F/T": Sound(netft_text(WRENCHES), read_netft, []),
    "ATI calibration": Sound(CALIBRATION, read_calibration, []),
    "force table": Sound("time,F1,F2,F3,M1,M2,M3\n" + SAMPLES, forces, []),
    "joint table": Sound("0.1, 1, 2\n0.2, 1, 2\n0.3, 1, 2\n", joints, [
        (None, b"\x89PNG\0", "not plain text", None),
    ]),
    "joint table with a gap": Sound(gap([5]), joints, [
        (None, gap(range(5, 20)), "column 2  has no number in a gap of more than 10 of its", 6),
    ]),
    "labelled joint table": Sound("t,q1,q2\n0.0,0.5,0.25\n0.1,0.5,0.25\n",
                                  partial(read_joint_table, options=BY_NAME), []),
    "Motive": Sound(MOTIVE, motive, [
        (MARKER + ROWS, MARKER.partition("Frame")[0], "no row that starts with 'Frame'", 6),
        *((None, content, "", None) for content in (b"", b"\x89PNG\r\n\0\0", b'"op\n')),
    ]),
    "Motive, typed rows": Sound(typed(DEFINITION, *(seen_row(k) for k in range(3))),
                                partial(read_motive, unit="m"), [
        (None, typed(DEFINITION, frame_row(0)), "rate is '' in the header and 0 by", 4),
        (None, typed(DEFINITION, frame_row(0), frame_row(0, "1,1,1,1,3,M-3")), "not increase", 5),
        (None, typed(DEFINITION, DEFINITION.replace("Arm", "Leg")), "defined twice", 4),
        (None, typed(DEFINITION, seen_row(0)[:-12]), "counts require", 4),
        (None, typed(DEFINITION, seen_row(0).replace(",0,1,2,Arm", ",0,x,2,Arm")), "'x'", 4),
        (None, typed(DEFINITION, frame_row(0, "2,1,1,1,2,A,5,5,5,4,A")), "are named 'A'", 4),
        (None, typed(*(frame_row(k, f"1,1,{k}000,3,4,a", tracked=False) for k in range(2))),
         "a is at 1000 m", 4),
    ]),
    "trajectory": Sound(STEPS, read_trajectory, []),
}  # fmt: skip
CHANGES = read_yaml(Path(__file__).with_name("refusals.yaml"))  # of text, by format
for name, changes in CHANGES.items():
    FORMATS[name].changes.extend(changes)


def as_bytes(text: bytes | str) -> bytes:
    return text if isinstance(text, bytes) else text.encode()


CASES = [
    (name, n) for name, sound in FORMATS.items() for n in range(len(sound.changes))
]


@pytest.mark.parametrize(("name", "number"), CASES)
def test_a_file_with_a_fault_is_refused_by_its_place_and_nothing_is_printed(
    tmp_path,
    capfd,
    name,
    number,
):
    sound, content = FORMATS[name], as_bytes(FORMATS[name].content)
    old, new, words, where = sound.changes[number]
    file, changed = tmp_path / sound.name, as_bytes(new)
    if old is not None:
        changed = content.replace(as_bytes(old), changed)
        assert changed != content
    file.write_bytes(changed)
    error = refusal(sound.read, file)
    assert words in error.message
    if where is not None:
        assert error.evidence["key" if isinstance(where, str) else "line"] == where
    assert capfd.readouterr() == ("", "") or changed.startswith(PNG[:8])  # libpng's own


@pytest.mark.parametrize("name", FORMATS)
def test_the_control_is_read_and_no_file_and_a_folder_are_refused(tmp_path, name):
    sound = FORMATS[name]
    (tmp_path / sound.name).write_bytes(as_bytes(sound.content))
    sound.read(tmp_path / sound.name)
    for absent in (tmp_path / "absent.pcd", tmp_path):
        refusal(sound.read, absent)
