"""Refusals of damaged files, by format: the words of the message, and the line or key that it
names. Faults of text are in refusals.yaml.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from depth_files import CALIBRATIONS, CLOUDS, PGM, SMALL, encoded, frame, tiff
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
from pipeline.formats.trajectory import read_trajectory

TEXTS = read_yaml(Path(__file__).with_name("refusals.yaml"))
TIME = np.arange(12) / 500
VALUES = np.random.default_rng(1).normal(size=(12, 6))
FORCE, TORQUE = np.hsplit(VALUES, 2)
NETFT = netft_text(ForceRecord(TIME, FORCE, TORQUE, 500.0, "FT7", "4/2", {}))
AXES = ["t", "fx", "fy", "fz", "tx", "ty", "tz"]
LABELS = "time F1 F2 F3 M1 M2 M3"
COLUMNS = dict(zip(AXES, LABELS.split(), strict=True))
FORCES = ForceLogOptions(COLUMNS, force_unit="N", torque_unit="N-m", time_unit="s")
TWO = LogOptions(joints=2, signals={"actual": None})
BY_NAME = LogOptions(joints=2, signals={"actual": ["q1", "q2"]})
PNG = encoded(".png", SMALL)
TIFF = tiff(SMALL, "", compression="tiff_lzw")


class Format(NamedTuple):
    """A reader, the sound file in place of a text of refusals.yaml, and its name."""

    read: Callable[[Path], object]
    sound: bytes | str = ""
    file: str = "file.csv"


class Fault(NamedTuple):
    """Content of a format that is replaced (None: all of it), by what, words of the message, and
    the line or key that it names.
    """

    name: str
    old: bytes | str | None
    new: bytes | str
    words: str
    place: int | str | None = None


def rows_with_gap(lost: range) -> str:
    """Rows of two joints, of which the first has no number in the rows ``lost``."""
    rows = []
    for k in range(40):
        angle = "" if k in lost else 1.5
        rows.append(f"{k / 100},{angle},2\n")
    return "".join(rows)


camera = partial(read_intrinsics, width=640, height=480)
joints = partial(read_joint_table, options=TWO)
FORMATS = {
    "binary PCD": Format(read_cloud, CLOUDS["binary.pcd"], "c.pcd"),
    "text PCD": Format(read_cloud, CLOUDS["ascii.pcd"], "c.pcd"),
    "PLY": Format(read_cloud, CLOUDS["ascii.ply"], "c.ply"),
    "image": Format(partial(read_depth, shape=SMALL.shape), PNG, "d.png"),
    "index": Format(read_index),
    "OpenCV's calibration": Format(camera, CALIBRATIONS["opencv.yaml"], "c.yaml"),
    "calibration": Format(camera, CALIBRATIONS["plain.yaml"], "c.yaml"),
    "DAQ F/T": Format(read_daqft),
    "Net F/T": Format(read_netft, NETFT),
    "ATI calibration": Format(read_calibration, CALIBRATION),
    "force table": Format(partial(read_force_table, options=FORCES)),
    "joint table": Format(joints),
    "joint table with a gap": Format(joints, rows_with_gap(range(5, 6))),
    "labelled joint table": Format(partial(read_joint_table, options=BY_NAME)),
    "Motive": Format(partial(read_motive, unit=None)),
    "Motive, typed rows": Format(partial(read_motive, unit="m")),
    "trajectory": Format(read_trajectory),
}
TRUNCATED = [PNG[:-60], PGM[:-300], TIFF[:60] + b"\xff" * 30 + TIFF[90:]]
LONG_NUMBER = '{"fx": 1%s, "fy": 1, "cx": 4, "cy": 3}' % ("0" * 400)
LONG_GAP = rows_with_gap(range(5, 20))
GAP_WORDS = "column 2  has no number in a gap of more than 10 of its"
OTHER_SIZE = encoded(".png", frame((9, 9)))
BYTES = SMALL.astype(np.uint8)
COLOURS = np.zeros((12, 16, 3), np.uint16)
FAULTS = [
    Fault("PLY", None, bytes(20_000), ""),
    Fault("image", None, OTHER_SIZE, "9 × 9 pixels where the camera has"),
    Fault("image", None, encoded(".png", BYTES), "1 channel(s) of uint8"),
    Fault("image", None, encoded(".png", COLOURS), "3 channel(s) of uint16"),
    Fault("image", None, b"no image at all\n", "no PNG"),
    Fault("image", None, b"", "no PNG"),
    *(Fault("image", None, image, "truncated or damaged") for image in TRUNCATED),
    Fault("calibration", None, "{" * 2_000, "no calibration"),
    Fault("calibration", None, LONG_NUMBER, "decimal numbers"),
    Fault("DAQ F/T", None, NETFT, "set format to netft", "dataset.force.log.format"),
    Fault("DAQ F/T", None, PNG, ""),
    Fault("joint table", None, b"\x89PNG\0", "not plain text"),
    Fault("joint table with a gap", None, LONG_GAP, GAP_WORDS, 6),
    Fault("Motive", None, b"\x89PNG\r\n\0\0", ""),
]
for name, text in TEXTS.items():
    FAULTS += [Fault(name, *fault) for fault in text["faults"]]


def as_bytes(text: bytes | str) -> bytes:
    return text if isinstance(text, bytes) else text.encode()


def sound_content(name: str) -> bytes:
    """Content of the sound file of a format."""
    return as_bytes(FORMATS[name].sound or TEXTS[name]["sound"])


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_file_with_a_fault_is_refused_by_its_place_and_nothing_is_printed(
    tmp_path,
    capfd,
    fault,
):
    sound = sound_content(fault.name)
    file = tmp_path / FORMATS[fault.name].file
    old = sound if fault.old is None else as_bytes(fault.old)
    faulty = sound.replace(old, as_bytes(fault.new))
    assert faulty != sound
    file.write_bytes(faulty)

    error = refusal(FORMATS[fault.name].read, file)

    assert fault.words in error.message
    if fault.place is not None:
        key = "key" if isinstance(fault.place, str) else "line"
        assert error.evidence[key] == fault.place
    if not faulty.startswith(PNG[:8]):  # libpng prints warnings of its own
        assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", FORMATS)
def test_the_control_is_read_and_no_file_and_a_folder_are_refused(tmp_path, name):
    file = tmp_path / FORMATS[name].file
    read = FORMATS[name].read
    file.write_bytes(sound_content(name))
    read(file)
    refusal(read, tmp_path / "absent.pcd")
    refusal(read, tmp_path)
