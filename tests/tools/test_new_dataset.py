"""The two files of a new dataset: values that its recordings state, ??? for the others; given,
suggested and asked answers, each checked at once; the motion by its number.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest
from motive_files import START, random_take, rows_file
from new_datasets import contains, run, unfilled, write_takes, written
from omegaconf import OmegaConf
from ros_bags import camera_info, image, write_bag
from source_code import ROOT

from pipeline.configuration import config, datasheet
from pipeline.formats.depth.image import write_depth, write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics
from pipeline.formats.force.daqft import ForceRecord, write_daqft


@pytest.fixture
def exports(tmp_path) -> Path:
    """Takes of motion capture, two of which a depth camera saw, and a force log."""
    folder = tmp_path / "exports"
    write_takes(
        folder / "mocap",
        "fit_1",
        "fit_2",
        "fit_3",
        "hold_1",
        "hold_2",
        frames=21,
    )
    for name in ("hold_1", "hold_2"):
        (folder / "kinect" / name / "depth").mkdir(parents=True)
        files = tuple(f"depth/{number}.png" for number in range(3))
        for file in files:
            write_depth(
                folder / "kinect" / name / file,
                np.full((12, 16), 1000, np.uint16),
            )
        write_index(folder / "kinect" / name / "depth.txt", np.arange(3) / 30, files)
    write_intrinsics(
        folder / "kinect/camera.yaml",
        Intrinsics(20.0, 20.0, 8.0, 6.0, 16, 12),
    )
    values = np.random.default_rng(1).normal(size=(50, 3))
    record = ForceRecord(np.arange(50) / 100, values, values, 100.0, "FT1", START, {})
    (folder / "force").mkdir()
    write_daqft(folder / "force/C1.csv", record)
    return folder


@pytest.fixture
def space_exports(tmp_path) -> Path:
    """Takes of rigid bodies alone, with a controller's logs of their names, and a URDF."""
    folder = tmp_path / "space"
    takes = ("move_1", "move_2", "hold_1")
    write_takes(folder / "mocap", *takes, bodies=True)
    rows = [
        ",".join(f"{0.01 * k + column:.3f}" for column in range(4)) for k in range(9)
    ]

    (folder / "logs").mkdir()
    for take in takes:
        labels = "time,measured_a,measured_b,target_a"
        (folder / f"logs/{take}.csv").write_text("\n".join([labels, *rows, ""]))
    shutil.copy(ROOT / "pipeline/arm/lwr4.urdf", folder / "robot.urdf")
    return folder


def require_known_keys() -> None:
    """Every key of the written files is one that a dataset has."""
    values = OmegaConf.to_container(OmegaConf.merge(*reversed(written())))
    assert datasheet.check_values(values)[1] == []


def test_what_the_recordings_state_is_filled_in_and_the_rest_is_asked_for(
    root,
    exports,
    capsys,
):
    shutil.copy(ROOT / "pipeline/arm/youbot.urdf", exports / "robot.urdf")
    whole = (exports / "force/C1.csv").read_text()
    # without samples
    (exports / "force/C2.csv").write_text(whole[: whole.index("\n") + 1])
    run("lab", "--from", exports)
    sheet, option = written()
    require_known_keys()
    assert sheet["recordings"] == "../exports"
    assert contains(
        sheet["mocap"],
        {"training": "mocap/fit_*.csv", "test": "mocap/hold_*.csv"},
    )
    assert sheet["mocap"]["markers"] == {
        f"Link{n}": {f"Link{n}:Marker{k}": "???" for k in (1, 2, 3)} for n in (1, 2, 3)
    }

    depth = {
        "takes": "kinect/hold_*",
        "index": "depth.txt",
        "intrinsics": "kinect/camera.yaml",
    }
    assert contains(sheet["depth"], depth | {"width": 16, "height": 12, "rate": 30.0})
    assert [*sheet["force"]["configurations"]] == ["C1"]
    assert sheet["force"]["log"] == {"format": "daqft"}
    assert option["motion"] == {"rate": 100, "steps": 20}

    robot = {"urdf": "../exports/robot.urdf", "tool": "arm_tool", "locked": "???"}
    robot["joints"] = ["arm_joint_2", "arm_joint_3", "arm_joint_4"]
    assert contains(option["robot"], robot)

    asked = {"about.licence", "depth.encoding", "force.configurations.C1.tension"}
    assert asked <= unfilled() and "mocap.unit" not in unfilled()
    for file in (datasheet.path_of("lab"), config.CONF / "dataset/lab.yaml"):
        for line in file.read_text().splitlines():
            assert (
                "???" not in line or " # " in line.partition("???")[2] or line[0] == "#"
            ), line
    printed = capsys.readouterr().out.splitlines()
    assert "1 files not placed" in printed[0] and printed[1].endswith(
        "data/raw/lab/dataset.yaml",
    )

    count = len(unfilled())
    assert printed[-2].startswith(
        f"new-dataset: {count} values are open: about.subject",
    )
    assert printed[-1].startswith("next: `python -m pipeline new-dataset lab --ask`")
    stage = OmegaConf.load(root / "data/raw/lab/dvc.yaml").stages.inventory
    assert stage.outs == [
        {"data/raw/lab/inventory.csv": {"cache": False, "persist": True}},
    ]


def test_rigid_bodies_follow_an_arm_in_space_and_logs_named_as_takes_are_its_encoders(
    root,
    space_exports,
):
    run("lab", "--from", space_exports)
    sheet, option = written()
    require_known_keys()

    (body,) = random_take(9).bodies
    mount = {"position": "???", "rpy": "???"}
    assert sheet["mocap"]["bodies"] == {body: {"name": body, "mount": mount}}
    assert contains(
        sheet["encoders"],
        {"time": "time", "actual": ["measured_a", "measured_b"]},
    )
    assert (
        "one of logs/hold_*.csv, logs/move_*.csv"
        in datasheet.path_of("lab").read_text()
    )
    assert option["measurement"] == "encoders" and len(option["robot"]["joints"]) == 7
    assert "plane" not in option["robot"] and "joint_log" not in option

    # without a test take, the test part of the encoders is open
    for file in space_exports.rglob("hold_1.csv"):
        file.unlink()
    run("parts", "--from", space_exports)
    parts = {"training": "logs/move_*.csv", "test": "???"}
    assert contains(written("parts")[0]["encoders"], parts)

    # control: a log of another name is a table of something else
    for log in (space_exports / "logs").iterdir():
        log.rename(log.with_stem(f"other_{log.stem}"))
    write_takes(space_exports / "mocap", "move_1", "move_2")
    run("markers", "--from", space_exports)
    sheet, option = written("markers")
    assert "encoders" not in sheet and "bodies" not in sheet["mocap"]
    assert "measurement" not in option


def test_numbered_frames_and_bags_are_takes_and_several_topics_a_choice(root, exports):
    for name in ("hold_1", "hold_2"):
        (exports / "kinect" / name / "depth.txt").unlink()
    run("lab", "--from", exports)
    numbered = {"takes": "kinect/hold_*", "frames": "depth/[0-9]*.png", "rate": "???"}
    assert contains(written()[0]["depth"], numbered)

    shutil.rmtree(exports / "kinect")
    info = camera_info([20, 0, 8, 0, 20, 6, 0, 0, 1], [0] * 5, (16, 12))
    frames = [
        (k / 10, image(np.full((12, 16), 900, np.uint16), 1 + k / 10)) for k in range(3)
    ]
    for topics, topic in ((["/depth"], "/depth"), (["/depth", "/infrared"], "???")):
        shutil.rmtree(exports / "bags", ignore_errors=True)
        (exports / "bags").mkdir()
        for name in ("hold_1", "hold_2"):
            recorded = {topic: frames for topic in topics} | {"/info": [(0.0, info)]}
            bag = write_bag(exports / "bags", "ros1", recorded)
            bag.rename(bag.with_stem(name))
        run(f"bags_{len(topics)}", "--from", exports)
        depth = written(f"bags_{len(topics)}")[0]["depth"]
        bags = {"takes": "bags/hold_*.bag", "topic": topic, "camera_info": "/info"}
        assert contains(depth, bags) and "index" not in depth


def test_units_groups_and_steps_that_nothing_settles_are_asked_for(
    root,
    exports,
    tmp_path,
):
    (tmp_path / "old").mkdir()
    rows = [f"frame,{k},{k / 100:.6f},1,1,{k},0,1,0,0,0,1,0,0,0,0" for k in range(9)]
    rows_file(tmp_path / "old", "rigidbody,Hand,1,0", *rows)
    run("old", "--from", tmp_path / "old")
    mocap = written("old")[0]["mocap"]
    assert contains(mocap, {"unit": "???", "training": "rows.csv", "test": None})

    write_takes(tmp_path / "takes", "slow_1", "slow_2", "fast_1", "fast_2")
    run("two", "--from", tmp_path / "takes")
    assert contains(written("two")[0]["mocap"], {"training": "???", "test": "???"})

    write_takes(exports / "mocap", "fit_4", frames=31)
    run("lab", "--from", exports)
    assert written()[1]["motion"] == {"rate": 100, "steps": "???"}


def test_labelled_tables_are_joint_logs_only_if_their_labels_say_it(root, tmp_path):
    labels = [
        "t (s)",
        *(f"{word}_{j} (deg)" for word in ("measured", "target") for j in (1, 2)),
    ]
    rows = [",".join(f"{0.01 * k + c:.3f}" for c in range(5)) for k in range(9)]
    for place, header in (("runs", ",".join(labels)), ("others", "t,a,b,c,d")):
        (tmp_path / place).mkdir()
        for number in (1, 2):
            (tmp_path / place / f"run_{number}.csv").write_text(
                "\n".join([header, *rows, ""]),
            )
        shutil.copy(ROOT / "pipeline/arm/youbot.urdf", tmp_path / place / "arm.urdf")
        run(place, "--from", tmp_path / place)
    # five joints, a pose has six rows
    assert written("runs")[1]["robot"]["task"] == "???"

    log = written("runs")[0]["joint_log"]
    expected = {
        "movements": "run_*.csv",
        "time": "t (s)",
        "time_unit": "s",
        "angle_unit": "deg",
    }
    assert contains(log, expected)
    assert log["signals"] == {"actual": labels[1:3], "target": labels[3:]}
    assert "joint_log" not in written("others")[0]
    # a given answer replaces what the labels state
    run("given", "--from", tmp_path / "runs", "--set", "joint_log.time_unit=ms")
    assert written("given")[0]["joint_log"]["time_unit"] == "ms"
