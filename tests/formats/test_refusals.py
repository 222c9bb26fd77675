"""One table of refusals a format: what is changed in a sound file, the words of the message, and
the line or key that it names.
"""

from collections.abc import Iterable
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
from depth_files import CALIBRATIONS, CLOUDS, PGM, SMALL, encoded, frame, tiff
from motive_files import DEFINITION, MARKER, TOP, frame_row, seen_row
from written_logs import CALIBRATION, netft_text, refusal

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

FORCE, JOINTS = "dataset.force.log", "dataset.joint_log"
VALUES = np.random.default_rng(1).normal(size=(12, 6))
WRENCHES = ForceRecord(
    np.arange(12) / 500, VALUES[:, :3], VALUES[:, 3:], 500.0, "FT7", "4/2", {}
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
NO_XYZ, NO_CALIBRATION = "no header of a PCD or PLY", "no calibration"
FORMATS = {
    "binary PCD": Sound(CLOUDS["binary.pcd"], read_cloud, [
        *((*change, NO_XYZ, None) for change in (
            ("POINTS 12", "POINTS 13"), ("POINTS 12", ""), ("FIELDS rgb z", "FIELDS rgb q"),
            ("SIZE 4 8 1", "SIZE 4 8"), ("SIZE 4 8", "SIZE 4 5"), ("TYPE U F", "TYPE U I"),
            ("COUNT 1 1 3", "COUNT 1 1 0"), ("DATA binary", "DATA zipped"))),
        ("VIEWPOINT 0 0 0 1", "VIEWPOINT 0 0 0 0", "VIEWPOINT", None),
        ("WIDTH 4\nHEIGHT 3", "WIDTH 99999999\nHEIGHT 999", "999 rows of 99999999", None),
        *((None, content, "", None) for content in (b"", b"VERSION 0.7\n")),
    ], "c.pcd"),
    "text PCD": Sound(CLOUDS["ascii.pcd"], read_cloud, [
        ("nan 9", "n/b 9", "'n/b'", 14),
        (" 9 9 9 ", " 9 9 ", "12 numbers where a point has 13", 12),
    ], "c.pcd"),
    "PLY": Sound(CLOUDS["ascii.ply"], read_cloud, [
        ("vertex 12", "vertex 9999999999", "announces", None),
        ("vertex 12", "vertex 0", NO_XYZ, None),
        ("float64 y", "float64 w", NO_XYZ, None),
        ("property double x", "property list uchar double x", NO_XYZ, None),
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
    "index": Sound("0.5 a.png\n0.6 b.png\n", read_index, [
        ("0.6", "1e400", "must be an increasing time", 2),
        (None, "a.png 0.5\n", "must be an increasing time", 1),
        (None, "# nothing\n0.5 a", "has no complete line", None),
        (None, "0.5 a.png\n0.6 a.png\n", "a line above names this frame", 2),
        (None, "1305031102 1.png\n1305031202 2.png\n", "write the times in s", None),
    ]),
    "OpenCV's calibration": Sound(CALIBRATIONS["opencv.yaml"], camera, [
        ("525.5", "-1.", "[fx 0 cx; 0 fy cy; 0 0 1]", None),
        ("525.5", "7e4", "are of no camera", None),
        *((old, new, "are of no camera of 640 × 480", None) for old, new in (
            ("319.5", "639.5"), ("319.5", "159.5"), ("525.5", "1.88"))),
        ("camera_matrix", "camera", "no camera matrix", None),
        ("distortion_coefficients", "bends", "no distortion", None),
        ("rows: 3", "rows: 4", "camera_matrix must be 12 decimal numbers", None),
        # YAML 1.1 takes them for true, octal, hexadecimal and sexagesimal numbers
        *(("525.5", word, "must be 9 decimal numbers", None)
          for word in (".Nan", "yes", "0525", "0x20D", "8:45")),
    ], "c.yaml"),
    "calibration": Sound(CALIBRATIONS["plain.yaml"], camera, [
        *((None, text, NO_CALIBRATION, None) for text in (
            "a: [\n", "5\n", "\x01\x02\n", "{" * 2_000,
            "!!python/object/apply:os.system ['true']\n")),
        *((None, text, "decimal numbers", None) for text in (
            "K: text\nD: []\n", "K: [1, 2]\nD: []\n", "%YAML:1.0\n---\ncameraMatrix: 5\n",
            '{"fx": 1%s, "fy": 1, "cx": 4, "cy": 3}' % ("0" * 400))),
        (None, "K: [1,0,1,0,1,1,0,0,1]\nD: [1]\n", "1 distortion coefficients", None),
    ], "c.yaml"),
    "DAQ F/T": Sound(DAQ, read_daqft, [
        (" (N)", "", "no known unit", 1),
        ("Force Y (N)", "G1", "fx, fy and fz", f"{FORCE}.columns"),
        ("Torque X", "Torque Z", "two columns Torque Z", f"{FORCE}.columns"),
        ("Frequency = 1000", "Frequency = x", "Frequency", 1),
        ("Frequency = 1000,Averaging Level = 16,", "", "set rate to the right", f"{FORCE}.rate"),
        ('"2"', '"2,5"', "'2,5', not a finite number", 2),
        ('"2",', "", "5 cells under 6 labels", 2),
        (DAQ, "1.5,2,3,4,5,6\n" * 2, "labels: none", f"{FORCE}.columns"),
        (DAQ, netft_text(WRENCHES), "set format to netft", f"{FORCE}.format"),
        *((None, content, "", None) for content in (b"", b"0.1,0.2,0.3\n", PNG)),
    ]),
    "Net F/T": Sound(netft_text(WRENCHES), read_netft, [
        ("Force Units: N\r\n", "", "fx has no known unit", f"{FORCE}.force_unit"),
        ("RDT Sample Rate: 500", "RDT Sample Rate: 0", "must be > 0, got '0'", f"{FORCE}.rate"),
        ("RDT Sequence", "Sequence", "no log of a Net F/T", f"{FORCE}.format"),
        (" Ty,", " ,", "none of tx, ty, tz", f"{FORCE}.columns"),
        ('"0x0","7"', '"0x0","5"', "goes back", 14),
        (".", ",", "got '1000000,0'", f"{FORCE}.counts"),
        ('"0x0","7","70","', '"0x0","7","70","?', "not a finite number", 14),
    ]),
    "ATI calibration": Sound(CALIBRATION, read_calibration, [
        *((*change, "must have one calibration", None) for change in (
            ('Name="Tz"', 'Name="Mz"'), (" TorqueUnits", " Units"), ('max="25"', ""),
            (" 6.25", " 1e999"))),
        ("</FTSensor>", "", "no XML", 11),
    ]),
    "force table": Sound("time,F1,F2,F3,M1,M2,M3\n" + SAMPLES, forces, [
        ("0.6,1", "0.4,1", "goes back", 3),
        ("0.6,1,2,3,4,5", "nan,1,2,3,4,5", "column 1 time has no number", 3),
        ("0.6,1,2,3,4,5,7\n0.7,1", "0.6,,2,3,4,5,7\n0.7,", "has 1 numbers in 3 rows", 2),
        ("0.6,1,2,3,4,5,7", "0.6,1,2,3,4,5", "6 cells", 3),
        ("0.5,1,2,3,4,5", "0.5,x,x,x,x,x", "words and numbers", 2),
        ("0.6,1,2,3,4,5,7\n0.7", "0.5,1,2,3,4,5,7\n0.5", "no clock", 2),
        ("time", "when", "label or number (from 0) 'time'", f"{FORCE}.columns"),
        ("M3\n", "M3,M4\n", "7 cells under 8 labels", 2),
    ]),
    "joint table": Sound("0.1, 1, 2\n0.2, 1, 2\n0.3, 1, 2\n", joints, [
        ("0.2, 1, 2", "\n0.2, 1, 2, 3", "4 cells", 3),
        ("0.2, 1", "0.2, x", "'x'", 2),
        ("0.2, 1, 2", "0.1, 1, 3", "does not increase", 2),
        (", 2", ", 2, 3", "3 values, not 2", 1),
        (None, b"\x89PNG\0", "not plain text", None),
    ]),
    "joint table with a gap": Sound(gap([5]), joints, [
        ("0.05,,2", "0.05,x,2", "'x', not a finite number", 6),
        (None, gap(range(5, 20)), "column 2  has no number in a gap of more than 10 of its", 6),
    ]),
    "labelled joint table": Sound("t,q1,q2\n0.0,0.5,0.25\n0.1,0.5,0.25\n",
                                  partial(read_joint_table, options=BY_NAME), [
        ("q2", "q3", "0 columns have the label", f"{JOINTS}.signals"),
        ("q2", "q2,q3", "3 cells under 4 labels", 2),
        ("q2", "q2 (deg)", "in deg by the header and in rad", f"{JOINTS}.angle_unit"),
        ("t,", "t [ms],", "in ms by the header and in s", f"{JOINTS}.time_unit"),
    ]),
    "Motive": Sound(MOTIVE, motive, [
        (ROWS, "0,0,1,2\n", "labels 5 columns: a cut row", 8),
        (ROWS, "0,0,1,2,3\n\n1,0.01,1,oops,3\n", "'oops'", 10),
        (ROWS, "0,0,1,2,3,4\n", "'4' in a column without a label", 8),
        (ROWS, "0,0,0,97705,3\n", "A is at 97705 m, farther than any camera sees", 8),
        (ROWS, "0,0,1,2,\n1,0.01,1,2,\n", "a column is missing", 8),
        ("X,Y,Z\n" + ROWS, "X,Y,Z,,,,\n0,0,00,0,123,0,456,0,789\n", "decimal commas?", 8),
        *((*change, "the frame number", 9) for change in (
            ("\n1,0.01", "\n0,0.01"), ("\n1,0.01", "\n,0.01"), ("\n1,0.01", "\n1.5,0.01"))),
        (",Name,A,A,A\n", "", "no row that starts with 'Frame'", 6),
        (MARKER + ROWS, MARKER.partition("Frame")[0], "no row that starts with 'Frame'", 6),
        ("Length Units,Meters", "Length Units,Inches", "'Inches'", "Length Units"),
        ("Export Frame Rate,100.0", "Export Frame Rate,fast", "frame rate", 1),
        ("Length Units,Meters", "Length Units,Meters,Coordinate Space,Local", "Global", 1),
        (",", ";", "semicolons", 1),
        *((None, content, "", None) for content in (b"", b"\x89PNG\r\n\0\0", b'"op\n')),
    ]),
    "Motive, typed rows": Sound(typed(DEFINITION, *(seen_row(k) for k in range(3))),
                                partial(read_motive, unit="m"), [
        (None, typed(DEFINITION, frame_row(0)), "rate is '' in the header and 0 by", 4),
        (None, typed(DEFINITION, frame_row(0), frame_row(0, "1,1,1,1,3,M-3")), "not increase", 5),
        (None, typed(frame_row(0)), "not defined", 3),
        (None, typed(DEFINITION, DEFINITION.replace("Arm", "Leg")), "defined twice", 4),
        (None, typed(DEFINITION, seen_row(0)[:-12]), "counts require", 4),
        (None, typed(DEFINITION, seen_row(0).replace(",0,1,2,Arm", ",0,x,2,Arm")), "'x'", 4),
        (None, typed(DEFINITION, frame_row(0, "2,1,1,1,2,A,5,5,5,4,A")), "are named 'A'", 4),
        (None, typed("lefthanded"), "right-handed", 3),
        (None, typed(*(frame_row(k, f"1,1,{k}000,3,4,a", tracked=False) for k in range(2))),
         "a is at 1000 m", 4),
    ]),
    "trajectory": Sound(STEPS, read_trajectory, [
        ("0.3,1,1,1,1", "0.3,1,1,1,nan", "column 5 has no number", 5),
        ("0.3,", "0.3002,", "steps must be equal", 5),
        (None, "t,x\n0,1\n", "must name z", 1),
        (None, ",".join(COLUMNS) + "\n0,0,0,0,0,0,0\n", "at least two rows", 2),
        (None, "t,q:a\n0,3.1\n0.1,-3.1\n0.2,-3\n", "q:a jumps by -6.2 rad", None),
        (None, "t,q:a\n0,3.1\n0.1,3", "no line end", 3),
    ]),
}  # fmt: skip


def as_bytes(text: bytes | str) -> bytes:
    return text if isinstance(text, bytes) else text.encode()


CASES = [
    (name, n) for name, sound in FORMATS.items() for n in range(len(sound.changes))
]


@pytest.mark.parametrize(("name", "number"), CASES)
def test_a_file_with_a_fault_is_refused_by_its_place_and_nothing_is_printed(
    tmp_path, capfd, name, number
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
