"""check prints everything that is wrong with a dataset at once, and nothing where nothing is."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from motive_files import START as TAKEN
from motive_files import random_take
from source_code import ROOT
from written_logs import write_joint_log

from pipeline.__main__ import tool_call
from pipeline.core import config, datasheet
from pipeline.core.errors import ConfigError
from pipeline.formats.joints.log import JointLog
from pipeline.formats.motion.motive import write_motive

START, END = [0.3, -1.2, 1.4, -1.0, -1.2, 0.2], [0.7, -0.9, 1.1, -0.8, -1.0, 0.7]
SHEET = """\
about: {{subject: an arm, source: a test, licence: MIT}}
recordings: {folder}
joint_log:
  movements: run_*
  actual: q_actual.csv
  target: q_target.csv
  joints: [joint_1, joint_2, joint_3, joint_4, joint_5, joint_6]
"""
MOCAP = """\
mocap:
  training: take.csv
  test: null
  gate: 0.012
  max_gap: 20
  base: {position: [0.0, 0.0, 0.0], rpy: [0.0, 0.0, 0.0]}
  markers:
    flange:
      "Link1:Marker1": [0.0, 0.0, 0.0]
      "Link1:Marker2": [0.1, 0.0, 0.0]
      "Link1:Markr3": [0.0, 0.1, 0.0]
"""
OPTION = f"""\
name: lab
robot:
  urdf: {ROOT}/pipeline/arm/ur5.urdf
  joints: [joint_1, joint_2, joint_3, joint_4, joint_5, joint_6]
  tool: flange
motion: {{rate: 100.0, steps: 100}}
joint_log:
  start: {START}
  end: {END}
  rest: 10
  tolerance: 1.0e-4
"""


def run(words: list[str]) -> None:
    tool_call("check", words)()


@pytest.fixture
def files(tmp_path, monkeypatch) -> tuple[Path, Path]:
    """Datasheet and option file of the dataset lab, with which nothing is wrong."""
    shutil.copytree(config.CONF, tmp_path / "conf")
    monkeypatch.setattr(config, "CONF", tmp_path / "conf")
    monkeypatch.setattr(datasheet, "DATASHEETS", tmp_path / "raw")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").write_text("dataset: other\n")
    way = (1 - np.cos(np.pi * np.arange(1, 81) / 80))[:, None] / 2
    start, end = np.array(START), np.array(END)
    there, back = start + way * (end - start), end + way * (start - end)
    rest = [np.tile(place, (30, 1)) for place in (end, start)]
    target = np.vstack([rest[1], *[there, rest[0], back, rest[1]] * 3])
    for number in (1, 2):
        (tmp_path / f"logs/run_{number}").mkdir(parents=True)
        for name in ("q_actual", "q_target"):
            log = JointLog(np.arange(len(target)) / 100, {"actual": target}, {})
            write_joint_log(tmp_path / f"logs/run_{number}/{name}.csv", log)
    write_motive(tmp_path / "logs/take.csv", random_take(101, body=False), start=TAKEN)
    sheet, option = tmp_path / "raw/lab/dataset.yaml", tmp_path / "conf/dataset/lab.yaml"
    sheet.parent.mkdir(parents=True)
    sheet.write_text(SHEET.format(folder=tmp_path / "logs"))
    option.write_text(OPTION)
    return sheet, option


def edit(file: Path, old: str, new: str) -> None:
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))


def test_nothing_is_wrong_and_another_name_is_refused(files, capsys):
    run(["lab"])
    assert capsys.readouterr().out == "check: nothing is wrong with lab\n"
    with pytest.raises(ConfigError, match="no dataset 'nowhere'; there are"):
        run(["nowhere"])


def test_everything_that_is_wrong_is_printed_at_once(files, capsys):
    sheet, option = files
    edit(sheet, "a test", "'???'")
    edit(sheet, "logs\n", "walks\n")
    edit(sheet, "  actual: ", "  angle_unit: turns\n  actual: ")
    edit(option, "tool: flange", "tol: flange")
    edit(option, "rate: 100.0", "rate: fast")
    edit(option, "rest: 10", "rest: -1")
    edit(option, "  tolerance: 1.0e-4\n", "")
    with pytest.raises(ConfigError, match=r"^8 to be mended"):
        run(["lab"])
    said = capsys.readouterr().out
    keys = ("about.source", "key dataset.joint_log.angle_unit", "robot.tol", "walks")
    for key in (*keys, "key dataset.motion.rate", "key dataset.joint_log.rest", "tolerance"):
        assert said.count(key) == 1, key


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("run_*", "walk_*", "no folder or file of a movement matches"),
        ("q_actual.csv", "q.csv", "run_1/q.csv]; and 1 more, as"),
        ("joint_6]", "joint_7]", "joint_6 of robot.joints is not logged"),
        ("joint_log:", "joint_log:\n  angle_unit: deg", "no motion"),
        ("joint_log:", "joint_log:\n  rest: 10", "rest stands in lab.yaml too"),
        ("logs\n", f"logs\n{MOCAP}", "Link1:Markr3"),
    ],
)
def test_what_configure_and_ingest_would_refuse_is_printed(files, capsys, old, new, words):
    edit(files[0], old, new)
    with pytest.raises(ConfigError, match="to be mended"):
        run(["lab"])
    assert words in capsys.readouterr().out


def test_every_movement_that_cannot_be_read_is_named(files, capsys):
    for number in (1, 2):
        edit(files[0].parents[2] / f"logs/run_{number}/q_actual.csv", "0.300000", "0.3x")
    with pytest.raises(ConfigError, match=r"^1 to be mended"):
        run(["lab"])
    message = capsys.readouterr().out
    assert "run_1" in message and "; and 1 more, as " in message and "run_2" in message
