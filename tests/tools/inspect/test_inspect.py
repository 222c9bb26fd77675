"""What recordings are: every format is named, nothing is guessed, nothing gets out of hand."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from motive_files import rows_file

from pipeline.formats.depth.image import write_depth
from pipeline.tools.inspect.examine import inspect
from pipeline.tools.inspect.report import as_json, as_table


def test_a_datasheet_says_what_is_to_be_filled_in(findings):
    assert [option for _, option in findings["dataset.yaml"].open] == ["dataset.recordings"]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("empty.csv", "", "empty"),
        ("take.csv", "Format Version,1.23,Length Units,Meters\n\n", "no row starts with 'Frame'"),
        (
            "arm.urdf",
            "<robot name='a'><joint name='j' type='revolute'/></robot>",
            "j joins the link ''",
        ),
        (
            "lamp.urdf",
            "<robot name='a'><link name='foot'/></robot>",
            "no joint of one coordinate",
        ),
        ("bomb.urdf", "<!DOCTYPE r [<!ENTITY a 'aaaa'>]><robot>&a;</robot>", "document type"),
        (
            "klingon.urdf",
            "<?xml version='1.0' encoding='klingon'?><robot name='a'/>",
            "is it XML in UTF-8",
        ),
        (
            "log.csv",
            '"Force X (N)","Force Y (N)","Force Z (N)","Frequency = 0","Averaging Level = '
            '1"\n"1.5","2","3"\n',
            "Frequency = 0",
        ),
        ("dataset.yaml", "recordings: x\n", "about"),
        ("take.bag", "#ROSBAG V2.0\n", "cannot be read"),
    ],
)
def test_what_a_reader_refuses_is_told_and_not_raised(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    (finding,) = inspect(tmp_path)
    assert said in " ".join([*finding.stops, *(question for question, _ in finding.open)])


def test_a_damaged_or_missing_frame_of_a_sequence_is_named(zoo, tmp_path):
    shutil.copytree(zoo / "indexed", tmp_path / "a")
    (tmp_path / "a/depth/0001.png").unlink()
    frame = tmp_path / "a/depth/0002.png"
    frame.write_bytes(frame.read_bytes()[:-20])
    write_depth(tmp_path / "a/depth/0003.png", np.ones((3, 4), np.uint16))
    (finding,) = inspect(tmp_path)
    assert "1 of 4 frames of the index are not there: depth/0001.png" in finding.stops[0]
    assert finding.stops[1].startswith("2 frames: 0002.png: the depth frame is truncated")


def test_an_index_that_leads_out_of_its_folder_opens_nothing(tmp_path):
    (tmp_path / "take").mkdir()
    write_depth(tmp_path / "secret.png", np.ones((3, 4), np.uint16))
    (tmp_path / "take/depth.txt").write_text("0.1 ../secret.png\n0.2 ../secret.png\n")
    finding = next(
        finding for finding in inspect(tmp_path) if finding.format == "depth sequence with index"
    )
    assert "outside its folder" in finding.stops[0] and "width" not in finding.facts


def test_the_table_has_one_line_for_recordings_that_differ_in_a_number(tmp_path):
    for number in range(12):
        rows_file(
            tmp_path,
            "rigidbody,Hand,1,0",
            *(f"frame,{k},{k / 100:.6f},1,1,{k},0,1,0,0,0,1,0,0,0,0" for k in range(9)),
        )
        (tmp_path / "rows.csv").rename(tmp_path / f"take_{number}.csv")
    lines = as_table(inspect(tmp_path), tmp_path).splitlines()
    assert lines[0].split() == ["recording", "format", "rate", "unit", "duration", "lost", "holds"]
    assert lines[2].startswith("take_*.csv (12)") and lines[3].startswith(
        "    ? the file does not say the unit of its lengths"
    )
    assert len(lines) == 4


def test_the_json_has_every_recording_with_its_questions(zoo, findings):
    read = json.loads(as_json(inspect(zoo)))
    assert len(read) == len(findings)
    image = next(entry for entry in read if entry["file"].endswith("single.png"))
    assert image["open"][0].keys() == {"question", "option"} and image["facts"]["values"] == [
        1000.0,
        1000.0,
    ]


SAMPLES = Path(__file__).parents[4] / "shared/samples"


@pytest.mark.skipif(
    not SAMPLES.is_dir(),
    reason="the recordings that real instruments wrote are not beside the project",
)
def test_files_that_real_instruments_wrote_are_told_apart():
    findings = {finding.file.name: finding for finding in inspect(SAMPLES)}
    assert {
        name: finding.version for name, finding in findings.items() if name.startswith("motive")
    } == {
        "motive_v1.1_rigidbody.csv": "1.1",
        "motive_v1.21_rigidbody.csv": "1.21",
        "motive_v1.23_rigidbody.csv": "1.23",
        "motive_v1.23_empty.csv": "1.23",
        "motive_v1.23_markers_millimetres.csv": "1.23",
    }
    assert [name for name, finding in findings.items() if finding.stops] == [
        "motive_v1.23_empty.csv"
    ]
    assert findings["motive_v1.23_markers_millimetres.csv"].units == {"length": "mm"}
    assert findings["motive_v1.1_rigidbody.csv"].open[0][1] == "dataset.mocap.unit"
    assert (
        findings["daqft_dotnet_semicolon.csv"].rate == 62.5
        and findings["daqft_dotnet_semicolon.csv"].facts["decimal"] == ","
    )
    assert findings["kinect2_ir_intrinsics.yaml"].facts["fx"] == pytest.approx(366.95, abs=0.01)
