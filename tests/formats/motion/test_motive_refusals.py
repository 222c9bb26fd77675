"""Motive takes that are refused, with the line, the column or the key of their fault."""

from __future__ import annotations

import pytest
from motive_files import MARKER, columns_file, refusal, rows_file
from motive_row_files import DEFINITION, POSE, body_row, frame_row, in_metres, seen_row

from pipeline.formats.motion.motive import read_motive
from pipeline.formats.motion.take import settle_unit

ROWS = "0,0,1,2,3\n1,0.01,1,2,3\n"
REFUSALS = [  # what of a sound file is replaced, by what; line of the fault
    (ROWS, "", 7, "no frame"),
    (ROWS, "0,0,1,2,3", 7, "no frame"),
    (ROWS, "0,0,1,2\n", 8, "labels 5 columns"),
    (ROWS, "0,0,1,2,3\n1,0.01,1", 9, "cut short"),
    (ROWS, "0,0,1,2,3\n\n1,0.01,1,oops,3\n", 10, "'oops'"),
    (ROWS, "0,0,1,2,3,4\n", 8, "'4' in a column without a label"),
    ("\n1,0.01", "\n0,0.01", 9, "does not increase"),
    ("\n1,0.01", "\n,0.01", 9, "frame number"),
    ("\n1,0.01", "\n1.5,0.01", 9, "frame number"),
    ("\n1,0.01", "\n1e17,0.01", 9, "frame number"),
    ("X,Y,Z", "X,Y,Y", 7, "two columns claim Position Y"),
    ("X,Y,Z", "X,Y,W", 7, "lacks one of its columns"),
    (",Name,A,A,A\n", "", 6, "not Type and Name"),
    (MARKER, "0,0,1,2,3\n" + MARKER, 3, "starts with '0'"),
    (MARKER + ROWS, MARKER.partition("Frame")[0], 6, "starts with 'Frame'"),
    (MARKER + ROWS, "Frame,Time (Seconds),X,Y,Z\n0,0,1,2,3\n", 3, "incomplete"),
    ("Length Units,Meters", "Length Units,Inches", None, "'Inches'"),
    ("Units,Meters", "Units,Meters,Length Units,Millimeters", 1, "Length Units twice"),
    ("Capture Frame Rate,100.0,Export Frame Rate,100.0,", "", 1, "frame rate"),
    ("Export Frame Rate,100.0", "Export Frame Rate,0", 1, "frame rate"),
    ("Export Frame Rate,100.0", "Export Frame Rate,fast", 1, "frame rate"),
    ("Length Units,Meters", "Length Units,Meters,Coordinate Space,Local", 1, "Global"),
    ("Format Version", "Version", 1, "no Motive export"),
    (",", ";", 1, "semicolons"),
    (",", "\t", 1, "tabs"),
]


@pytest.mark.parametrize(("old", "new", "line", "words"), REFUSALS)
def test_a_fault_is_refused_with_its_line(tmp_path, old, new, line, words):
    file = columns_file(tmp_path, MARKER + (ROWS if "Frame Rate,100.0,E" not in old else ROWS[:10]))
    assert read_motive(file).rate == 100.0
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    error = refusal(read_motive, file)
    assert words in error.message and error.evidence.get("line") == line


@pytest.mark.parametrize(
    "content", [b"", b"\r\n\r\n", b"\x89PNG\r\n\0\0", b"a,b\n1,2\n", b'"open\n', b"\xff\xfeF\0o\0"]
)
def test_other_files_and_none_are_refused(tmp_path, content):
    (tmp_path / "t.csv").write_bytes(content)
    for file in (tmp_path / "t.csv", tmp_path / "absent.csv", tmp_path):
        refusal(read_motive, file)


TWO = (
    MARKER.replace("\n", ",Marker,Marker,Marker\n", 1)
    .replace("A,A,A", "A,A,A,B,B,B")
    .replace("1,1,1", "1,1,1,2,2,2")
    .replace("Position\n", "Position,Position,Position,Position\n")
    .replace("X,Y,Z", "X,Y,Z,X,Y,Z")
)
NOTED = (
    TWO.replace("\n", ",Rigid Body\n", 1)
    .replace("\n,ID", ",R\n,ID")
    .replace("\nFrame", ",Mean Marker Error\nFrame")
)


@pytest.mark.parametrize(
    ("body", "line", "column", "words"),
    [
        # a column is missing in the rows alone
        (NOTED + "0,0,1,2,3,4,5,6\n", 8, 9, "the last one is Rigid Body R Mean Marker Error"),
        (NOTED + "0,0,1,2,3,4,5,6,\n1,0.01,1,2,3,4,5,6,\n", 8, 9, "a column is missing"),
        (TWO + "0,0,1,2,3,4,5,\n1,0.01,1,2,3,4,5,\n", 8, 8, "a column is missing"),
        (TWO + "0,0,1,2,,4,5,6\n1,0.01,1,2,,4,5,6\n", 8, 5, "A has no Z in any row"),
        # a number in a column without a label, within the header and beyond
        (
            MARKER.replace("X,Y,Z", "X,Y,Z,,") + "0,0,1,2,3,,\n1,0.01,1,2,3,,7\n",
            9,
            7,
            "'7' in a column without a label",
        ),
        # decimal commas, in rows that a spreadsheet has padded
        (
            MARKER.replace("X,Y,Z", "X,Y,Z,,,,") + "0,0,00,0,123,0,456,0,789\n",
            8,
            6,
            "with decimal commas",
        ),
        (MARKER + "0,0,0,97705,3\n", 8, 4, "A is at 97705 m, farther than any camera sees"),
    ],
)
def test_rows_that_do_not_fit_their_labels_are_refused_by_row_and_column(
    tmp_path, body, line, column, words
):
    error = refusal(read_motive, columns_file(tmp_path, body))
    assert words in error.message
    assert (error.evidence["line"], error.evidence["column"]) == (line, column)


def test_what_is_far_away_depends_on_the_unit(tmp_path):
    body = MARKER + "0,0,0,97705,3\n"
    assert read_motive(columns_file(tmp_path, body, unit="Millimeters")).unit == "mm"
    assert "in cm" in refusal(read_motive, columns_file(tmp_path, body, unit="Centimeters")).message


def test_a_header_without_a_unit_is_read_in_the_one_that_is_asked_for_and_one_rate_is_enough(
    tmp_path,
):
    file = columns_file(tmp_path, MARKER + ROWS)
    other = refusal(lambda file: read_motive(file, "mm"), file)
    assert other.evidence["key"] == "dataset.mocap.unit"
    for part in (",Length Units,Meters", "Export Frame Rate,100.0,"):
        file.write_text(file.read_text().replace(part, ""))
    assert refusal(read_motive, file).evidence["key"] == "dataset.mocap.unit"
    read = read_motive(file, "mm")
    assert read.markers["A"][0].tolist() == [0.001, 0.002, 0.003] and read.rate == 100.0


def test_a_rate_that_the_printed_times_contradict_is_refused(tmp_path):
    def take(rate: float, jump: float):
        rows = "".join(f"{k},{k / rate + jump * (k >= 30):.3f},1,2,3\n" for k in range(60))
        return columns_file(tmp_path, MARKER + rows)

    error = refusal(read_motive, take(120.0, 0.0))
    assert "100 a second by the header and 120 by their times" in error.message
    assert error.evidence["line"] == 1
    # the control: a jump is no other rate
    assert read_motive(take(100.0, 109.0)).counts["time_mismatches"] == 30
    assert read_motive(take(100.3, 0.0)).rate == 100.0


@pytest.mark.parametrize(("w", "sound"), [("1.0002", True), ("0.1", False), ("1e19", False)])
def test_a_rotation_of_another_length_than_one_is_refused_by_its_row(tmp_path, w, sound):
    labels = ("Type", "Name", "ID", "")
    held = ("Rigid Body", "A", "1")
    rows = [[f",{label}", *[what] * 7] for label, what in zip(labels, held, strict=False)]
    rows += [[",", *["Rotation"] * 4, *["Position"] * 3], ["Frame,Time (Seconds)", *"XYZWXYZ"]]
    rows += [[f"{k},{k / 100}", "0", "0", "0", "1", "1", "2", "3"] for k in range(3)]
    rows[-1][4] = w
    file = columns_file(tmp_path, "".join(",".join(row) + "\n" for row in rows))
    if sound:
        assert read_motive(file).bodies["A"].quaternion[2, 3] == float(w)
        return
    error = refusal(read_motive, file)
    assert "the rotation of A is of the length" in error.message and error.evidence["line"] == 10


@pytest.mark.parametrize("stated", ["mm", "MM", "Millimeters", " millimetres "])
def test_a_unit_is_the_files_or_the_options_and_neither_a_guess_nor_a_contradiction(
    tmp_path, stated
):
    for text, option in ((stated, None), ("", "mm"), (stated, "mm")):
        assert settle_unit(text, option, tmp_path, key="U") == "mm"
    for text, option in (("", None), (stated, "m"), ("feet", "m")):
        key = "U" if text == "feet" else "dataset.mocap.unit"
        error = refusal(lambda file, of=(text, option): settle_unit(*of, file, key="U"), tmp_path)
        assert error.evidence["key"] == key


@pytest.mark.parametrize(
    ("rows", "line", "words"),
    [
        ([DEFINITION], 3, "no frame"),
        ([DEFINITION, frame_row(0)], 4, "no rate"),
        ([DEFINITION, frame_row(0), frame_row(0, "1,1,1,1,3,Marker-3")], 5, "does not increase"),
        ([frame_row(0)], 3, "not defined"),
        ([DEFINITION, DEFINITION.replace("Arm", "Leg")], 4, "defined twice"),
        ([DEFINITION, seen_row(0)[:-12]], 4, "counts ask for"),
        ([DEFINITION, seen_row(0) + ",5"], 4, "goes on"),
        ([DEFINITION, seen_row(0).replace(",0,1,2,Arm", ",0,x,2,Arm")], 4, "'x'"),
        ([DEFINITION, seen_row(0).replace(",0,1,2,Arm", ",0,1e999,2,Arm")], 4, "too large"),
        ([DEFINITION, frame_row(0, "-1")], 4, "'-1' where a count"),
        ([DEFINITION, frame_row(0, "999999999999")], 4, "counts ask for"),
        ([DEFINITION, frame_row(0), body_row(1, "1,1,1", "2,2,2")], 5, "not of the frame"),
        (
            [DEFINITION, frame_row(0), body_row(0, "1,1,1", "2,2,2").replace("Arm", "Leg")],
            5,
            "not defined",
        ),
        ([DEFINITION, f"frame,0,0,2,{POSE.format(0)},{POSE.format(0)},0"], 4, "two poses"),
        ([DEFINITION, frame_row(0, "2,1,1,1,2,A,5,5,5,4,A")], 4, "two markers are named 'A'"),
        (["skeleton,1"], 3, "no row type 'skeleton'"),
        (["lefthanded"], 3, "left-handed"),
    ],
)
def test_damaged_rows_of_version_1_1_are_refused_with_their_line(tmp_path, rows, line, words):
    error = refusal(in_metres, rows_file(tmp_path, *rows))
    assert words in error.message
    assert error.evidence["line"] == line


def test_a_position_that_no_camera_sees_is_refused_with_its_line(tmp_path):
    rows = [
        frame_row(0, "1,1,2,3,4,a", tracked=False),
        frame_row(1, "1,1,2000,3,4,a", tracked=False),
    ]
    file = rows_file(tmp_path, *rows)
    error = refusal(lambda path: read_motive(path, "m"), file)
    assert "a is at 2000 m, farther" in error.message and error.evidence["line"] == 4
    assert read_motive(file, "mm").markers["a"][1, 1] == 2.0
