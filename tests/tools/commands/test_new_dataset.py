"""The two files of a new dataset: what its recordings tell stands in them, the rest is asked for,
nothing is overwritten.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from motive_files import START, random_take, rows_file
from omegaconf import OmegaConf
from ros_bags import camera_info, image, write_bag

from pipeline import arm
from pipeline.__main__ import main
from pipeline.core import datasheet
from pipeline.core.datasheet import faults
from pipeline.formats.motion.motive import write_motive
from pipeline.tools.new_dataset.command import run


def written(root: Path, name: str) -> tuple[dict, dict]:
    """Datasheet and option file, as plain data."""
    files = (root / f"data/raw/{name}/dataset.yaml", root / f"conf/dataset/{name}.yaml")
    return tuple(OmegaConf.to_container(OmegaConf.load(file)) for file in files)


def test_what_the_recordings_tell_is_filled_in(root, exports):
    run(["lab", "--from", str(exports)])
    sheet, option = written(root, "lab")
    assert sheet["recordings"] == "../exports"
    assert (sheet["mocap"]["training"], sheet["mocap"]["test"]) == (
        "mocap/fit_*.csv",
        "mocap/hold_*.csv",
    )
    assert {link: list(markers) for link, markers in sheet["mocap"]["markers"].items()} == {
        f"Link{link}": [f"Link{link}:Marker{number}" for number in (1, 2, 3)] for link in (1, 2, 3)
    }
    result = {
        key: sheet["depth"][key]
        for key in ("takes", "index", "intrinsics", "width", "height", "rate")
    }
    assert result == {
        "takes": "kinect/hold_*",
        "index": "depth.txt",
        "intrinsics": "kinect/camera.yaml",
        "width": 16,
        "height": 12,
        "rate": 30.0,
    }
    assert sheet["force"]["configurations"]["C1"]["file"] == "force/C1.csv"
    assert option["motion"] == {"rate": 100, "steps": 20}


def test_what_no_file_states_is_asked_for(root, exports):
    run(["lab", "--from", str(exports)])
    unfilled = {
        *datasheet.unfilled(datasheet.path_of("lab")),
        *datasheet.unfilled(root / "conf/dataset/lab.yaml"),
    }
    assert {
        "about.licence",
        "mocap.base.rpy",
        "mocap.markers.Link1.Link1:Marker1",
        "depth.encoding",
        "depth.units_per_metre",
    } <= unfilled
    assert {
        "trajectory",
        "robot.urdf",
        "robot.joints",
        "force.kappa_bounds",
        "force.configurations.C1.tension",
    } <= unfilled
    assert "mocap.unit" not in unfilled


def test_a_robots_chain_is_taken_from_its_urdf_and_every_open_value_has_a_comment(root, exports):
    shutil.copy(Path(arm.__file__).parent / "youbot.urdf", exports / "robot.urdf")
    run(["lab", "--from", str(exports)])
    sheet, option = (root / "data/raw/lab/dataset.yaml", root / "conf/dataset/lab.yaml")
    robot = OmegaConf.load(option).robot
    assert (robot.urdf, robot.joints, robot.tool) == (
        "../exports/robot.urdf",
        ["arm_joint_2", "arm_joint_3", "arm_joint_4"],
        "arm_tool",
    )
    assert OmegaConf.is_missing(robot, "locked")  # the control: no file tells it
    for line in (sheet.read_text() + option.read_text()).splitlines():
        assert "???" not in line or " # " in line.partition("???")[2] or line.startswith("#"), line


def test_every_key_is_one_that_a_dataset_has(root, exports, joint_exports, request):
    for name, folder in (("lab", exports), ("arm", joint_exports), ("space", None)):
        folder = folder or request.getfixturevalue("space_exports")  # writes over exports
        run([name, "--from", str(folder)])
        sheet, option = written(root, name)
        sheet.pop("about")
        assert not list(datasheet._common(option, sheet, ""))
        values = OmegaConf.to_container(OmegaConf.merge(option, sheet))
        assert faults(values) == []
        assert faults(values | {"arm": 1})  # the control: a key that no dataset has


def test_joint_logs_of_a_controller_are_movements(root, joint_exports):
    run(["arm", "--from", str(joint_exports)])
    sheet, option = written(root, "arm")
    assert {
        key: sheet["joint_log"][key]
        for key in ("movements", "joints", "time", "actual", "target", "speed", "time_unit")
    } == {
        "movements": "move_*",
        "joints": "???",
        "time": 0,
        "actual": "q_measured.csv",
        "target": "q_commanded.csv",
        "speed": None,
        "time_unit": "???",
    }
    assert "# not placed: rest_3/force.csv" in datasheet.path_of("arm").read_text()
    assert "mocap" not in option and option["joint_log"]["start"] == "???"


def test_numbered_frames_are_found_below_the_folder_of_their_take(root, exports):
    for name in ("hold_1", "hold_2"):
        (exports / "kinect" / name / "depth.txt").unlink()
    run(["lab", "--from", str(exports)])
    depth = written(root, "lab")[0]["depth"]
    assert (depth["takes"], depth["frames"], depth["rate"]) == (
        "kinect/hold_*",
        "depth/[0-9]*.png",
        "???",
    )
    assert "index" not in depth


@pytest.mark.parametrize(
    ("topics", "topic"), [(["/depth"], "/depth"), (["/depth", "/infrared"], "???")]
)
def test_bags_are_takes_and_their_topics_a_choice_where_there_are_several(
    root, exports, topics, topic
):
    shutil.rmtree(exports / "kinect")
    (exports / "bags").mkdir()
    for name in ("hold_1", "hold_2"):
        frames = [(k / 10, image(np.full((12, 16), 900, np.uint16), 1 + k / 10)) for k in range(3)]
        info = camera_info([20, 0, 8, 0, 20, 6, 0, 0, 1], [0] * 5, (16, 12))
        bag = write_bag(
            exports / "bags", "ros1", {name: frames for name in topics} | {"/info": [(0.0, info)]}
        )
        bag.rename(bag.with_stem(name))
    run(["lab", "--from", str(exports)])
    sheet, _ = written(root, "lab")
    assert (sheet["depth"]["takes"], sheet["depth"]["topic"], sheet["depth"]["camera_info"]) == (
        "bags/hold_*.bag",
        topic,
        "/info",
    )
    assert "index" not in sheet["depth"] and sheet["mocap"]["test"] == "mocap/hold_*.csv"


def test_a_unit_that_the_files_do_not_state_is_asked_for(root, tmp_path):
    (tmp_path / "old").mkdir()
    rows_file(
        tmp_path / "old",
        "rigidbody,Hand,1,0",
        *(f"frame,{k},{k / 100:.6f},1,1,{k},0,1,0,0,0,1,0,0,0,0" for k in range(9)),
    )
    run(["old", "--from", str(tmp_path / "old")])
    sheet, _ = written(root, "old")
    assert (sheet["mocap"]["unit"], sheet["mocap"]["training"], sheet["mocap"]["test"]) == (
        "???",
        "rows.csv",
        None,
    )
    assert sheet["mocap"]["bodies"]["Hand"]["name"] == "Hand"


def test_groups_of_takes_that_nothing_tells_apart_are_a_choice(root, tmp_path):
    (tmp_path / "takes").mkdir()
    for name in ("slow_1", "slow_2", "fast_1", "fast_2"):
        write_motive(tmp_path / f"takes/{name}.csv", random_take(9, body=False), start=START)
    run(["two", "--from", str(tmp_path / "takes")])
    sheet, _ = written(root, "two")
    assert (sheet["mocap"]["training"], sheet["mocap"]["test"]) == ("???", "???")
    assert "one of fast_*.csv, slow_*.csv" in datasheet.path_of("two").read_text()


def test_takes_that_disagree_about_the_rate_leave_it_open(root, exports):
    write_motive(exports / "mocap/fit_4.csv", random_take(31, body=False), start=START)
    run(["lab", "--from", str(exports)])
    assert written(root, "lab")[1]["motion"] == {"rate": 100, "steps": "???"}


def test_names_that_yaml_or_a_pattern_would_read_otherwise_come_back_as_they_are(root, tmp_path):
    folder = tmp_path / "odd [1]"
    folder.mkdir()
    for number in (1, 2):
        take = random_take(9, body=False)
        take.markers.clear()
        take.markers.update(
            {
                name: random_take(9).markers["Link1:Marker1"]
                for name in ("no", "a: b", "#1", "1e3", '"q"', "ü")
            }
        )
        write_motive(folder / f"a[b] {number}.csv", take, start=START)
    run(["odd", "--from", str(folder)])
    sheet, _ = written(root, "odd")
    assert sorted(file.name for file in folder.glob(sheet["mocap"]["training"])) == [
        "a[b] 1.csv",
        "a[b] 2.csv",
    ]
    assert sheet["recordings"] == "../odd [1]"
    assert 'no", "a: b", "#1", "1e3"' in datasheet.path_of("odd").read_text()


def test_the_command_says_what_is_left_to_do(root, exports, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["pipeline", "new-dataset", "lab", "--from", str(exports)])
    assert main() == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "new-dataset: wrote data/raw/lab/dataset.yaml"
    assert said[-2].startswith("new-dataset: 30 values are open: about.subject, ")
    assert said[-1].endswith("`dataset: lab` in params.yaml, and run `python -m pipeline check`")
