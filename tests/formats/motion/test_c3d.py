"""C3D takes as several programs write them: points, units, labels, missing samples and what else is
in the file, and what is refused; the rate of a take by its times.
"""

import os
from pathlib import Path

import numpy as np
import pytest
from c3d_files import AB, DEC, c3d, points
from numpy.testing import assert_allclose
from written_logs import refusal, seen

from pipeline.core.bounds import Reading, within
from pipeline.formats.motion.c3d import read_c3d
from pipeline.formats.motion.take import rate_from_times


def write(folder: Path, *arguments: object, **options: object) -> Path:
    (folder / "t.c3d").write_bytes(c3d(*arguments, **options))
    return folder / "t.c3d"


@pytest.mark.parametrize(
    ("unit", "scale"),
    [("mm", 1e3), ("MM", 1e3), ("cm", 100.0), ("m", 1.0)],
)
def test_points_come_back_in_metres_and_what_is_none_is_missing(tmp_path, unit, scale):
    xyz = points(6)
    result = read_c3d(write(tmp_path, AB, xyz, unit=unit, scale=scale))
    assert (result.name, result.version, result.rate, [*result.markers]) == (
        "t",
        "C3D",
        100.0,
        AB,
    )
    assert_allclose(np.stack([*result.markers.values()], 1), xyz, rtol=0, atol=3e-7)
    assert_allclose(result.time, np.arange(6) / 100, rtol=0, atol=1e-12)
    names = ("found_frames", "missing_samples", "gaps")
    assert [result.counts[name] for name in names] == [6, 0, 0]
    xyz[2, 1], xyz[3, 1] = np.nan, 0  # and a negative residual
    result = read_c3d(write(tmp_path, AB, xyz, unit=unit, scale=scale, residual=(0, 0)))
    lost = [
        np.flatnonzero(np.isnan(result.markers[name]).any(axis=1)).tolist()
        for name in AB
    ]
    assert lost == [[0], [2, 3]] and result.counts["missing_samples"] == 3


@pytest.mark.parametrize("processor", [84, DEC])
def test_coordinates_that_no_camera_measured_are_missing_and_counted(
    tmp_path,
    processor,
):
    xyz = points(6)
    # m; in mm as NDI writes what it does not see
    xyz[2, 1], xyz[3, 0] = (
        -3.697314e25,
        -1e24,
    )
    (tmp_path / "t.c3d").write_bytes(c3d(AB, xyz, processor=processor))
    take = read_c3d(tmp_path / "t.c3d")
    assert [
        np.isnan(take.markers[name][:, 0]).nonzero()[0].tolist() for name in AB
    ] == [[3], [2]]
    assert (take.counts["invalid_samples"], take.counts["missing_samples"]) == (2, 2)
    assert_allclose(take.markers["Arm:a"][:3], xyz[:3, 0], rtol=0, atol=3e-7)
    assert "2 invalid samples" in seen(tmp_path / "t.c3d")


def test_labels_are_kept_apart_and_a_unit_is_stated_or_asked_for(tmp_path):
    result = read_c3d(write(tmp_path, ["A", "A", ""], points(4, 3)))
    assert list(result.markers) == ["A [1]", "A [2]", "Point 3"]
    assert result.counts["unlabelled_points"] == 1
    for unit, option in (("", None), ("mm", "m")):
        refused = refusal(read_c3d, write(tmp_path, unit=unit), option)
        assert refused.evidence["key"] == "dataset.mocap.unit"
    assert "furlong" in refusal(read_c3d, write(tmp_path, unit="furlong")).message
    result = read_c3d(write(tmp_path, unit=""), "mm")
    assert_allclose(result.markers["Arm:a"], points(5)[:, 0], rtol=0, atol=3e-7)


MANY = [f"m{j}" for j in range(300)]
# of a subject, or without
OUTPUTS = {
    "FORCES": ["F"],
    "POWERS": ["Arm:P"],
    "SCALARS2": ["S"],
}
C3DS = {  # what is written, markers, first frame, counts
    "labels padded with blanks": (c3d([*AB, "", "", ""]), AB, 1, {"skipped_labels": 3}),
    "labels in two parameters": (
        c3d(MANY, points(5, 260)), MANY[:260], 1, {"skipped_labels": 40}),
    "first frame 0": (c3d(first=0), AB, 0, {}),
    "first frame 72210": (c3d(first=72210 % 2**16, start=72210), AB, 72210, {}),
    "first frame of another trial": (c3d(first=7, start=72210), AB, 7, {}),
    "moments and angles": (
        c3d([*AB, "HipMoment", "HipAngles"], points(5, 4),
            groups={"MOMENTS": ["HipMoment"], "ANGLES": ["HipAngles"]}),
        AB, 1, {"skipped_model_outputs": 2}),
    "outputs of a subject": (
        c3d([*AB, "Arm:F", "Arm:P", "Arm:S"], points(5, 5), groups=OUTPUTS),
        AB, 1, {"skipped_model_outputs": 3}),
}  # fmt: skip


@pytest.mark.parametrize("name", C3DS)
def test_a_c3d_of_another_program_is_read(tmp_path, name):
    content, markers, first, counts = C3DS[name]
    (tmp_path / "t.c3d").write_bytes(content)
    take = read_c3d(tmp_path / "t.c3d")
    assert list(take.markers) == markers
    assert take.frame[0] == first
    skipped = {key: n for key, n in take.counts.items() if key.startswith("skipped_")}
    assert skipped == counts | {"skipped_frames": 0}
    assert f"first frame {first};" in seen(tmp_path / "t.c3d")
    outputs = counts.get("skipped_model_outputs", 0)
    xyz = points(5, len(markers) + outputs)[:, 1]
    assert_allclose(take.markers[markers[1]], xyz, rtol=0, atol=3e-7)


# its number of dimensions
DATA_START = c3d().index(b"DATA_START") + len("DATA_START") + 3
CRASHES = c3d()[:DATA_START] + b"\x82" + c3d()[DATA_START + 1 :]
REFUSED = {  # content: words
    c3d(processor=86): "big-endian (SGI, MIPS)",
    c3d(groups={"ANGLES": AB}): "all 2 points are outputs of a model",
    c3d()[:-20]: "truncated",
    c3d(rate=0.0): "no frame rate",
    CRASHES: "damaged",
    **dict.fromkeys(
        (b"", b"\2P", b"Format Version,1.23\n" * 100, b"\2P" + bytes(1022)),
        "no C3D",
    ),
}


@pytest.mark.parametrize("number", range(len(REFUSED)))
def test_a_file_that_is_not_read_says_what_to_do(tmp_path, number):
    content, said = [*REFUSED.items()][number]
    (tmp_path / "t.c3d").write_bytes(content)
    assert said in refusal(read_c3d, tmp_path / "t.c3d").message
    assert said in seen(tmp_path / "t.c3d") or not content


def test_a_name_in_latin_1_is_no_damage(tmp_path):
    file = Path(os.fsdecode(os.fsencode(tmp_path) + b"/Messung_\xfcber.c3d"))
    file.write_bytes(c3d())
    assert list(read_c3d(file).markers) == AB
    assert "markers Arm:a, Arm:b" in seen(file) and "Messung_" in seen(file)


def test_a_file_that_is_beyond_a_bound_names_it(tmp_path):
    error = refusal(
        lambda file: within(Reading(markers=1), read_c3d, file),
        write(tmp_path),
    )
    assert error.evidence["bound"] == "dataset.reading.markers"


RATES = [  # frames that are left out, rate, decimals of the times, the rate that is found
    *((slice(500, 900), rate, 3, rate) for rate in (100, 120, 240, 360)),
    (slice(0), 120, 2, 120),  # rounded by more than half a frame
    (slice(0), 59.94, 15, 59.94),
    (slice(5, None), 59.94, 15, 60),  # in five frames nobody can tell
    (slice(1, None), 100, 3, None),
]


@pytest.mark.parametrize(("frames", "rate", "decimals", "expected"), RATES)
def test_a_rate_that_no_header_states_is_that_of_the_printed_times(
    frames,
    rate,
    decimals,
    expected,
):
    frame = np.delete(np.arange(72210, 74210), frames)
    estimated = rate_from_times(frame, np.round(frame / rate, decimals))
    if expected is None:
        assert estimated is None
    else:
        assert estimated == pytest.approx(expected, abs=1e-9)
    assert rate_from_times(frame, np.zeros(len(frame))) is None
