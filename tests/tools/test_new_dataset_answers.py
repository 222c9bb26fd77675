"""Open values of a new dataset: answers that are given, suggested or asked for, each checked at
once; the motion by its number.
"""

import builtins
import os
import shutil
from itertools import permutations
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from case_tables import cases_beside
from joint_logs import there_and_back
from new_datasets import UR5, contains, run, unfilled, written
from source_code import ROOT

from pipeline.__main__ import tool_call
from pipeline.configuration import datasheet
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.recordings.motions import FoundMotion
from pipeline.tools.new_dataset import command

cases = cases_beside(__file__)


@pytest.mark.slow
def test_what_is_left_is_asked_for_and_each_answer_is_checked_at_once(
    root,
    logs,
    monkeypatch,
    capsys,
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


START = np.array([0.1, 0.4, -0.3, -1.2, 0.5, 0.6, 0.2])  # rad
END = START + np.array([0.5, 0.3, -0.4, 0.5, 0.3, -0.4, 0.6])


def write_foreign_logs(folder: Path) -> None:
    """Write logs in degrees from 0 to 360 of seven joints, with labels that state neither units nor
    the URDF's names, and the URDF.
    """
    folder.mkdir()
    shutil.copy(ROOT / "pipeline/arm/lwr4.urdf", folder / "gen3.urdf")

    commanded = there_and_back(START, END, rest=40, times=2)
    rows = np.arange(len(commanded))
    late = commanded[np.maximum(rows - 2, 0)]

    labels = [f"position_joint_{joint}" for joint in range(1, 8)]
    labels += [f"position_command_joint_{joint}" for joint in range(1, 8)]
    for number in (1, 2):
        deviation = 1e-3 * np.sin(rows / (9 + number))
        measured = late + deviation[:, None]
        angles = np.rad2deg(np.hstack([measured, commanded])) % 360
        table = pd.DataFrame(angles, columns=labels)
        table.insert(0, "time", rows * 0.01)
        table.to_csv(folder / f"take_{number}.csv", index=False, float_format="%.5f")


@pytest.mark.slow
def test_logs_with_foreign_labels_need_eight_questions_and_no_motion_is_printed_twice(
    root,
    tmp_path,
    monkeypatch,
    capsys,
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
        ConfigError,
        match=r"motion.rate is 100: set motion.rate to \{key: value",
    ):
        run("lab", "--set", "motion.rate.unit=Hz")


ORDERS = [*permutations(["tool", "joints", "task"])]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("exists", [True, False])
def test_values_that_depend_on_each_other_are_set_together_in_any_order(
    root,
    logs,
    order,
    exists,
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


@cases("refused")
def test_an_option_name_or_folder_that_does_not_fit_writes_nothing(
    root,
    logs,
    words,
    said,
):
    with pytest.raises(PipelineError, match=said):
        run(*(words if "--from" in words else [*words, "--from", logs]))
    with pytest.raises(ConfigError, match=r"make it with --from|cannot name"):
        run(words[0], "--ask")

    files = [file for file in root.rglob("*") if file.is_file()]
    assert files == [root / "params.yaml"]


def test_motions_through_a_singular_pose_or_made_once_are_offered_last(monkeypatch):
    def motion(steps: int, places: list, least_singular: float) -> FoundMotion:
        ends = np.zeros(2), np.ones(2)
        return FoundMotion(*ends, steps, None, places, [], least_singular)

    twice = [("a", 0), ("a", 9)]
    once = [("a", 0)]
    motions = [motion(0, twice, 1e-3), motion(1, once, 1.0), motion(2, twice, 0.9)]
    dataset = SimpleNamespace(robot=None, motion=SimpleNamespace(rate=1.0))
    monkeypatch.setattr(command, "find_motions", lambda *_: motions)
    monkeypatch.setattr(command, "validated", lambda *_: dataset)
    monkeypatch.setattr(command, "read_movements", lambda *_: {})
    values = {"robot": {"joints": ["a", "b"]}, "motion": {"rate": 1}}
    values |= {"name": "", "recordings": "", "joint_log": {}}

    offered = command.motions_in_logs(values)

    assert [motion.steps for motion in offered] == [2, 0, 1]


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
