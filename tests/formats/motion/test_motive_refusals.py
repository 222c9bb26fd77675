"""Columnar takes of Motive that are refused, with the line, column or key of their fault."""

from __future__ import annotations

import pytest
from motive_files import MARKER, POSE, columns, columns_file, refusal

from pipeline.formats.motion.motive import read_motive
from pipeline.formats.motion.take import settle_unit

ROWS = "0,0,1,2,3\n1,0.01,1,2,3\n"


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


def test_a_unit_is_the_files_or_the_options_and_neither_a_guess_nor_a_contradiction(tmp_path):
    for stated in ("mm", "MM", "Millimeters", " millimetres "):
        for text, option in ((stated, None), ("", "mm"), (stated, "mm")):
            assert settle_unit(text, option, tmp_path, key="U") == "mm"
    for text, option, key in (
        ("", None, "mocap.unit"),
        ("mm", "m", "mocap.unit"),
        ("ft", "m", "U"),
    ):
        error = refusal(lambda file, of=(text, option): settle_unit(*of, file, key="U"), tmp_path)
        assert error.evidence["key"].endswith(key)
    file = columns_file(tmp_path, MARKER + ROWS)
    for part in (",Length Units,Meters", "Export Frame Rate,100.0,"):
        file.write_text(file.read_text().replace(part, ""))
    read = read_motive(file, "mm")
    assert read.markers["A"][0].tolist() == [0.001, 0.002, 0.003] and read.rate == 100.0


REFUSALS = [  # what of a sound file is replaced, by what; line of the fault
    (ROWS, "", 7, "no frame"),
    (ROWS, "0,0,1,2,3", 7, "no frame"),
    (ROWS, "0,0,1,2\n", 8, "labels 5 columns"),
    (ROWS, "0,0,1,2,3\n1,0.01,1", 9, "cut short"),
    (ROWS, "0,0,1,2,3\n\n1,0.01,1,oops,3\n", 10, "'oops'"),
    (ROWS, "0,0,1,2,3,4\n", 8, "'4' in a column without a label"),
    (ROWS, "0,0,0,97705,3\n", 8, "A is at 97705 m, farther than any camera sees"),
    (ROWS, "0,0,1,2,\n1,0.01,1,2,\n", 8, "a column is missing"),
    ("X,Y,Z\n" + ROWS, "X,Y,Z,,\n0,0,1,2,3,,\n1,0.01,1,2,3,,7\n", 9, "'7' in a column without"),
    ("X,Y,Z\n" + ROWS, "X,Y,Z,,,,\n0,0,00,0,123,0,456,0,789\n", 8, "with decimal commas"),
    ("\n1,0.01", "\n0,0.01", 9, "does not increase"),
    ("\n1,0.01", "\n,0.01", 9, "frame number"),
    ("\n1,0.01", "\n1.5,0.01", 9, "frame number"),
    ("X,Y,Z", "X,Y,Y", 7, "two columns claim Position Y"),
    ("X,Y,Z", "X,Y,W", 7, "lacks one of its columns"),
    (",Name,A,A,A\n", "", 6, "not Type and Name"),
    (MARKER, "0,0,1,2,3\n" + MARKER, 3, "starts with '0'"),
    (MARKER + ROWS, MARKER.partition("Frame")[0], 6, "starts with 'Frame'"),
    (MARKER + ROWS, "Frame,Time (Seconds),X,Y,Z\n0,0,1,2,3\n", 3, "incomplete"),
    ("Length Units,Meters", "Length Units,Inches", None, "'Inches'"),
    ("Units,Meters", "Units,Meters,Length Units,Millimeters", 1, "Length Units twice"),
    ("Capture Frame Rate,100.0,Export Frame Rate,100.0,", "", 1, "frame rate"),
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


@pytest.mark.parametrize("content", [b"", b"\r\n\r\n", b"\x89PNG\r\n\0\0", b"a,b\n1,2\n", b'"op\n'])
def test_other_files_and_none_are_refused(tmp_path, content):
    (tmp_path / "t.csv").write_bytes(content)
    for file in (tmp_path / "t.csv", tmp_path / "absent.csv", tmp_path):
        refusal(read_motive, file)


@pytest.mark.parametrize(("w", "sound"), [("1.0002", True), ("0.1", False), ("1e19", False)])
def test_a_rotation_of_another_length_than_one_is_refused_by_its_row(tmp_path, w, sound):
    rows = "".join(f"{k},{k / 100},0,0,0,{w if k == 2 else 1},1,2,3\n" for k in range(3))
    file = columns_file(tmp_path, columns(("Rigid Body", "A", "1"), quantities=POSE) + rows)
    if sound:
        assert read_motive(file).bodies["A"].quaternion[2, 3] == float(w)
        return
    error = refusal(read_motive, file)
    assert "the rotation of A is of the length" in error.message and error.evidence["line"] == 10


def test_a_column_that_the_rows_lack_is_named_with_its_number(tmp_path):
    two = columns(("Marker", "A", "1"), ("Marker", "B", "2"))
    for rows, column, words in (
        ("0,0,1,2,3,4,5,\n1,0.01,1,2,3,4,5,\n", 8, "a column is missing"),
        ("0,0,1,2,,4,5,6\n1,0.01,1,2,,4,5,6\n", 5, "A has no Z in any row"),
        ("0,0,1,2,3,4,5\n", 8, "the last one is Marker B 2 Position Z"),
    ):
        error = refusal(read_motive, columns_file(tmp_path, two + rows))
        assert words in error.message
        assert (error.evidence["line"], error.evidence["column"]) == (8, column)
