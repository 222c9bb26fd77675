"""Answers to what a new dataset leaves open: given, suggested or asked for, each checked at once;
the motion by its number.
"""

from __future__ import annotations

import builtins
import os
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf
from source_code import ROOT

from pipeline.core import config, datasheet
from pipeline.core.errors import ConfigError
from pipeline.tools.new_dataset.command import run, write_datasheet

FROM, TO = [0.3, -1.2, 1.4, -1.0, -1.2, 0.2], [0.7, -0.9, 1.1, -0.8, -1.0, 0.7]  # rad


def written(name: str = "lab") -> tuple[dict, dict]:
    """Datasheet and option file, as plain data."""
    files = datasheet.path_of(name), config.CONF / f"dataset/{name}.yaml"
    return tuple(OmegaConf.to_container(OmegaConf.load(file)) for file in files)


def unfilled(name: str = "lab") -> set[str]:
    return {key for values in written(name) for key in datasheet.unfilled_keys(values)}


def urdf() -> str:
    return os.path.relpath(ROOT / "pipeline/arm/ur5.urdf")


def contains(values: dict, part: dict) -> bool:
    return {key: values[key] for key in part} == part


@pytest.mark.slow
def test_options_suggestions_and_a_number_leave_nothing_open(root, logs, capsys):
    given = {
        "robot.tool": "flange",
        "joint_log.speed": "null",
        "about.subject": "UR5: its way",
        "about.source": "the lab",
    }
    left = write_datasheet("lab", logs, given, urdf=Path(urdf()), suggested=True, motion=1)
    assert not left and not unfilled()
    sheet, option = written()
    joints = [f"joint_{j}" for j in range(1, 7)]
    assert sheet["about"] == {
        "subject": "UR5: its way",
        "source": "the lab",
        "licence": "MIT License, Copyright",
    }
    tables = {"actual": "q_actual.csv", "target": "q_target.csv", "speed": None}
    expected = {"movements": "No*_slow", "time_unit": "s", "angle_unit": "rad", "joints": joints}
    assert contains(sheet["joint_log"], expected | tables)
    assert "# not placed: LICENSE.txt, rest_3/force.csv" in datasheet.path_of("lab").read_text()
    assert (option["robot"]["joints"], option["motion"]["rate"]) == (joints, 100)
    log = option["joint_log"]
    ends = sorted([log["start"], log["end"]])
    np.testing.assert_allclose(ends, sorted([FROM, TO]), atol=1e-3)
    assert option["motion"]["steps"] == 80 + 2 * log["rest"] and 0 < log["rest"] < 15
    assert capsys.readouterr().out.count("No1_slow (3), No2_slow (3)") == 2


@pytest.mark.slow
def test_what_is_left_is_asked_for_and_each_answer_is_checked_at_once(
    root, logs, monkeypatch, capsys
):
    run(["lab", "--from", str(logs), "--set", "about.subject=an arm"])
    text = datasheet.path_of("lab").read_text()
    assert "time_unit: ???" in text and "→ suggested is s" in text
    answers = iter(
        [
            *("no.urdf", urdf(), "", "nowhere", "flange", "the laboratory", "MIT"),
            *("[a, b]", "", "minutes", "s", "rad", "fast", "", "7", "2"),
        ]
    )

    def answer(prompt: str) -> str:
        try:
            return next(answers)
        except StopIteration:
            raise EOFError from None

    monkeypatch.setattr(builtins, "input", answer)
    run(["lab", "--ask"])
    refused = [line for line in capsys.readouterr().out.splitlines() if line.startswith("! ")]
    words = ["no.urdf", "nowhere", "not logged", "input should be", "fast", "no motion 7"]
    assert all(word in line for line, word in zip(refused, words, strict=True)), refused
    assert not unfilled(), [*answers]
    assert "suggested" not in datasheet.path_of("lab").read_text()
    assert written()[0]["joint_log"]["time_unit"] == "s" and written()[1]["motion"]["rate"] == 100


@pytest.mark.slow
def test_an_empty_answer_takes_the_suggestion_or_leaves_the_value_open(root, logs, monkeypatch):
    monkeypatch.setattr(builtins, "input", lambda prompt: "")
    run(["lab", "--from", str(logs), "--set", f"robot.urdf={urdf()}", "--set", "robot.tool=flange"])
    run(["lab", "--ask"])
    motion = {"motion.steps", "joint_log.start", "joint_log.end", "joint_log.rest"}
    assert unfilled() == {"about.subject", "about.source"} | motion


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["lab", "--set", "robot.urdf"], "--set takes KEY=VALUE"),
        (["lab", "--set", "robot.pace=1"], "no such value is still to be filled in; there are"),
        (["lab", "--set", "robot.urdf=no.urdf"], "no.urdf"),
        (["lab", "--motion", "1"], "the motions are found once these are filled in: joint_log"),
        *((([name]), "cannot name a dataset") for name in ("", "1st", "../up", "a b", "ü")),
    ],
)
def test_an_option_or_name_that_does_not_fit_writes_nothing(root, logs, words, said):
    with pytest.raises(ConfigError, match=said):
        run([*words, "--from", str(logs)])
    assert [file for file in root.rglob("*") if file.is_file()] == [root / "params.yaml"]
