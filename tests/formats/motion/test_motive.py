from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motive_files import MARKER, START, columns_file, random_take, refusal

from pipeline.core.errors import RecordingError
from pipeline.formats.motion.motive import read_motive, write_motive

# --- what is written


def test_written_takes_read_back_to_a_half_micrometre_and_keep_their_gaps(tmp_path):
    original = random_take(first=72210)
    original.markers["Link2:Marker1"][50:60] = np.nan
    original.bodies["Base"].position[7] = original.bodies["Base"].quaternion[7] = np.nan
    write_motive(tmp_path / "t.csv", original, start=START)
    result = read_motive(tmp_path / "t.csv")
    np.testing.assert_array_equal(result.frame, original.frame)
    np.testing.assert_allclose(result.time, original.time, rtol=0, atol=1e-12)
    assert (result.name, result.rate, list(result.markers)) == (
        original.name,
        original.rate,
        list(original.markers),
    )
    for name, points in original.markers.items():
        np.testing.assert_allclose(result.markers[name], points, rtol=0, atol=0.501e-6)
    np.testing.assert_allclose(
        result.bodies["Base"].quaternion, original.bodies["Base"].quaternion, rtol=0, atol=0.501e-6
    )
    np.testing.assert_allclose(
        result.bodies["Base"].position, original.bodies["Base"].position, rtol=0, atol=0.501e-6
    )
    assert (
        result.counts["missing_samples"],
        result.counts["missing_poses"],
        result.counts["time_mismatches"],
    ) == (10, 1, 0)


def test_the_written_file_has_the_rows_of_the_instrument(tmp_path):
    write_motive(tmp_path / "t.csv", random_take(2, 1), start=START)
    content = (tmp_path / "t.csv").read_bytes()
    lines = content.split(b"\r\n")
    assert content.count(b"\n") == content.count(b"\r\n") == 9
    assert lines[0].startswith(
        b"Format Version,1.23,Take Name,Take 1,Take Notes,,Capture Frame Rate,100.000000,Export "
        b"Frame Rate,100."
    )
    assert lines[0].endswith(
        b"Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global"
    )
    assert [line[:7] for line in lines[1:6]] == [
        b"",
        b",Type,R",
        b",Name,B",
        b',ID,"A1',
        b",,Rotat",
    ]
    assert lines[6] == b"Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z"
    assert lines[8].startswith(b"1,0.010000,")


def test_writing_twice_gives_the_same_bytes_and_rewriting_what_was_read_too(tmp_path):
    first, second, third = (tmp_path / name for name in ("1.csv", "2.csv", "3.csv"))
    write_motive(first, random_take(), start=START)
    write_motive(second, random_take(), start=START)
    write_motive(third, read_motive(first), start=START)
    assert first.read_bytes() == second.read_bytes() == third.read_bytes()


def test_names_keep_colons_commas_quotes_and_letters_of_any_code_page(tmp_path):
    original = random_take(2, 0, body=False)
    names = ["Arm:M1", "a, b", 'say "x"', "Glied é"]
    original.markers.update(
        {name: np.full((2, 3), number + 1.0) for number, name in enumerate(names)}
    )
    write_motive(tmp_path / "t.csv", original, start=START)
    assert list(read_motive(tmp_path / "t.csv").markers) == names
    (tmp_path / "t.csv").write_bytes((tmp_path / "t.csv").read_bytes().decode().encode("cp1252"))
    assert list(read_motive(tmp_path / "t.csv").markers) == names


# --- other files


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\r\n\r\n",
        b"\x89PNG\r\n\x1a\n\0\0",
        b"text",
        b"a,b\n1,2\n",
        "Format Version,1.23\n".encode("utf-16"),
        b'"open\n',
    ],
)
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "t.csv").write_bytes(content)
    refusal(read_motive, tmp_path / "t.csv")


def test_missing_files_and_folders_are_refused(tmp_path):
    refusal(read_motive, tmp_path / "absent.csv")
    refusal(read_motive, tmp_path)


# --- damage


@settings(derandomize=True, max_examples=60, deadline=None)
@given(frames=st.integers(2, 5), seed=st.integers(0, 99), occluded=st.booleans(), data=st.data())
def test_a_take_cut_at_any_byte_is_refused_or_holds_only_rows_that_were_whole(
    tmp_path_factory, frames, seed, occluded, data
):
    file = tmp_path_factory.mktemp("cut") / "t.csv"
    original = random_take(frames, 2, seed, body=seed % 2 == 0)
    if occluded:
        original.markers["Link1:Marker2"][-1] = np.nan
    write_motive(file, original, start=START)
    whole, content = read_motive(file), file.read_bytes()
    # half of the cuts in the last rows, where numbers can lose digits
    cut = data.draw(
        st.integers(0, len(content) - 1) | st.integers(len(content) - 120, len(content) - 1)
    )
    file.write_bytes(content[:cut])
    try:
        result = read_motive(file)
    except RecordingError:
        return
    kept = content[:cut].replace(b"\r\n", b"\n").replace(b"\r", b"\n").count(b"\n") - 7
    assert 0 < len(result.frame) == kept
    for name, points in whole.markers.items():
        np.testing.assert_array_equal(result.markers[name], points[:kept])


@settings(derandomize=True, max_examples=80, deadline=None)
@given(seed=st.integers(0, 99), data=st.data())
def test_dropped_doubled_and_swapped_lines_are_refused_or_leave_true_samples_and_a_count(
    tmp_path_factory, seed, data
):
    file = tmp_path_factory.mktemp("lines") / "t.csv"
    write_motive(file, random_take(6, 2, seed), start=START)
    whole, lines = read_motive(file), file.read_bytes().splitlines(keepends=True)
    first, second = (data.draw(st.integers(0, len(lines) - 1)) for _ in range(2))
    fault = data.draw(st.sampled_from(["dropped", "doubled", "swapped"]))
    if fault == "dropped":
        del lines[first]
    elif fault == "doubled":
        lines.insert(first, lines[first])
    else:
        lines[first], lines[second] = lines[second], lines[first]
    file.write_bytes(b"".join(lines))
    try:
        result = read_motive(file)
    except RecordingError:
        return
    at = result.frame - whole.frame[0]
    for name, points in result.markers.items():
        assert name in whole.markers
        np.testing.assert_array_equal(points, whole.markers[name][at])
    np.testing.assert_array_equal(
        result.bodies["Base"].quaternion, whole.bodies["Base"].quaternion[at]
    )
    # rows of frames do not change places unseen
    assert fault != "swapped" or first == second or max(first, second) < 7
    if first >= 7:
        counts = {
            "dropped": 6 - len(result.frame),
            "doubled": result.counts.get("repeated_rows"),
            "swapped": 1,
        }
        assert counts[fault] == 1
        assert (
            result.counts["found_frames"] + (fault == "dropped")
            == result.counts["announced_frames"]
            == 6
        )


def test_a_last_row_that_lost_only_digits_is_dropped_and_counted(tmp_path):
    file = columns_file(tmp_path, MARKER + "0,0,1,2,0.125\n1,0.01,1,2,0.125\n")
    content = file.read_bytes()
    for lost in (1, 2, 3):
        file.write_bytes(content[:-lost])
        # the control: to a reader that takes the row, a cut number is a number
        assert float(content[:-lost].split(b",")[-1]) == [0.125, 0.12, 0.1][lost - 1]
        result = read_motive(file)
        np.testing.assert_array_equal(result.markers["A"], [[1, 2, 0.125]])
        assert result.counts["cut_rows"] == 1
