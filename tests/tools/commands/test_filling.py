"""new-dataset fills in what it is told, takes what is suggested, asks for the rest and checks each
answer at once; the motion is chosen by its number.
"""

from __future__ import annotations

import builtins
import os
import time
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf
from written_logs import write_joint_log

from pipeline import arm
from pipeline.core import config, datasheet
from pipeline.core.errors import ConfigError
from pipeline.formats.joints.log import JointLog
from pipeline.tools.new_dataset.command import run

START = np.array([0.3, -1.2, 1.4, -1.0, -1.2, 0.2])
END = START + np.array([0.4, 0.3, -0.3, 0.2, 0.2, 0.5])


@pytest.fixture
def logs(root, tmp_path) -> Path:
    """Two movements of a UR5, each three times there and back, as a folder of three tables each."""
    way = (1 - np.cos(np.pi * np.arange(1, 81) / 80))[:, None] / 2
    there, back = START + way * (END - START), END + way * (START - END)
    rest = [np.tile(place, (30, 1)) for place in (END, START)]
    target = np.vstack([rest[1], *[there, rest[0], back, rest[1]] * 3])
    tables = {
        "q_actual": target,
        "q_target": target,
        "qd_target": np.diff(target, axis=0, prepend=target[:1]) / 0.01,
    }
    for name in ("No1_slow", "No2_slow"):
        (tmp_path / "logs" / name).mkdir(parents=True)
        for signal, rows in tables.items():
            log = JointLog(np.arange(len(rows)) / 100, {"actual": rows}, {})
            write_joint_log(tmp_path / "logs" / name / f"{signal}.csv", log)
    (tmp_path / "logs/LICENSE.txt").write_text("  MIT License\n\nCopyright\n")
    return tmp_path / "logs"


def written() -> dict:
    """Both files put together."""
    files = datasheet.path_of("lab"), config.CONF / "dataset/lab.yaml"
    return OmegaConf.to_container(OmegaConf.merge(*map(OmegaConf.load, files)))


def urdf() -> str:
    return os.path.relpath(Path(arm.__file__).with_name("ur5.urdf"))


@pytest.mark.slow
def test_options_suggestions_and_a_number_leave_nothing_open(logs, capsys):
    given = {"robot.urdf": urdf(), "robot.tool": "flange", "about.subject": "UR5: its way"}
    given |= {"about.source": "the laboratory"}
    words = [word for key, value in given.items() for word in ("--set", f"{key}={value}")]
    run(["lab", "--from", str(logs), *words, "--suggested", "--motion", "1"])
    values, joints = written(), [f"joint_{j}" for j in range(1, 7)]
    assert not [*datasheet.unfilled_keys(values)]
    assert values["about"]["subject"] == "UR5: its way"
    assert values["about"]["licence"] == "MIT License, Copyright"
    log = values["joint_log"]
    expected = {"movements": "No*_slow", "actual": "q_actual.csv", "target": "q_target.csv"}
    expected |= {"speed": "qd_target.csv", "time_unit": "s", "angle_unit": "rad"}
    assert {key: log[key] for key in expected} == expected
    assert (log["joints"], values["robot"]["joints"], values["motion"]["rate"]) == (
        joints,
        joints,
        100,
    )
    ends = [log["start"], log["end"]]
    np.testing.assert_allclose(sorted(ends), sorted([START.tolist(), END.tolist()]), atol=1e-3)
    assert values["motion"]["steps"] == 80 + 2 * log["rest"] and 0 < log["rest"] < 15
    table = [line for line in capsys.readouterr().out.splitlines() if line[:2] in ("1 ", "2 ")]
    assert len(table) == 2 and all("No1_slow (3), No2_slow (3)" in line for line in table)


@pytest.mark.slow
def test_what_is_left_is_asked_for_and_each_answer_is_checked_at_once(logs, monkeypatch, capsys):
    run(["lab", "--from", str(logs), "--set", "about.subject=an arm"])
    answers = iter(
        [
            *("no.urdf", urdf(), "", "nowhere", "flange", "the laboratory", "MIT"),
            *("[a, b]", "", "minutes", "s", "rad", "fast", "", "7", "2"),
        ]
    )
    durations, asked = [], time.process_time()

    def answer(prompt: str) -> str:
        nonlocal asked
        durations.append(time.process_time() - asked)
        try:
            said = next(answers)
        except StopIteration:
            raise EOFError from None
        asked = time.process_time()
        return said

    monkeypatch.setattr(builtins, "input", answer)
    run(["lab", "--ask"])
    refused = [line for line in capsys.readouterr().out.splitlines() if line.startswith("! ")]
    assert len(refused) == 6, refused
    for said, words in zip(
        refused,
        ["no.urdf", "nowhere", "not logged", "input should be", "fast", "no motion 7"],
        strict=True,
    ):
        assert words in said
    values = written()
    assert not [*datasheet.unfilled_keys(values)], [*answers]
    assert values["joint_log"]["time_unit"] == "s" and values["motion"]["rate"] == 100
    assert sorted(durations[1:])[len(durations) // 2] < 1.0  # s, the median


@pytest.mark.slow
def test_what_is_not_answered_stays_open_with_what_is_suggested(logs, monkeypatch):
    monkeypatch.setattr(builtins, "input", lambda prompt: "")
    run(["lab", "--from", str(logs), "--set", f"robot.urdf={urdf()}", "--set", "robot.tool=flange"])
    text = datasheet.path_of("lab").read_text()
    assert "movements: No*_slow" in text and "time_unit: ???" in text
    assert "→ suggested is s" in text and '→ suggested is "MIT License, Copyright"' in text
    run(["lab", "--ask"])
    assert {*datasheet.unfilled_keys(written())} == {
        *("about.subject", "about.source", "motion.steps"),
        *("joint_log.start", "joint_log.end", "joint_log.rest"),
    }
    assert datasheet.path_of("lab").read_text().count("suggested") == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "robot.urdf"], "--set takes KEY=VALUE"),
        (["--set", "robot.pace=1"], "no such value is still to be filled in; there are about"),
        (["--set", "robot.urdf=no.urdf"], "no.urdf"),
        (["--motion", "1"], "the motions are found once these are filled in: joint_log.joints"),
    ],
)
def test_an_option_that_does_not_fit_writes_nothing(logs, root, words, said):
    with pytest.raises(ConfigError, match=said):
        run(["lab", "--from", str(logs), *words])
    assert not datasheet.path_of("lab").exists()


def test_there_is_nothing_to_go_on_with_before_the_files_are_there(root):
    with pytest.raises(ConfigError, match="make it with --from FOLDER"):
        run(["lab", "--ask"])


def test_one_labelled_table_a_movement_is_a_joint_log(root, tmp_path):
    labels = ["t (s)", *(f"{word}_{j} (deg)" for word in ("measured", "target") for j in (1, 2))]
    rows = [",".join(f"{0.01 * k + c:.3f}" for c in range(5)) for k in range(9)]
    (tmp_path / "runs").mkdir()
    for number in (1, 2):
        text = "\n".join([",".join(labels), *rows, ""])
        (tmp_path / f"runs/run_{number}.csv").write_text(text)
    run(["lab", "--from", str(tmp_path / "runs")])
    log = written()["joint_log"]
    assert (log["movements"], log["time"], log["time_unit"], log["angle_unit"]) == (
        *("run_*.csv", "t (s)"),
        *("s", "deg"),
    )
    assert log["signals"] == {"actual": labels[1:3], "target": labels[3:]}
    # the control: labels that do not say it leave the tables where they are
    (tmp_path / "others").mkdir()
    for number in (1, 2):
        text = "\n".join(["t,a,b,c,d", *rows, ""])
        (tmp_path / f"others/run_{number}.csv").write_text(text)
    run(["other", "--from", str(tmp_path / "others")])
    assert "joint_log" not in OmegaConf.load(datasheet.path_of("other"))
