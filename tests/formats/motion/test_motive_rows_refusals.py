"""Row-typed takes that are damaged: refused with their line."""

from __future__ import annotations

import pytest
from motive_files import refusal, rows_file
from motive_row_files import DEFINITION, POSE, body_row, frame_row, in_metres, seen_row

from pipeline.formats.motion.motive import read_motive


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
        ([DEFINITION, seen_row(0).replace(",0,1,2,Arm", ",0,1-,2,Arm")], 4, "'1-'"),
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
def test_damaged_rows_are_refused_with_their_line(tmp_path, rows, line, words):
    head = "righthanded\ninfo,version,1.1\n"
    error = refusal(in_metres, rows_file(tmp_path, *rows, head=head))
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
