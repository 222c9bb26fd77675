"""What the reader of the columnar grammar refuses, and where it says the fault is."""

from __future__ import annotations

import pytest
from motive_files import MARKER, columns_file, refusal

from pipeline.formats.motion.motive import read_motive


@pytest.mark.parametrize(
    ("body", "line", "words"),
    [
        (MARKER, 7, "no frame"),
        (MARKER + "0,0,1,2\n", 8, "labels 5 columns"),
        (MARKER + "0,0,1,2,3\n1,0.01,1,2\n", 9, "4 cells"),
        (MARKER + "0,0,1,2,3\n1,0.01,1", 9, "cut short"),
        (MARKER + "0,0,1,2,3", 7, "no frame"),
        (MARKER + "0,0,1,2,3\n\n1,0.01,1,oops,3\n", 10, "'oops'"),
        (MARKER + "0,0,1,2,3\n1,0.01,1,inf,3\n", 9, "'inf'"),
        (MARKER + "0,0,1,2,3\n1,0.01,1,1_0,3\n", 9, "'1_0'"),
        (MARKER + "0,0,1,2,3,4\n", 8, "'4' in a column without a label"),
        (MARKER + "0,0,1,2,3\n0,0.01,1,2,3\n", 9, "does not increase"),
        (MARKER + ",0,1,2,3\n", 8, "frame number"),
        (MARKER + "0.5,0,1,2,3\n", 8, "frame number"),
        (MARKER + "1e17,0,1,2,3\n", 8, "frame number"),
        (MARKER.replace("X,Y,Z", "X,Y,Y") + "0,0,1,2,3\n", 7, "two columns claim Position Y"),
        (MARKER.replace("X,Y,Z", "X,Y,W") + "0,0,1,2,3\n", 7, "lacks one of its columns"),
        (MARKER.replace(",Name,A,A,A\n", "") + "0,0,1,2,3\n", 6, "not Type and Name"),
        ("0,0,1,2,3\n" + MARKER + "1,0.01,1,2,3\n", 3, "starts with '0'"),
        (MARKER.partition("Frame")[0], 6, "starts with 'Frame'"),
        ("Frame,Time (Seconds),X,Y,Z\n0,0,1,2,3\n", 3, "incomplete"),
    ],
)
def test_damaged_tables_are_refused_with_their_line(tmp_path, body, line, words):
    error = refusal(read_motive, columns_file(tmp_path, body))
    assert words in error.message
    assert error.evidence["line"] == line


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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("Length Units,Meters", "Length Units,Inches"), "'Inches'"),
        (
            ("Length Units,Meters", "Length Units,Meters,Length Units,Millimeters"),
            "Length Units twice",
        ),
        (("Capture Frame Rate,100.0,Export Frame Rate,100.0,", ""), "frame rate"),
        (("Export Frame Rate,100.0", "Export Frame Rate,0"), "frame rate"),
        (("Export Frame Rate,100.0", "Export Frame Rate,fast"), "frame rate"),
        (("Length Units,Meters", "Length Units,Meters,Coordinate Space,Local"), "Global"),
        (("Format Version", "Version"), "no Motive export"),
    ],
)
def test_headers_that_leave_a_unit_or_rate_open_are_refused(tmp_path, change, words):
    file = columns_file(tmp_path, MARKER + "0,0,1,2,3\n")
    assert read_motive(file).rate == 100.0
    file.write_text(file.read_text().replace(*change))
    assert words in refusal(read_motive, file).message


@pytest.mark.parametrize(("mark", "words"), [(";", "semicolons"), ("\t", "tabs")])
def test_a_take_that_another_program_saved_with_other_separators_is_refused(tmp_path, mark, words):
    file = columns_file(tmp_path, MARKER + "0,0,1,2,3\n")
    file.write_text(file.read_text().replace(",", mark))
    assert words in refusal(read_motive, file).message


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


def test_a_file_without_a_unit_is_read_in_the_one_that_is_asked_for_and_none_is_guessed(tmp_path):
    file = columns_file(tmp_path, MARKER + "0,0,1,2,3\n")
    file.write_text(file.read_text().replace(",Length Units,Meters", ""))
    assert refusal(read_motive, file).evidence["key"] == "dataset.mocap.unit"
    assert read_motive(file, "mm").markers["A"].tolist() == [[0.001, 0.002, 0.003]]


def test_a_unit_that_is_not_the_files_is_refused(tmp_path):
    file = columns_file(tmp_path, MARKER + "0,0,1,2,3\n")
    assert read_motive(file, "m").markers["A"].tolist() == [[1, 2, 3]]
    error = refusal(lambda file: read_motive(file, "mm"), file)
    assert error.evidence["key"] == "dataset.mocap.unit"


def test_older_headers_without_an_export_rate_are_read_at_the_capture_rate(tmp_path):
    file = columns_file(tmp_path, MARKER + "0,0,1,2,3\n")
    file.write_text(
        file.read_text().replace("Export Frame Rate,100.0,", "").replace("Rate,100.0", "Rate,120")
    )
    assert read_motive(file).rate == 120.0


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
