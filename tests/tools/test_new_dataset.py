"""The two files of a new dataset: values that its recordings state, ??? for the others; given,
suggested and asked answers, each checked at once; the motion by its number.
"""

import builtins
import os
import re
import shutil
from itertools import permutations
from pathlib import Path
from types import SimpleNamespace

import joint_kinds
import numpy as np
import pandas as pd
import pytest
from motive_files import START, random_take, rows_file
from omegaconf import OmegaConf
from ros_bags import camera_info, image, write_bag
from source_code import ROOT

from pipeline.__main__ import tool_call
from pipeline.configuration import config, datasheet
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.formats.depth.image import write_depth, write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics
from pipeline.formats.force.daqft import ForceRecord, write_daqft
from pipeline.formats.motion.motive import write_motive
from pipeline.formats.trajectory import write_trajectory
from pipeline.recordings.runs import FoundMotion
from pipeline.tools.new_dataset import command

UR5 = ROOT / "pipeline/arm/ur5.urdf"


def run(*words: object) -> None:
    tool_call("new_dataset", [*map(str, words)])()


def write_takes(
    folder: Path, *names: str, frames: int = 9, bodies: bool = False
) -> None:
    """Takes of motion capture, of markers or of rigid bodies alone."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        take = random_take(frames, body=bodies)
        if bodies:
            take.markers.clear()
        write_motive(folder / f"{name}.csv", take, start=START)


@pytest.fixture
def exports(tmp_path) -> Path:
    """Takes of motion capture, two of which a depth camera saw, and a force log."""
    folder = tmp_path / "exports"
    write_takes(
        folder / "mocap", "fit_1", "fit_2", "fit_3", "hold_1", "hold_2", frames=21
    )
    for name in ("hold_1", "hold_2"):
        (folder / "kinect" / name / "depth").mkdir(parents=True)
        files = tuple(f"depth/{number}.png" for number in range(3))
        for file in files:
            write_depth(
                folder / "kinect" / name / file, np.full((12, 16), 1000, np.uint16)
            )
        write_index(folder / "kinect" / name / "depth.txt", np.arange(3) / 30, files)
    write_intrinsics(
        folder / "kinect/camera.yaml", Intrinsics(20.0, 20.0, 8.0, 6.0, 16, 12)
    )
    values = np.random.default_rng(1).normal(size=(50, 3))
    record = ForceRecord(np.arange(50) / 100, values, values, 100.0, "FT1", START, {})
    (folder / "force").mkdir()
    write_daqft(folder / "force/C1.csv", record)
    return folder


@pytest.fixture
def space_exports(tmp_path) -> Path:
    """Takes of rigid bodies alone, with a controller's logs of their names, and a URDF."""
    folder, takes = tmp_path / "space", ("move_1", "move_2", "hold_1")
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


def written(name: str = "lab") -> tuple[dict, dict]:
    """Datasheet and option file, as plain data."""
    files = datasheet.path_of(name), config.CONF / f"dataset/{name}.yaml"
    return tuple(OmegaConf.to_container(OmegaConf.load(file)) for file in files)


def unfilled(name: str = "lab") -> set[str]:
    return {key for values in written(name) for key in datasheet.unfilled_keys(values)}


def contains(values: dict, part: dict) -> bool:
    return {key: values[key] for key in part} == part


def require_known_keys() -> None:
    """Every key of the written files is one that a dataset has."""
    values = OmegaConf.to_container(OmegaConf.merge(*reversed(written())))
    assert datasheet.check_values(values)[1] == []


def test_what_the_recordings_state_is_filled_in_and_the_rest_is_asked_for(
    root, exports, capsys
):
    shutil.copy(ROOT / "pipeline/arm/youbot.urdf", exports / "robot.urdf")
    whole = (exports / "force/C1.csv").read_text()
    (exports / "force/C2.csv").write_text(
        whole[: whole.index("\n") + 1]
    )  # without samples
    run("lab", "--from", exports)
    sheet, option = written()
    require_known_keys()
    assert sheet["recordings"] == "../exports"
    assert contains(
        sheet["mocap"], {"training": "mocap/fit_*.csv", "test": "mocap/hold_*.csv"}
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
        "data/raw/lab/dataset.yaml"
    )
    count = len(unfilled())
    assert printed[-2].startswith(
        f"new-dataset: {count} values are open: about.subject"
    )
    assert printed[-1].startswith("next: `python -m pipeline new-dataset lab --ask`")
    stage = OmegaConf.load(root / "data/raw/lab/dvc.yaml").stages.inventory
    assert stage.outs == [
        {"data/raw/lab/inventory.csv": {"cache": False, "persist": True}}
    ]


def test_rigid_bodies_follow_an_arm_in_space_and_logs_named_as_takes_are_its_encoders(
    root, space_exports
):
    run("lab", "--from", space_exports)
    sheet, option = written()
    require_known_keys()
    (body,) = random_take(9).bodies
    mount = {"position": "???", "rpy": "???"}
    assert sheet["mocap"]["bodies"] == {body: {"name": body, "mount": mount}}
    assert contains(
        sheet["encoders"], {"time": "time", "actual": ["measured_a", "measured_b"]}
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


SIX_JOINTS = [f"joint_{number}" for number in range(1, 7)]  # of the UR5
PARALLEL = SIX_JOINTS[1:4]


def write_command(file: Path, joints: list[str], rows: list[str]) -> None:
    """Write a commanded trajectory of 21 steps with columns of these joints and task rows."""
    columns = [f"q:{joint}" for joint in joints]
    columns += [f"{family}:{row}" for family in ("x", "v") for row in rows]
    commanded = pd.DataFrame(0.0, index=range(21), columns=["t", *columns])
    commanded["t"] = np.arange(21) / 100
    write_trajectory(file, commanded)


@pytest.mark.parametrize(
    ("urdf", "joints", "rows", "planar"),
    [
        ("ur5", SIX_JOINTS, [], False),
        ("ur5", [], ["x", "z", "phi"], True),
        ("ur5", None, None, False),  # a chain of three of its six joints is parallel
        ("lwr4", None, None, False),
    ],
)
def test_an_arm_with_markers_is_planar_only_if_its_joints_or_its_trajectory_say_so(
    root, tmp_path, urdf, joints, rows, planar
):
    takes = tmp_path / "takes"
    write_takes(takes, "fit_1", "fit_2")
    shutil.copy(ROOT / f"pipeline/arm/{urdf}.urdf", takes / "arm.urdf")
    if joints is not None:
        write_command(takes / "command.csv", joints, rows)
    run("lab", "--from", takes)
    robot = written()[1]["robot"]
    assert robot.get("plane", False) is planar
    expected = 3 if planar else {"ur5": 6, "lwr4": 7}[urdf]
    assert len(robot["joints"]) == expected


def test_the_joints_are_those_that_the_trajectory_commands(root, tmp_path):
    write_takes(tmp_path / "takes", "fit_1")
    shutil.copy(UR5, tmp_path / "takes/arm.urdf")
    write_command(tmp_path / "takes/command.csv", SIX_JOINTS[:5], [])
    run("lab", "--from", tmp_path / "takes")
    assert written()[1]["robot"]["joints"] == SIX_JOINTS[:5]


@pytest.mark.parametrize("exists", [True, False])
def test_a_planar_proposal_becomes_an_arm_in_space_by_one_command(
    root, tmp_path, exists
):
    takes = tmp_path / "takes"
    write_takes(takes, "fit_1")
    shutil.copy(UR5, takes / "arm.urdf")
    write_command(takes / "command.csv", [], ["x", "z", "phi"])
    in_space = ["robot.plane=false", f"robot.joints=[{', '.join(SIX_JOINTS)}]"]
    options = ["--set", in_space[0], "--set", in_space[1]]
    if exists:
        run("lab", "--from", takes)
        robot = written()[1]["robot"]
        assert robot["joints"] == PARALLEL and robot["locked"] == "???"
        run("lab", *options)
        # no joint is left to lock
        assert written()[1]["robot"]["locked"] == {}
    else:
        run("lab", "--from", takes, *options)
    robot = written()[1]["robot"]
    assert robot["plane"] is False and robot["joints"] == SIX_JOINTS
    assert "robot.locked" not in unfilled()


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
    root, exports, tmp_path
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
                "\n".join([header, *rows, ""])
            )
        shutil.copy(ROOT / "pipeline/arm/youbot.urdf", tmp_path / place / "arm.urdf")
        run(place, "--from", tmp_path / place)
    assert (
        written("runs")[1]["robot"]["task"] == "???"
    )  # five joints, a pose has six rows
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


UR_JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
NAMELESS = {  # labels of the measured and commanded angles: joints that are suggested, and a note
    "numbers": (joint_kinds.labels_of("q_#,q_cmd_#"), UR_JOINTS, "beyond the limits: none"),
    "other words": ([f"{signal}_{joint}" for signal in ("q", "q_cmd")
                     for joint in "hip knee ankle heel toe sole".split()], None,
                    "the logs name, in this order, hip, knee, ankle, heel, toe, sole"),
}  # fmt: skip


def named_urdf(file: Path, limit: float = 6.3) -> None:
    """A UR5 whose joints have the names of UR's drivers, with a ``limit`` of the elbow."""
    text = UR5.read_text()
    for number, joint in enumerate(UR_JOINTS, start=1):
        text = text.replace(f'"joint_{number}"', f'"{joint}_joint"')
    file.write_text(
        re.sub('(?s)(elbow_joint.*?upper=)"[^"]*"', rf'\1"{limit}"', text, count=1)
    )


@pytest.mark.parametrize("kind", [k for k in joint_kinds.KINDS if k.number in ("19", "20")
                                  and not k.stops], ids=lambda kind: kind.number)  # fmt: skip
def test_joints_follow_the_names_in_the_logs_whatever_the_order_of_the_urdf(
    root, tmp_path, kind
):
    (tmp_path / "logs").mkdir()
    kind.make(tmp_path / "logs")
    named_urdf(tmp_path / "logs/arm.urdf")
    run("lab", "--from", tmp_path / "logs", "--suggested", "--set", "robot.tool=flange")
    assert written()[0]["joint_log"]["joints"] == [
        f"{joint}_joint" for joint in sorted(UR_JOINTS)
    ]


@pytest.mark.parametrize("labels", NAMELESS)
def test_without_names_the_limits_support_the_positions_and_other_names_contradict_them(
    root, tmp_path, labels
):
    columns, joints, note = NAMELESS[labels]
    (tmp_path / "logs").mkdir()
    head = ["time", *columns]
    joint_kinds.write(tmp_path / "logs/log.csv", head, *joint_kinds.motion())
    named_urdf(tmp_path / "logs/arm.urdf")
    run("lab", "--from", tmp_path / "logs", "--suggested", "--set", "robot.tool=flange")
    expected = [f"{joint}_joint" for joint in joints] if joints else "???"
    assert written()[0]["joint_log"]["joints"] == expected
    assert note in datasheet.path_of("lab").read_text()
    # control: angles beyond a limit of the joint at their position
    named_urdf(tmp_path / "logs/arm.urdf", limit=0.2)
    run(
        "other",
        "--from",
        tmp_path / "logs",
        "--suggested",
        "--set",
        "robot.tool=flange",
    )
    assert written("other")[0]["joint_log"]["joints"] == "???"


@pytest.mark.slow
def test_what_is_left_is_asked_for_and_each_answer_is_checked_at_once(
    root, logs, monkeypatch, capsys
):
    run("lab", "--from", logs, "--set", "about.subject=an arm")
    text = datasheet.path_of("lab").read_text()
    assert "time_unit: ??? # suggested is s; " in text and "movements: No*_slow" in text
    robot = ["no.urdf", os.path.relpath(UR5), "nowhere", "flange"]
    log = ["[a, b]", "", "minutes", "s", "rad"]
    answers = iter([*robot, "the laboratory", "MIT", *log, "7", "2"])

    def answer(prompt: str) -> str:
        try:
            return next(answers)
        except StopIteration:
            raise EOFError from None

    monkeypatch.setattr(builtins, "input", answer)
    run("lab", "--ask")
    printed = capsys.readouterr().out
    refused = [line for line in printed.splitlines() if line.startswith("! ")]
    words = ["no.urdf", "nowhere", "not logged", "input should be", "no motion 7"]
    assert all(word in line for line, word in zip(refused, words, strict=True)), refused
    assert not unfilled(), [*answers]
    sheet, option = written()
    assert sheet["joint_log"]["time_unit"] == "s"
    # the URDF determines the joints, and the unit of the times the rate: they are not asked for
    assert "determined: robot.joints" in printed and len(option["robot"]["joints"]) == 6
    assert "determined: motion.rate: 100" in printed and option["motion"]["rate"] == 100
    assert printed.count("\nmotion 1: ") == 1
    assert printed.splitlines()[-1].startswith("next: `python -m pipeline check lab`")


def write_foreign_logs(folder: Path) -> None:
    """Write logs in degrees from 0 to 360 of seven joints that go there and back twice, with labels
    that state neither units nor the URDF's names, and the URDF.
    """
    start = np.array([0.1, 0.4, -0.3, -1.2, 0.5, 0.6, 0.2])
    end = start + np.array([0.5, 0.3, -0.4, 0.5, 0.3, -0.4, 0.6])
    shares = (1 - np.cos(np.pi * np.arange(1, 81) / 80))[:, None] / 2
    there, back = start + shares * (end - start), end + shares * (start - end)
    at_start, at_end = np.tile(start, (40, 1)), np.tile(end, (40, 1))
    commanded = np.vstack([at_start, *[there, at_end, back, at_start] * 2])
    time = np.arange(len(commanded)) * 0.01
    late = commanded[np.maximum(np.arange(len(commanded)) - 2, 0)]
    signals = ("position_joint", "position_command_joint")
    labels = ["time", *joint_kinds.numbered(*signals, first=1, count=7)]
    folder.mkdir()
    for number in (1, 2):
        deviation = 1e-3 * np.sin(np.arange(len(commanded)) / (9 + number))
        angles = np.rad2deg(np.hstack([late + deviation[:, None], commanded])) % 360
        rows = np.column_stack([time, angles])
        table = pd.DataFrame(rows, columns=labels)
        table.to_csv(folder / f"take_{number}.csv", index=False, float_format="%.5f")
    shutil.copy(ROOT / "pipeline/arm/lwr4.urdf", folder / "gen3.urdf")


@pytest.mark.slow
def test_logs_with_foreign_labels_need_eight_questions_and_no_motion_is_printed_twice(
    root, tmp_path, monkeypatch, capsys
):
    shutil.copytree(ROOT / "pipeline/conf", root / "conf", dirs_exist_ok=True)
    write_foreign_logs(tmp_path / "gen3")
    prompts = []
    answers = {"about.": "said", "motion: ": "1"}  # all others are suggested

    def answer(prompt: str) -> str:
        prompts.append(prompt)
        question = capsys.readouterr().out
        printed.append(question)
        last = question.strip().splitlines()[-1]
        return next((answers[key] for key in answers if last.startswith(key)), "")

    printed: list[str] = []
    monkeypatch.setattr(builtins, "input", answer)
    run("gen3", "--from", tmp_path / "gen3", "--ask")
    assert not unfilled("gen3")
    assert len(prompts) <= 8, prompts
    text = "".join(printed) + capsys.readouterr().out
    assert text.count("motion 1: ") == 1 and "suggested is" not in text
    tool_call("check", ["gen3"])()
    assert "no faults; next: " in capsys.readouterr().out


def test_a_value_that_is_set_or_not_yet_written_can_be_set(root, logs):
    run("lab", "--from", logs, "--suggested")
    assert written()[0]["joint_log"]["time_unit"] == "s"
    settings = (
        "joint_log.time_unit=ms",
        "joint_log.clock=rows",
        "limits.longest_gap=5",
        "limits.residual_rms=0.01",
    )
    run("lab", *(word for setting in settings for word in ("--set", setting)))
    sheet, option = written()
    assert contains(sheet["joint_log"], {"time_unit": "ms", "clock": "rows"})
    assert option["motion"]["rate"] == 100
    run("late", "--from", logs, "--suggested", "--set", "joint_log.time_unit=ms")
    assert written("late")[1]["motion"]["rate"] == 1e5
    with pytest.raises(ConfigError, match="'s', 'ms', 'us' or 'ns', got 'minutes'"):
        run("lab", "--set", "joint_log.time_unit=minutes")
    assert option["limits"] == {"residual_rms": 0.01, "longest_gap": 5}
    with pytest.raises(
        ConfigError, match=r"motion.rate is 100: set motion.rate to \{key: value"
    ):
        run("lab", "--set", "motion.rate.unit=Hz")


ORDERS = [*permutations(["tool", "joints", "task"])]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("exists", [True, False])
def test_values_that_depend_on_each_other_are_set_together_in_any_order(
    root, logs, order, exists
):
    joints = [f"joint_{number}" for number in range(1, 6)]
    stated = {
        "joints": f"[{', '.join(joints)}]",
        "tool": "wrist_2",
        "task": "[x, y, z]",
    }
    words = [f"robot.{key}={stated[key]}" for key in order]
    options = [option for word in words for option in ("--set", word)]
    urdf = ["--set", f"robot.urdf={ROOT / 'pipeline/arm/ur5.urdf'}"]
    if exists:
        run("lab", "--from", logs, *urdf)
        run("lab", *options)
    else:
        run("lab", "--from", logs, *urdf, *options)
    robot = written()[1]["robot"]
    assert (robot["joints"], robot["task"]) == (joints, ["x", "y", "z"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["lab", "--set", "robot.urdf"], "--set takes KEY=VALUE"),
        (["lab", "--set", "robot.pace=1"], "robot.pace"),
        (["lab", "--set", "pace=1"], "unknown key 'pace'"),
        (["lab", "--set", "robot=1"], "has parts: set robot.PART"),
        (["lab", "--set", "robot.urdf=no.urdf"], "no.urdf"),
        (["lab", "--motion", "1"], "to find the motions, first fill in robot.urdf"),
        (["lab", "--from", "nothing"], "no such folder"),
        *((([name]), "cannot name a dataset") for name in ("1st", "../up", "ü")),
    ],
)
def test_an_option_name_or_folder_that_does_not_fit_writes_nothing(
    root, logs, words, said
):
    with pytest.raises(PipelineError, match=said):
        run(*(words if "--from" in words else [*words, "--from", logs]))
    with pytest.raises(ConfigError, match=r"make it with --from|cannot name"):
        run(words[0], "--ask")
    assert [file for file in root.rglob("*") if file.is_file()] == [
        root / "params.yaml"
    ]


def test_motions_through_a_singular_pose_or_made_once_are_offered_last(monkeypatch):
    twice = [("a", 0), ("a", 9)]
    offered = [
        FoundMotion(np.zeros(2), np.ones(2), number, None, places, [], least)
        for number, (places, least) in enumerate(
            [(twice, 1e-3), (twice[:1], 1.0), (twice, 0.9)]
        )
    ]
    dataset = SimpleNamespace(robot=None, motion=SimpleNamespace(rate=1.0))
    for name, result in (
        ("find_motions", offered),
        ("validated", dataset),
        ("read_movements", {}),
    ):
        monkeypatch.setattr(command, name, lambda *_, result=result: result)
    values = {
        "robot": {"joints": ["a", "b"]},
        "motion": {"rate": 1},
        "name": "",
        "recordings": "",
    }
    found = command.motions_in_logs(values | {"joint_log": {}})
    assert [motion.steps for motion in found] == [2, 0, 1]


def test_nothing_is_overwritten(root, logs):
    for there in (root / "conf/dataset/lab.yaml", root / "data/raw/lab/dvc.yaml"):
        there.parent.mkdir(parents=True, exist_ok=True)
        there.write_text("mine\n")
        with pytest.raises(ConfigError, match="is not overwritten") as refused:
            run("lab", "--from", logs)
        assert refused.value.evidence["file"] == there
        files = {file for file in root.rglob("*") if file.is_file()}
        assert files == {there, root / "params.yaml"} and there.read_text() == "mine\n"
        there.unlink()
