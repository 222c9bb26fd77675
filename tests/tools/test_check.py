"""check prints everything that is wrong with a dataset at once, and nothing where nothing is."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from motive_files import START, random_take
from source_code import ROOT

from pipeline.__main__ import tool_call
from pipeline.core.errors import ConfigError
from pipeline.formats.motion.motive import write_motive

JOINTS = "joints: [joint_1, joint_2, joint_3, joint_4, joint_5, joint_6]"
SHEET = f"""\
about: {{{{subject: an arm, source: a test, licence: MIT}}}}
recordings: {{folder}}
joint_log:
  movements: No*
  actual: q_actual.csv
  target: q_target.csv
  {JOINTS}
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
  {JOINTS}
  tool: flange
motion: {{rate: 100.0, steps: 100}}
joint_log:
  start: [0.3, -1.2, 1.4, -1.0, -1.2, 0.2]
  end: [0.7, -0.9, 1.1, -0.8, -1.0, 0.7]
  rest: 10
  tolerance: 1.0e-4
"""


@pytest.fixture
def files(root, logs) -> tuple[Path, Path]:
    """Datasheet and option file of the dataset lab, with which nothing is wrong."""
    (root / "params.yaml").write_text("dataset: other\n")
    shutil.copytree(ROOT / "pipeline/conf", root / "conf", dirs_exist_ok=True)
    write_motive(logs / "take.csv", random_take(101, body=False), start=START)
    sheet, option = root / "data/raw/lab/dataset.yaml", root / "conf/dataset/lab.yaml"
    sheet.parent.mkdir(parents=True)
    sheet.write_text(SHEET.format(folder=logs))
    option.write_text(OPTION)
    return sheet, option


def edit(file: Path, old: str, new: str) -> None:
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))


def refused(capsys, count: int | str) -> str:
    """Return what check prints where it finds so many faults."""
    with pytest.raises(ConfigError, match=rf"^{count} to be mended"):
        tool_call("check", ["lab"])()
    return capsys.readouterr().out


def test_nothing_is_wrong_and_another_name_is_refused(files, capsys):
    tool_call("check", ["lab"])()
    assert capsys.readouterr().out == "check: nothing is wrong with lab\n"
    with pytest.raises(ConfigError, match="no dataset 'nowhere'; there are"):
        tool_call("check", ["nowhere"])()


def test_everything_that_is_wrong_is_printed_at_once(files, capsys):
    sheet, option = files
    edit(sheet, "a test", "'???'")
    edit(sheet, "logs\n", "walks\n")
    edit(sheet, "  actual: ", "  angle_unit: turns\n  actual: ")
    edit(option, "tool: flange", "tol: flange")
    edit(option, "rate: 100.0", "rate: fast")
    edit(option, "rest: 10", "rest: -1")
    edit(option, "  tolerance: 1.0e-4\n", "")
    printed = refused(capsys, 8)
    keys = ("about.source", "key dataset.joint_log.angle_unit", "robot.tol", "walks")
    for key in (*keys, "key dataset.motion.rate", "key dataset.joint_log.rest", "tolerance"):
        assert printed.count(key) == 1, key


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("No*", "walk_*", "no folder or file of a movement matches"),
        ("q_actual.csv", "q.csv", "No1_slow/q.csv]; and 1 more, as"),
        ("joint_6]", "joint_7]", "joint_6 of robot.joints is not logged"),
        ("joint_log:", "joint_log:\n  angle_unit: deg", "no motion"),
        ("joint_log:", "joint_log:\n  rest: 10", "rest stands in lab.yaml too"),
        ("logs\n", f"logs\n{MOCAP}", "Link1:Markr3"),
    ],
)
def test_what_configure_and_ingest_would_refuse_is_printed(files, capsys, old, new, words):
    edit(files[0], old, new)
    assert words in refused(capsys, "[0-9]+")


def test_every_movement_that_cannot_be_read_is_named(files, capsys, logs):
    for name in ("No1_slow", "No2_slow"):
        edit(logs / name / "q_actual.csv", "0.300000", "0.3x")
    message = refused(capsys, 1)
    assert "No1_slow" in message and "; and 1 more, as " in message and "No2_slow" in message
