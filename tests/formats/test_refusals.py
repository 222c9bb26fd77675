"""One table of refusals a format: what is changed in a sound file, the words of the message, and
the line or key that it names.
"""

from __future__ import annotations

import struct
import zlib
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from depth_files import CALIBRATIONS, CLOUDS, frame, png, tiff
from motive_files import DEFINITION, MARKER, TOP, TRACKED, body_row, frame_row, seen_row
from written_logs import netft_text, refusal

from pipeline.formats.depth.cloud import read_cloud
from pipeline.formats.depth.image import read_depth
from pipeline.formats.depth.index import read_index
from pipeline.formats.depth.intrinsics import Intrinsics, read_intrinsics, write_intrinsics
from pipeline.formats.force.calibration import AXES, read_calibration
from pipeline.formats.force.daqft import read_daqft, read_netft
from pipeline.formats.force.record import ForceLogOptions, ForceRecord, read_force_table
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.table import read_joint_table
from pipeline.formats.motion.motive import read_motive
from pipeline.formats.trajectory import COLUMNS, read_trajectory

FORCE, JOINTS = "dataset.force.log", "dataset.joint_log"
SMALL = frame(shape=(12, 16))
VALUES = np.random.default_rng(1).normal(size=(12, 6))
WRENCHES = ForceRecord(np.arange(12) / 500, VALUES[:, :3], VALUES[:, 3:], 500.0, "FT7", "4/2", {})
TABLE = {"t": "time", "fx": "F1", "fy": "F2", "fz": "F3", "tx": "M1", "ty": "M2", "tz": "M3"}
FORCES = ForceLogOptions(TABLE, force_unit="N", torque_unit="N-m", time_unit="s")
TWO = LogOptions(joints=2, signals={"actual": None})
BY_NAME = LogOptions(joints=2, signals={"actual": ["q1", "q2"]})
DAQ = ",".join(f'"{kind} {axis} ({unit})"' for kind, unit in (("Force", "N"), ("Torque", "N-m"))
               for axis in "XYZ")  # fmt: skip
DAQ += ',Frequency = 1000,Averaging Level = 16,F/T Serial Number = FT1\n"1.5","2","3","4","5","6"\n'
GAUGES = "".join(f'<UserAxis Name="{a}" values="1 2 3 4 5 {a[1]}" max="25"/>\n' for a in AXES)
GAUGES = GAUGES.replace(" x", " 6.25").replace(" y", " 7").replace(" z", " 8")
CALIBRATION = '<?xml version="1.0" encoding="utf-8"?>\n<FTSensor Serial="FT1">\n<Calibration '
CALIBRATION += f'ForceUnits="N" TorqueUnits="N-mm">\n{GAUGES}</Calibration></FTSensor>\n'
SAMPLES = "0.5,1,2,3,4,5,6\n0.6,1,2,3,4,5,7\n0.7,1,2,3,4,5,8\n"
STEPS = "\n".join([",".join(COLUMNS), *(f"{k / 10},1,1,1,1,1,1" for k in range(9)), ""])
ROWS = "0,0,1,2,3\n1,0.01,1,2,3\n"
MOTIVE = TOP.format(rotation="Quaternion", unit="Meters") + "\n\n" + MARKER + ROWS
TYPED = "righthanded\ninfo,version,1.1\n"
ZIPPED = zlib.compress(b"".join(b"\0" + row.astype(">u2").tobytes() for row in SMALL))
PNG, TIFF = cv2.imencode(".png", SMALL)[1].tobytes(), tiff(SMALL, "", compression="tiff_lzw")
PGM = b"P5\n16 12\n65535\n" + SMALL.astype(">u2").tobytes()
SEVERAL = tiff(SMALL, "", save_all=True, append=[frame(2, (12, 16))])


def encoded(ending: str, image: np.ndarray) -> bytes:
    return cv2.imencode(ending, image)[1].tobytes()


def opencv() -> bytes:
    file = Path("/dev/shm/camera.yaml")
    try:
        write_intrinsics(file, Intrinsics(365.5, 365.25, 254.5, 205.5, 640, 480))
        return file.read_bytes()
    finally:
        file.unlink()


class Sound(NamedTuple):
    """A sound file, its reader, and the changes: old (None: all), new, words, evidence."""

    content: bytes | str
    read: partial | object
    changes: list[tuple]
    name: str = "file.csv"


def typed(*rows: str) -> str:
    return TYPED + "\n".join([*rows, ""])


camera = partial(read_intrinsics, width=640, height=480)
motive = partial(read_motive, unit=None)
forces = partial(read_force_table, options=FORCES)
joints = partial(read_joint_table, options=TWO)
image = partial(read_depth, shape=SMALL.shape)
NO_XYZ, NO_CALIBRATION = "no single x, y and z", "no calibration"
FORMATS = {
    "binary PCD": Sound(CLOUDS["binary.pcd"], read_cloud, [
        ("POINTS 12", "POINTS 13", "3 rows of 4", None),
        *((*change, "damaged", None) for change in (("WIDTH 4", "WIDTH 1e3"), ("POINTS 12", ""))),
        ("FIELDS rgb z", "FIELDS rgb q", NO_XYZ, None),
        ("SIZE 4 8 1", "SIZE 4 8", "damaged", None),
        ("SIZE 4 8", "SIZE 4 4", "of one floating-point type", None),
        ("SIZE 4 8", "SIZE 4 5", "damaged", None),
        ("COUNT 1 1 3", "COUNT 1 2 3", NO_XYZ, None),
        ("COUNT 1 1 3", "COUNT 1 1 0", "damaged", None),
        ("TYPE U F", "TYPE U I", NO_XYZ, None),
        ("VIEWPOINT 0 0 0 1", "VIEWPOINT 0 0 0 0", "VIEWPOINT", None),
        ("VIEWPOINT 0 0 0 1 0 0 0", "VIEWPOINT 0 0", "VIEWPOINT", None),
        ("DATA binary", "DATA zipped", "none of ascii", None),
        ("WIDTH 4\nHEIGHT 3", "WIDTH 99999999\nHEIGHT 999", "999 rows of 99999999", None),
        *((None, content, "", None) for content in (b"", b"ply", b"no cloud\n", bytes(20_000))),
        (None, "VERSION 0.7\n", "no line DATA", None),
    ], "c.pcd"),
    "text PCD": Sound(CLOUDS["ascii.pcd"], read_cloud, [
        ("nan 9", "n/a 9", "'n/a'", 14),
        (" 9 9 9 ", " 9 9 ", "12 numbers where a point has 13", 12),
    ], "c.pcd"),
    "PLY": Sound(CLOUDS["ascii.ply"], read_cloud, [
        ("vertex 12", "vertex 9999999999", "announces", None),
        ("vertex 12", "vertex 0", "announces 0 points", None),
        ("property double x", "property list uchar double x", "more than single", None),
        ("float64 y", "float64 w", NO_XYZ, None),
        ("element vertex", "element edge", "does not begin", None),
        *((None, content, "", None) for content in (b"", b"ply", b"no cloud\n", bytes(20_000))),
    ], "c.ply"),
    "image": Sound(PNG, image, [
        (None, SEVERAL, "several images", None),
        (None, encoded(".tif", frame() / 3.0), "pixels where the camera has", None),
        (None, encoded(".png", SMALL.astype(np.uint8)), "1 channel(s) of 8 bits", None),
        (None, encoded(".png", np.zeros((12, 16, 3), np.uint8)), "3 channel(s) of 8 bits", None),
        (None, png(ZIPPED, 16, 12, colour=2), "3 channel(s) of 16 bits", None),
        (None, png(ZIPPED, 16, 12, colour=9), "truncated or damaged", None),
        (None, encoded(".tiff", SMALL.astype(np.int16)), "1 signed channel(s) of 16", None),
        (None, encoded(".png", frame(shape=(9, 9))), "9 × 9 pixels where the camera has", None),
        (None, b"no image at all\n", "no PNG", None),
        (None, b"", "no PNG", None),
        (None, png(b"", 16, 12), "truncated or damaged", None),
        (None, PNG[:-60], "truncated or damaged; copy it again", None),
        (None, png(b"no zlib at all", 16, 12), "truncated or damaged", None),
        (None, PGM[:-300], "300 bytes lack", None),
        (None, PGM + bytes(9), "9 bytes are left", None),
        (None, TIFF[:60] + b"\xff" * 30 + TIFF[90:], "truncated or damaged", None),
    ], "d.png"),
    "index": Sound("0.5 a.png\n0.6 b.png\n", read_index, [
        ("0.6", "1e400", "no finite time", 2),
        ("0.6 b", "0.5 b", "does not increase", 2),
        ("0.6", "\nnan", "no finite time", 3),
        (None, "0.5\n", "no finite time", 1),
        (None, "a.png 0.5\n", "no finite time", 1),
        (None, "# nothing\n", "names no frame", None),
        (None, "", "empty", None),
        (None, "0.5 a", "names no frame", None),
        (None, "1305031102 1.png\n1305031202 2.png\n", "write the times in s", None),
    ]),
    "OpenCV's calibration": Sound(opencv(), camera, [
        ("365.5", "-1.", "[fx 0 cx; 0 fy cy; 0 0 1]", None),
        ("365.5", ".Nan", "no decimal numbers", None),
        ("365.5", "7e4", "is of no camera", None),
        ("254.5", "700.", "outside 640 × 480", None),
        ("cameraMatrix", "camera", "nor fx, fy, cx, cy; the file has cam", None),
        ("distortionCoefficients", "distortion", "no distortionCoefficients", None),
        ("rows: 3", "rows: 4", "cameraMatrix holds 9 numbers, not 12", None),
        # YAML 1.1 takes them for true, octal, hexadecimal and sexagesimal numbers
        *(("365.5", word, "", None) for word in ("yes", "true", "0525", "+0525", "0x20D", "8:45")),
    ], "c.yaml"),
    "calibration": Sound(CALIBRATIONS["plain.yaml"], camera, [
        *((None, text, NO_CALIBRATION, None) for text in (
            "a: [\n", "- 1\n- 2\n", "{}", "5\n", "# a comment\n", "\x01\x02\n", "{" * 2_000,
            "!!python/object/apply:os.system ['true']\n")),
        (None, "K: text\nD: []\n", "no decimal numbers", None),
        (None, "K: [1, 2]\nD: []\n", "holds 2 numbers, not 9", None),
        (None, "K: {data: {a: 1}}\nD: []\n", "no decimal numbers", None),
        (None, "fx: 1\nfy: 1\ncx: 1\n", "no camera matrix", None),
        (None, '{"fx": [1, 2], "fy": 1, "cx": 1, "cy": 1}', "no decimal numbers", None),
        (None, '{"fx": 1%s, "fy": 1, "cx": 4, "cy": 3}' % ("0" * 400), "no decimal", None),
        (None, "K: [1,0,1,0,1,1,0,0,1]\nD: [1]\n", "1 distortion coefficients", None),
        (None, "%YAML:1.0\n---\ncameraMatrix: 5\n", "no decimal numbers", None),
    ], "c.yaml"),
    "DAQ F/T": Sound(DAQ, read_daqft, [
        (" (N)", "", "no known unit", 1),
        ("(N-m)", "(furlong)", "no known unit", 1),
        ("Force Y (N)", "G1", "labelled fy", 1),
        ("Torque X", "Torque Z", "two columns are labelled Torque Z", f"{FORCE}.columns"),
        ("Frequency = 1000", "Frequency = x", "Frequency", 1),
        ("Averaging Level = 16", "Averaging Level = 0", "Averaging Level", 1),
        ("Frequency = 1000,Averaging Level = 16,", "", "no Frequency", f"{FORCE}.rate"),
        ('"2"', '"two"', "'two'", 2),
        ('"2"', '""', "no number", 2),
        ('"2"', '"2,5"', "'2,5', not a finite number", 2),
        ('"2",', "", "5 cells under 6 labels", 2),
        (DAQ.split("\n")[1], "", "no whole sample", 1),
        (DAQ, "1.5,2,3,4,5,6\n" * 2, "labels them all", f"{FORCE}.format"),
        (DAQ, netft_text(WRENCHES), "set format to netft", f"{FORCE}.format"),
        *((None, content, "", None) for content in (
            b"", b"0.1,0.2,0.3\n", b"Paused for 5 milliseconds\n", b"\x89PNG\r\n\x1a\n\0")),
    ]),
    "Net F/T": Sound(netft_text(WRENCHES), read_netft, [
        ("Force Units: N\r\n", "", "fx has no known unit", f"{FORCE}.force_unit"),
        ("RDT Sample Rate: 500", "RDT Sample Rate: fast", "above 0, not 'fast'", f"{FORCE}.rate"),
        ("RDT Sample Rate: 500", "RDT Sample Rate: 0", "above 0, not '0'", f"{FORCE}.rate"),
        ("RDT Sequence", "Sequence", "no log of a Net F/T", f"{FORCE}.format"),
        (" Fy,", " Fx,", "two columns are labelled Fx", f"{FORCE}.columns"),
        (" Ty,", " ,", "labelled ty", f"{FORCE}.columns"),
        ('"0x0","7"', '"0x0","5"', "goes back", 14),
        ('"0x0","7"', '"0xZ","7"', "0xZ", 14),
        ('"0x0","7"', '"0x0"', "9 cells", 14),
        (".", ",", "not '1000000,0'", f"{FORCE}.counts"),
        ('"0x0","7","70","', '"0x0","7","70","?', "not a finite number", 14),
        ('"0x0","7"', '"0x0","1e999"', "beyond", 14),
    ]),
    "ATI calibration": Sound(CALIBRATION, read_calibration, [
        ('Name="Tz"', 'Name="Mz"', "no UserAxis Tz", None),
        (" TorqueUnits", " Units", "0 elements state", None),
        ('max="25"', 'max="-35"', "not positive", None),
        ('max="25"', 'max="nan"', "finite", None),
        ('max="25"', "", "max of Fx", None),
        (" 6.25", "", "values of Fx must be 6", None),
        (" 6.25", " 1e999", "values of Fx must be 6", None),
        ("</FTSensor>", "", "no XML", 11),
    ]),
    "force table": Sound("time,F1,F2,F3,M1,M2,M3\n" + SAMPLES, forces, [
        ("0.6,1", "0.4,1", "goes back", 3),
        ("0.6,1,2,3,4,5", "0.6,nan,2,3,4,5", "no number", 3),
        ("0.6,1,2,3,4,5,7", "0.6,1,2,3,4,5", "6 cells", 3),
        ("0.5,1,2,3,4,5", "0.5,x,x,x,x,x", "words and numbers", 2),
        (SAMPLES, "", "no whole sample", 1),
        ("0.6,1,2,3,4,5,7\n0.7", "0.5,1,2,3,4,5,7\n0.5", "no clock", 2),
        ("time", "when", "columns are labelled 'time'", f"{FORCE}.columns"),
    ]),
    "joint table": Sound("0.1, 1, 2\n0.2, 1, 2\n0.3, 1, 2\n", joints, [
        ("0.2, 1, 2", "0.2, 1", "2 cells", 2),
        ("0.2, 1, 2", "\n0.2, 1, 2, 3", "4 cells", 3),
        ("0.2, 1", "0.2, x", "'x'", 2),
        ("0.2, 1", "0.2, nan", "no number", 2),
        ("0.2, 1, 2", "0.1, 1, 3", "does not increase", 2),
        (", 2", ", 2, 3", "3 values, not 2", 1),
        (None, "0.1, 1, 2", "no whole line", None),
        (None, b"\x89PNG\0", "not plain text", None),
    ]),
    "labelled joint table": Sound("t,q1,q2\n0.0,0.5,0.25\n0.1,0.5,0.25\n",
                                  partial(read_joint_table, options=BY_NAME), [
        ("q2", "q3", "0 columns are labelled 'q2'", f"{JOINTS}.signals"),
        ("q1,q2", "q2,q2", "0 columns are labelled 'q1'", f"{JOINTS}.signals"),
        ("t,q1,q2", "q1,q2,q2", "2 columns are labelled 'q2'", f"{JOINTS}.signals"),
        ("t,q1,q2\n", "", "labels above the numbers are nothing", f"{JOINTS}.signals"),
        ("q2", "q2 (deg)", "in deg by the header and in rad", f"{JOINTS}.angle_unit"),
        ("t,", "t [ms],", "in ms by the header and in s", f"{JOINTS}.time_unit"),
    ]),
    "Motive": Sound(MOTIVE, motive, [
        (ROWS, "", "no frame", 7),
        (ROWS, "0,0,1,2,3", "no frame", 7),
        (ROWS, "0,0,1,2\n", "labels 5 columns", 8),
        (ROWS, "0,0,1,2,3\n1,0.01,1", "cut short", 9),
        (ROWS, "0,0,1,2,3\n\n1,0.01,1,oops,3\n", "'oops'", 10),
        (ROWS, "0,0,1,2,3,4\n", "'4' in a column without a label", 8),
        (ROWS, "0,0,0,97705,3\n", "A is at 97705 m, farther than any camera sees", 8),
        (ROWS, "0,0,1,2,\n1,0.01,1,2,\n", "a column is missing", 8),
        ("X,Y,Z\n" + ROWS, "X,Y,Z,,\n0,0,1,2,3,,\n1,0.01,1,2,3,,7\n", "'7' in a column without", 9),
        ("X,Y,Z\n" + ROWS, "X,Y,Z,,,,\n0,0,00,0,123,0,456,0,789\n", "with decimal commas", 8),
        ("\n1,0.01", "\n0,0.01", "does not increase", 9),
        ("\n1,0.01", "\n,0.01", "frame number", 9),
        ("\n1,0.01", "\n1.5,0.01", "frame number", 9),
        ("X,Y,Z", "X,Y,Y", "two columns claim Position Y", 7),
        ("X,Y,Z", "X,Y,W", "lacks one of its columns", 7),
        (",Name,A,A,A\n", "", "not Type and Name", 6),
        (MARKER, "0,0,1,2,3\n" + MARKER, "starts with '0'", 3),
        (MARKER + ROWS, MARKER.partition("Frame")[0], "starts with 'Frame'", 6),
        (MARKER + ROWS, "Frame,Time (Seconds),X,Y,Z\n0,0,1,2,3\n", "incomplete", 3),
        ("Length Units,Meters", "Length Units,Inches", "'Inches'", "Length Units"),
        ("Units,Meters", "Units,Meters,Length Units,Millimeters", "Length Units twice", 1),
        ("Export Frame Rate,100.0", "Export Frame Rate,fast", "frame rate", 1),
        ("Length Units,Meters", "Length Units,Meters,Coordinate Space,Local", "Global", 1),
        ("Format Version", "Version", "no Motive export", 1),
        (",", ";", "semicolons", 1),
        (",", "\t", "tabs", 1),
        *((None, content, "", None) for content in (
            b"", b"\r\n\r\n", b"\x89PNG\r\n\0\0", b"a,b\n1,2\n", b'"op\n')),
    ]),
    "Motive, typed rows": Sound(typed(DEFINITION, *(seen_row(k) for k in range(3))),
                                partial(read_motive, unit="m"), [
        (None, typed(DEFINITION), "no frame", 3),
        (None, typed(DEFINITION, frame_row(0)), "no rate", 4),
        (None, typed(DEFINITION, frame_row(0), frame_row(0, "1,1,1,1,3,M-3")), "not increase", 5),
        (None, typed(frame_row(0)), "not defined", 3),
        (None, typed(DEFINITION, DEFINITION.replace("Arm", "Leg")), "defined twice", 4),
        (None, typed(DEFINITION, seen_row(0)[:-12]), "counts require", 4),
        (None, typed(DEFINITION, seen_row(0) + ",5"), "goes on", 4),
        (None, typed(DEFINITION, seen_row(0).replace(",0,1,2,Arm", ",0,x,2,Arm")), "'x'", 4),
        (None, typed(DEFINITION, seen_row(0).replace(",0,1,2", ",0,1e999,2")), "too large", 4),
        (None, typed(DEFINITION, frame_row(0, "-1")), "'-1' where a count", 4),
        (None, typed(DEFINITION, frame_row(0, "999999999999")), "counts require", 4),
        (None, typed(DEFINITION, frame_row(0), body_row(1, "1,1,1", "2,2,2")), "not of the", 5),
        (None, typed(DEFINITION, "frame,0,0,2" + f",{TRACKED.format(0)}" * 2 + ",0"), "two pos", 4),
        (None, typed(DEFINITION, frame_row(0, "2,1,1,1,2,A,5,5,5,4,A")), "are named 'A'", 4),
        (None, typed("skeleton,1"), "no row type 'skeleton'", 3),
        (None, typed("lefthanded"), "left-handed", 3),
        (None, typed(*(frame_row(k, f"1,1,{k}000,3,4,a", tracked=False) for k in range(2))),
         "a is at 1000 m", 4),
    ]),
    "trajectory": Sound(STEPS, read_trajectory, [
        ("0.3,1,1,1,1", "0.3,1,1,1,nan", "column 5 has no number", 5),
        ("0.3,1,1,1", "0.3,1,1,O.1", "'O.1'", 5),
        ("0.3,", "0.3002,", "steps must be equal", 5),
        ("0.3,", "0.1,", "steps must be equal", 5),
        (None, "", "empty", None),
        (None, "t,x\n0,1\n", "must name z", 1),
        (None, ",".join(COLUMNS) + "\n0,0,0,0,0,0,0\n", "at least two rows", 2),
        (None, "t,x,z,phi,vx,vz\n0,0,0,0,0,0\n", "must name vphi", 1),
        (None, "t,q:a,q:a\n0,1,2\n0.1,1,2\n", "must name q:a once", 1),
        (None, "t,q:a\n0,3.1\n0.1,-3.1\n0.2,-3\n", "q:a jumps by -6.2 rad", None),
        (None, "t,q:a\n0,3.1\n0.1,3", "no line end", 3),
    ]),
}  # fmt: skip


def as_bytes(text: bytes | str) -> bytes:
    return text if isinstance(text, bytes) else text.encode()


CASES = [(name, n) for name, sound in FORMATS.items() for n in range(len(sound.changes))]


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


def test_a_size_that_a_header_announces_takes_no_memory(tmp_path):
    big = struct.pack(">II", 60_000, 2**31 - 1)
    for content, read in ((PNG[:16] + big + PNG[24:], image), (b"P5\n99999 99999\n65535\n", image)):
        (tmp_path / "d.png").write_bytes(content)
        refusal(read, tmp_path / "d.png")
