"""What recordings are: every format is named, nothing is guessed, nothing gets out of hand."""

from __future__ import annotations

import json
import os
import shutil
import time
import zlib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from motive_files import rows_file

from pipeline.errors import RecordingError
from pipeline.inspection import limits
from pipeline.inspection.finding import Finding
from pipeline.inspection.inspect import inspect
from pipeline.inspection.report import as_json, as_table
from pipeline.instruments.depth import write_depth

FORMATS = {
    "columns.csv": "Motive CSV, columnar", "rows.csv": "Motive CSV, row-typed", "take.c3d": "C3D", "points.csv": "ATI DAQ F/T log",
    "commas.csv": "ATI DAQ F/T log", "netft.csv": "ATI Net F/T log", "FT7.cal": "ATI calibration", "single.png": "depth image",
    "metres.tiff": "depth image", "indexed/depth.txt": "depth sequence with index", "numbered/[0-9]*.png": "depth sequence, numbered",
    "camera.yaml": "camera intrinsics", "sized.json": "camera intrinsics", "cloud.ply": "point cloud, PLY", "cloud.pcd": "point cloud, PCD",
    "ros1/take.bag": "ROS bag", "sqlite3/take": "ROS bag", "mcap/take": "ROS bag", "q.csv": "table of numbers",
    "path.csv": "commanded trajectory", "three.urdf": "URDF", "dataset.yaml": "datasheet", "notes.md": "unknown", "payload.pkl": "unknown",
}  # fmt: skip


@pytest.fixture(scope="module")
def found(zoo) -> dict[str, Finding]:
    return {finding.file.relative_to(zoo).as_posix(): finding for finding in inspect(zoo)}


def test_every_format_is_named_and_every_file_accounted_for(found):
    assert {name: finding.format for name, finding in found.items()} == FORMATS
    assert [name for name, finding in found.items() if finding.stops] == []


@pytest.mark.parametrize("name", [name for name in FORMATS if "[" not in name])
def test_a_file_alone_is_what_it_is_in_its_folder(zoo, found, name):
    (alone,) = inspect(zoo / name)
    assert alone == found[name]


def test_motion_takes_say_version_rate_unit_duration_names_and_gaps(found):
    take = found["columns.csv"]
    assert (take.version, take.rate, take.units, take.duration) == ("1.23", 100.0, {"length": "m"}, 0.49)
    assert (len(take.markers), take.bodies, take.gaps, take.open) == (9, ["Base"], {"missing_samples": 5}, [])
    assert (found["take.c3d"].units, found["take.c3d"].markers) == ({"length": "mm"}, ["A", "B", "C"])


def test_a_unit_that_no_file_states_is_a_question_with_its_option(found):
    take = found["rows.csv"]
    assert (take.version, take.units, take.bodies) == ("1.1", {"length": "not stated"}, ["Hand"])
    assert [option for _, option in take.open] == ["dataset.mocap.unit"]
    assert take.facts["rate_from"] == "the printed times: the file states none" and take.rate == 120


def test_force_logs_say_their_locale_rate_and_units(found):
    for name, separator, decimal in (("points.csv", ",", "."), ("commas.csv", ";", ",")):
        log = found[name]
        assert (log.facts["separator"], log.facts["decimal"], log.rate, log.duration) == (separator, decimal, 100.0, 4.99)
        assert (log.units, log.facts["serial"], log.open) == ({"force": "N", "torque": "N-m"}, "FT7", [])
    assert found["netft.csv"].rate == 100.0 and found["netft.csv"].units == {"force": "N", "torque": "N-m"}
    assert found["FT7.cal"].facts["ratings"]["fz"] == 3.0


def test_whole_numbers_between_commas_are_a_question(tmp_path):
    (tmp_path / "t.csv").write_text("1,5,2,5\n" * 5)
    (log,) = inspect(tmp_path)
    assert log.format == "table of numbers" and "separator" in log.open[0][1] and "columns" not in log.facts


def test_the_unit_of_depth_is_a_question_that_shows_the_values(found):
    image, sequence = found["single.png"], found["indexed/depth.txt"]
    assert (image.version, image.facts["width"], image.facts["values"], image.units) == ("16 bits", 32, [1000.0, 1000.0], {})
    for finding in (image, sequence, found["metres.tiff"], found["numbered/[0-9]*.png"], found["mcap/take"]):
        assert "dataset.depth.units_per_metre" in [option for _, option in finding.open]
    assert (sequence.facts["frames"], sequence.rate, sequence.gaps) == (4, 10.0, {"dropped_frames": 1})
    assert "dataset.depth.rate" in [option for _, option in found["numbered/[0-9]*.png"].open]


def test_intrinsics_say_their_size_or_that_they_do_not(found):
    assert (found["sized.json"].facts["width"], found["sized.json"].open) == (32, [])
    assert "width" not in found["camera.yaml"].facts and found["camera.yaml"].facts["cx"] == 16.0
    assert [option for _, option in found["camera.yaml"].open] == ["dataset.depth.width, .height"]


@pytest.mark.parametrize(("name", "version"), [("ros1/take.bag", "ROS 1"), ("sqlite3/take", "ROS 2"), ("mcap/take", "ROS 2")])
def test_bags_say_their_topics_and_ask_which_of_several(found, name, version):
    bag = found[name]
    assert bag.version == version and abs(bag.duration - 0.2) < 1e-6
    assert bag.facts["topics"]["/depth"] == {"type": "sensor_msgs/msg/Image", "messages": 3}
    assert ("several topics could be meant: /depth, /other", "dataset.depth.topic") in bag.open


def test_a_table_says_what_can_be_seen_and_asks_what_it_is(found):
    table = found["q.csv"]
    assert (table.rate, table.units, table.facts["columns"], table.facts["step_of_column_0"]) == (None, {}, 7, 0.008)
    assert "dataset.joint_log" in table.open[0][1]


def test_a_datasheet_says_what_is_to_be_filled_in(found):
    assert [option for _, option in found["dataset.yaml"].open] == ["dataset.recordings"]


# --- what would stop the analysis


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("empty.csv", "", "empty"),
        ("take.csv", "Format Version,1.23,Length Units,Meters\n\n", "no row starts with 'Frame'"),
        ("arm.urdf", "<robot name='a'><joint name='j' type='revolute'/></robot>", "fewer than three revolute"),
        ("bomb.urdf", "<!DOCTYPE r [<!ENTITY a 'aaaa'>]><robot>&a;</robot>", "document type"),
        ("klingon.urdf", "<?xml version='1.0' encoding='klingon'?><robot name='a'/>", "save it as UTF-8"),
        ("log.csv", '"Force X (N)","Force Y (N)","Force Z (N)","Frequency = 0","Averaging Level = 1"\n"1.5","2","3"\n', "Frequency = 0"),
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
    finding = next(finding for finding in inspect(tmp_path) if finding.format == "depth sequence with index")
    assert "outside its folder" in finding.stops[0] and "width" not in finding.facts


# --- hostile folders and files


def test_pipes_and_dangling_or_circular_links_are_named_and_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "gone.csv").symlink_to("nowhere")
    (tmp_path / "round").symlink_to(tmp_path)
    findings = inspect(tmp_path)
    assert {finding.file.name: finding.stops for finding in findings} == {
        name: ["this is no regular file, or a link to nothing"] for name in ("pipe.csv", "gone.csv")
    }


def test_a_name_that_is_no_utf8_can_be_printed(tmp_path):
    (tmp_path / os.fsdecode(b"take\xff.csv")).write_text("1;2\n3;4\n")
    findings = inspect(tmp_path)
    for text in (as_table(findings, tmp_path), as_json(findings)):
        assert "take\\" in text and text.encode()


def test_names_that_a_terminal_would_act_on_are_not_printed(tmp_path):
    rows_file(tmp_path, "rigidbody,Ha\x1b[2Jnd,1,0", *(f"frame,{k},{k / 100:.6f},1,1,{k},0,1,0,0,0,1,0,0,0,0" for k in range(9)))
    findings = inspect(tmp_path)
    assert findings[0].bodies == ["Ha\x1b[2Jnd"] and "Ha\N{REPLACEMENT CHARACTER}[2Jnd" in as_table(findings, tmp_path)


def test_nothing_that_would_execute_is_executed(zoo, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    inspect(zoo)
    assert list(tmp_path.iterdir()) == []


def test_a_picture_that_unfolds_into_gigabytes_is_refused_by_its_header(zoo, tmp_path):
    content = bytearray((zoo / "single.png").read_bytes())
    content[16:24] = (10_000).to_bytes(4, "big") * 2
    content[29:33] = zlib.crc32(content[12:29]).to_bytes(4, "big")
    (tmp_path / "bomb.png").write_bytes(content)
    (finding,) = inspect(tmp_path)
    assert "more than any depth camera" in finding.stops[0]


@pytest.mark.parametrize(
    "text", ["a: &a [x, x]\n" + "".join(f"{b}: &{b} [*{a}, *{a}, *{a}]\n" for a, b in pairwise("abcdefghijklmnop")), "[" * 5000]
)
def test_yaml_that_unfolds_or_nests_without_end_is_refused(tmp_path, monkeypatch, text):
    monkeypatch.setattr(limits, "PATIENCE", 1.0)
    (tmp_path / "dataset.yaml").write_text(f"recordings: x\n{text}\n")
    began = time.monotonic()
    (finding,) = inspect(tmp_path)
    assert finding.stops and time.monotonic() - began < 5


def test_time_and_memory_of_one_file_are_bounded():
    with pytest.raises(RecordingError, match=r"within 0\.1 s"), limits.bounded(patience=0.1):
        while True:
            pass
    with pytest.raises(RecordingError, match="memory"), limits.bounded(memory=1 << 32):
        np.ones(1 << 32)
    with limits.bounded():
        pass
    np.ones(1 << 20)


def test_a_folder_of_more_files_than_recordings_have_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.inspection.inspect.MAX_FILES", 3)
    for number in range(5):
        (tmp_path / f"{number}.txt").write_text("x")
    with pytest.raises(RecordingError, match="more than 3 files"):
        inspect(tmp_path)


def test_a_place_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="no such file or folder"):
        inspect(tmp_path / "nothing")


DAMAGED = [name for name in FORMATS if "/" not in name and not name.startswith(("take", "notes"))]


@pytest.mark.parametrize("name", DAMAGED)
@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_anywhere_is_told_and_never_raised(zoo, tmp_path, name, data):
    content = bytearray((zoo / name).read_bytes())
    cut = data.draw(st.integers(0, len(content)))
    place = data.draw(st.integers(0, len(content) - 1))
    content[place : place + 4] = data.draw(st.binary(min_size=0, max_size=6))
    (tmp_path / name).write_bytes(content[:cut])
    (finding,) = inspect(tmp_path / name)
    json.loads(as_json([finding]))
    as_table([finding], tmp_path)


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    content=st.binary(max_size=400),
    suffix=st.sampled_from(["csv", "c3d", "png", "pcd", "ply", "bag", "db3", "mcap", "yaml", "urdf", "txt"]),
)
def test_bytes_of_any_kind_are_told_and_never_raised(tmp_path, content, suffix):
    (tmp_path / f"a.{suffix}").write_bytes(content)
    (finding,) = inspect(tmp_path / f"a.{suffix}")
    assert finding.file.name == f"a.{suffix}"


# --- as a person and a program see it


def test_the_table_has_one_line_for_recordings_that_differ_in_a_number(tmp_path):
    for number in range(12):
        rows_file(tmp_path, "rigidbody,Hand,1,0", *(f"frame,{k},{k / 100:.6f},1,1,{k},0,1,0,0,0,1,0,0,0,0" for k in range(9)))
        (tmp_path / "rows.csv").rename(tmp_path / f"take_{number}.csv")
    lines = as_table(inspect(tmp_path), tmp_path).splitlines()
    assert lines[0].split() == ["recording", "format", "rate", "unit", "duration", "lost", "holds"]
    assert lines[2].startswith("take_*.csv (12)") and lines[3].startswith("    ? the file does not say the unit of its lengths")
    assert len(lines) == 4


def test_the_json_has_every_recording_with_its_questions(zoo, found):
    read = json.loads(as_json(inspect(zoo)))
    assert len(read) == len(found)
    image = next(entry for entry in read if entry["file"].endswith("single.png"))
    assert image["open"][0].keys() == {"question", "option"} and image["facts"]["values"] == [1000.0, 1000.0]


SAMPLES = Path(__file__).parents[3] / "shared/samples"


@pytest.mark.skipif(not SAMPLES.is_dir(), reason="the recordings that real instruments wrote are not beside the project")
def test_files_that_real_instruments_wrote_are_told_apart():
    found = {finding.file.name: finding for finding in inspect(SAMPLES)}
    assert {name: finding.version for name, finding in found.items() if name.startswith("motive")} == {
        "motive_v1.1_rigidbody.csv": "1.1", "motive_v1.21_rigidbody.csv": "1.21", "motive_v1.23_rigidbody.csv": "1.23",
        "motive_v1.23_empty.csv": "1.23", "motive_v1.23_markers_millimetres.csv": "1.23",
    }  # fmt: skip
    assert [name for name, finding in found.items() if finding.stops] == ["motive_v1.23_empty.csv"]
    assert found["motive_v1.23_markers_millimetres.csv"].units == {"length": "mm"}
    assert found["motive_v1.1_rigidbody.csv"].open[0][1] == "dataset.mocap.unit"
    assert found["daqft_dotnet_semicolon.csv"].rate == 62.5 and found["daqft_dotnet_semicolon.csv"].facts["decimal"] == ","
    assert found["kinect2_ir_intrinsics.yaml"].facts["fx"] == pytest.approx(366.95, abs=0.01)
