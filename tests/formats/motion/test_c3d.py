"""C3D takes as several programs write them: points, units, labels, missing samples and what else is
in the file, and what is refused; the rate of a take by its times.
"""

import os
from pathlib import Path

import numpy as np
import pytest
from c3d_files import AB, DEC, c3d, points
from case_tables import cases_beside
from numpy.testing import assert_allclose
from written_logs import refusal, seen

from pipeline.core.bounds import Reading, within
from pipeline.formats.motion.c3d import read_c3d
from pipeline.formats.motion.take import MotionTake, rate_from_times

cases = cases_beside(__file__)


def write(folder: Path, *arguments: object, **options: object) -> Path:
    (folder / "t.c3d").write_bytes(c3d(*arguments, **options))
    return folder / "t.c3d"


@pytest.mark.parametrize(
    ("unit", "scale"),
    [("mm", 1e3), ("MM", 1e3), ("cm", 100.0), ("m", 1.0)],
)
def test_points_come_back_in_metres(tmp_path, unit, scale):
    xyz = points(6)
    counts = {"found_frames": 6, "missing_samples": 0, "gaps": 0}
    file = write(tmp_path, AB, xyz, unit=unit, scale=scale)

    take = read_c3d(file)

    assert (take.name, take.version, take.rate) == ("t", "C3D", 100.0)
    assert [*take.markers] == AB
    read = np.stack([*take.markers.values()], axis=1)
    assert_allclose(read, xyz, rtol=0, atol=3e-7)
    assert_allclose(take.time, np.arange(6) / 100, rtol=0, atol=1e-12)
    assert counts.items() <= take.counts.items()


def lost_frames(take: MotionTake, marker: str) -> list[int]:
    """Frames in which a coordinate of the marker is missing."""
    return np.flatnonzero(np.isnan(take.markers[marker]).any(axis=1)).tolist()


def test_zeros_gaps_and_negative_residuals_are_missing(tmp_path):
    xyz = points(6)
    xyz[2, 1], xyz[3, 1] = np.nan, 0

    take = read_c3d(write(tmp_path, AB, xyz, residual=(0, 0)))

    assert lost_frames(take, "Arm:a") == [0]
    assert lost_frames(take, "Arm:b") == [2, 3]
    assert take.counts["missing_samples"] == 3


@pytest.mark.parametrize("processor", [84, DEC])
def test_coordinates_that_no_camera_measured_are_missing_and_counted(
    tmp_path,
    processor,
):
    xyz = points(6)
    # m; in mm as NDI writes what it does not see
    xyz[2, 1], xyz[3, 0] = -3.697314e25, -1e24
    file = write(tmp_path, AB, xyz, processor=processor)

    take = read_c3d(file)

    assert lost_frames(take, "Arm:a") == [3]
    assert lost_frames(take, "Arm:b") == [2]
    assert (take.counts["invalid_samples"], take.counts["missing_samples"]) == (2, 2)
    assert_allclose(take.markers["Arm:a"][:3], xyz[:3, 0], rtol=0, atol=3e-7)
    assert "2 invalid samples" in seen(file)


def test_equal_and_empty_labels_are_kept_apart(tmp_path):
    take = read_c3d(write(tmp_path, ["A", "A", ""], points(4, 3)))
    assert list(take.markers) == ["A [1]", "A [2]", "Point 3"]
    assert take.counts["unlabelled_points"] == 1


def test_a_unit_is_stated_by_the_file_or_the_option_and_never_differs(tmp_path):
    for unit, option in (("", None), ("mm", "m")):
        error = refusal(read_c3d, write(tmp_path, unit=unit), option)
        assert error.evidence["key"] == "dataset.mocap.unit"
    assert "furlong" in refusal(read_c3d, write(tmp_path, unit="furlong")).message

    take = read_c3d(write(tmp_path, unit=""), "mm")
    assert_allclose(take.markers["Arm:a"], points(5)[:, 0], rtol=0, atol=3e-7)


@cases("programs")
def test_a_c3d_of_another_program_is_read(
    tmp_path,
    labels,
    count,
    options,
    markers,
    first,
    counts,
):
    labels = labels or [f"m{j}" for j in range(300)]
    file = write(tmp_path, labels, points(5, count), **options)

    take = read_c3d(file)

    assert list(take.markers) == labels[:markers]
    assert take.frame[0] == first
    skipped = {key: n for key, n in take.counts.items() if key.startswith("skipped_")}
    assert skipped == counts | {"skipped_frames": 0}
    assert f"first frame {first};" in seen(file)
    xyz = points(5, count)[:, 1]
    assert_allclose(take.markers[labels[1]], xyz, rtol=0, atol=3e-7)


# its number of dimensions
DATA_START = c3d().index(b"DATA_START") + len("DATA_START") + 3
CRASHES = c3d()[:DATA_START] + b"\x82" + c3d()[DATA_START + 1 :]
REFUSED = [  # content, words
    (c3d(processor=86), "big-endian (SGI, MIPS)"),
    (c3d(groups={"ANGLES": AB}), "all 2 points are outputs of a model"),
    (c3d()[:-20], "truncated"),
    (c3d(rate=0.0), "no frame rate"),
    (CRASHES, "damaged"),
    (b"", "no C3D"),
    (b"\2P", "no C3D"),
    (b"Format Version,1.23\n" * 100, "no C3D"),
    (b"\2P" + bytes(1022), "no C3D"),
]


@pytest.mark.parametrize(("content", "words"), REFUSED)
def test_a_file_that_is_not_read_says_what_to_do(tmp_path, content, words):
    file = tmp_path / "t.c3d"
    file.write_bytes(content)

    assert words in refusal(read_c3d, file).message
    if content:
        assert words in seen(file)


def test_a_name_in_latin_1_is_no_damage(tmp_path):
    file = Path(os.fsdecode(os.fsencode(tmp_path) + b"/Messung_\xfcber.c3d"))
    file.write_bytes(c3d())

    assert list(read_c3d(file).markers) == AB
    assert "markers Arm:a, Arm:b" in seen(file) and "Messung_" in seen(file)


def test_a_file_that_is_beyond_a_bound_names_it(tmp_path):
    def read_one_marker(file: Path) -> MotionTake:
        return within(Reading(markers=1), read_c3d, file)

    error = refusal(read_one_marker, write(tmp_path))
    assert error.evidence["bound"] == "dataset.reading.markers"


@cases("rates")
def test_a_rate_that_no_header_states_is_that_of_the_printed_times(
    lost,
    rate,
    decimals,
    expected,
):
    frame = np.delete(np.arange(72210, 74210), slice(*lost))
    printed = np.round(frame / rate, decimals)

    estimated = rate_from_times(frame, printed)

    if expected is None:
        assert estimated is None
    else:
        assert estimated == pytest.approx(expected, abs=1e-9)
    assert rate_from_times(frame, np.zeros(len(frame))) is None
