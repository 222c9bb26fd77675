"""What inspect says of a recording of every format."""

from __future__ import annotations

import pytest

from pipeline.tools.inspect.examine import inspect

FORMATS = {
    "columns.csv": "Motive CSV",
    "rows.csv": "Motive CSV",
    "take.c3d": "C3D",
    "points.csv": "ATI DAQ F/T log",
    "commas.csv": "ATI DAQ F/T log",
    "netft.csv": "ATI Net F/T log",
    "FT7.cal": "ATI calibration",
    "single.png": "depth image",
    "metres.tiff": "depth image",
    "indexed/depth.txt": "depth sequence with index",
    "numbered/[0-9]*.png": "depth sequence, numbered",
    "camera.yaml": "camera intrinsics",
    "sized.json": "camera intrinsics",
    "cloud.ply": "point cloud",
    "cloud.pcd": "point cloud",
    "ros1/take.bag": "ROS bag",
    "sqlite3/take": "ROS bag",
    "mcap/take": "ROS bag",
    "q.csv": "table of numbers",
    "path.csv": "commanded trajectory",
    "three.urdf": "URDF",
    "dataset.yaml": "datasheet",
    "notes.md": "unknown",
    "payload.pkl": "unknown",
}


def test_every_format_is_named_and_every_file_accounted_for(findings):
    assert {name: finding.format for name, finding in findings.items()} == FORMATS
    assert [name for name, finding in findings.items() if finding.stops] == []


@pytest.mark.parametrize("name", [name for name in FORMATS if "[" not in name])
def test_a_file_alone_is_what_it_is_in_its_folder(zoo, findings, name):
    (alone,) = inspect(zoo / name)
    assert alone == findings[name]


def test_motion_takes_say_version_rate_unit_duration_names_and_gaps(findings):
    take = findings["columns.csv"]
    assert (take.version, take.rate, take.units, take.duration) == (
        "1.23",
        100.0,
        {"length": "m"},
        0.49,
    )
    assert (len(take.markers), take.bodies, take.gaps, take.open) == (
        9,
        ["Base"],
        {"missing_samples": 5},
        [],
    )
    assert (findings["take.c3d"].units, findings["take.c3d"].markers) == (
        {"length": "mm"},
        ["A", "B", "C"],
    )


def test_a_unit_that_no_file_states_is_a_question_with_its_option(findings):
    take = findings["rows.csv"]
    assert (take.version, take.units, take.bodies) == ("1.1", {"length": "not stated"}, ["Hand"])
    assert [option for _, option in take.open] == ["dataset.mocap.unit"]
    assert take.facts["rate_from"] == "the printed times: the file states none" and take.rate == 120


def test_force_logs_say_their_locale_rate_and_units(findings):
    for name, separator, decimal in (("points.csv", ",", "."), ("commas.csv", ";", ",")):
        log = findings[name]
        assert (log.facts["separator"], log.facts["decimal"], log.rate, log.duration) == (
            separator,
            decimal,
            100.0,
            4.99,
        )
        assert (log.units, log.facts["serial"], log.open) == (
            {"force": "N", "torque": "N-m"},
            "FT7",
            [],
        )
    assert findings["netft.csv"].rate == 100.0 and findings["netft.csv"].units == {
        "force": "N",
        "torque": "N-m",
    }
    assert findings["FT7.cal"].facts["ratings"]["fz"] == 3.0


def test_whole_numbers_between_commas_are_a_question(tmp_path):
    (tmp_path / "t.csv").write_text("1,5,2,5\n" * 5)
    (log,) = inspect(tmp_path)
    assert (
        log.format == "table of numbers"
        and "separator" in log.open[0][1]
        and "columns" not in log.facts
    )


def test_the_unit_of_depth_is_a_question_that_shows_the_values(findings):
    image, sequence = findings["single.png"], findings["indexed/depth.txt"]
    assert (image.version, image.facts["width"], image.facts["values"], image.units) == (
        "16 bits",
        32,
        [1000.0, 1000.0],
        {},
    )
    for finding in (
        image,
        sequence,
        findings["metres.tiff"],
        findings["numbered/[0-9]*.png"],
        findings["mcap/take"],
    ):
        assert "dataset.depth.units_per_metre" in [option for _, option in finding.open]
    assert (sequence.facts["frames"], sequence.rate, sequence.gaps) == (
        4,
        10.0,
        {"dropped_frames": 1},
    )
    assert "dataset.depth.rate" in [option for _, option in findings["numbered/[0-9]*.png"].open]


def test_intrinsics_say_their_size_or_that_they_do_not(findings):
    assert (findings["sized.json"].facts["width"], findings["sized.json"].open) == (32, [])
    assert (
        "width" not in findings["camera.yaml"].facts and findings["camera.yaml"].facts["cx"] == 16.0
    )
    assert [option for _, option in findings["camera.yaml"].open] == [
        "dataset.depth.width, .height"
    ]


@pytest.mark.parametrize(
    ("name", "version"),
    [("ros1/take.bag", "ROS 1"), ("sqlite3/take", "ROS 2"), ("mcap/take", "ROS 2")],
)
def test_bags_say_their_topics_and_ask_which_of_several(findings, name, version):
    bag = findings[name]
    assert bag.version == version and abs(bag.duration - 0.2) < 1e-6
    assert bag.facts["topics"]["/depth"] == {"type": "sensor_msgs/msg/Image", "messages": 3}
    assert ("several topics could be meant: /depth, /other", "dataset.depth.topic") in bag.open


def test_a_table_says_what_can_be_seen_and_asks_what_it_is(findings):
    table = findings["q.csv"]
    assert (table.rate, table.units, table.facts["columns"], table.facts["step_of_column_0"]) == (
        None,
        {},
        7,
        0.008,
    )
    assert "dataset.joint_log" in table.open[0][1]
