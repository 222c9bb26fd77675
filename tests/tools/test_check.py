"""check prints everything that is wrong with a dataset at once; inspect shows which option makes
the command in a joint log fit the measured angles, and new-dataset suggests that value.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest
from case_tables import cases_beside
from motive_files import START, random_take
from source_code import ROOT

from pipeline.__main__ import tool_call
from pipeline.core.errors import ConfigError
from pipeline.formats.motion.motive import write_motive
from pipeline.tools.inspect.command import as_table, inspect

cases = cases_beside(__file__)
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

    sheet = root / "data/raw/lab/dataset.yaml"
    option = root / "conf/dataset/lab.yaml"
    sheet.parent.mkdir(parents=True)
    sheet.write_text(SHEET.format(folder=logs))
    option.write_text(OPTION)
    return sheet, option


def edit(file: Path, old: str, new: str) -> None:
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))


def refused(capsys, count: int | str) -> str:
    """Return what check prints where it finds so many faults."""
    with pytest.raises(ConfigError, match=rf"^{count} fault\(s\): correct"):
        tool_call("check", ["lab"])()
    return capsys.readouterr().out


def test_nothing_is_wrong_and_another_name_is_refused(files, capsys):
    tool_call("check", ["lab"])()
    choose = "set `dataset: lab` in params.yaml, and run `dvc repro`"

    assert capsys.readouterr().out == f"check: lab has no faults; next: {choose}\n"
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
    edit(option, "  tolerance: 1.0e-4\n", "  mismatch: 0\n")
    printed = refused(capsys, 9)
    keys = (
        "key dataset.joint_log.mismatch",
        "about.source",
        "key dataset.joint_log.angle_unit",
        "robot.tol",
        "walks",
    )

    for key in (
        *keys,
        "key dataset.motion.rate",
        "key dataset.joint_log.rest",
        "tolerance",
    ):
        assert printed.count(key) == 1, key


def test_the_command_that_pulls_missing_recordings_is_named(root, files, capsys):
    edit(files[0], str(files[0].parents[3].parent / "logs"), "../elsewhere/arm")
    (root / "data/recordings/arm").mkdir(parents=True)
    assert "`dvc --cd data/recordings pull -R arm` brings them" in refused(capsys, 1)


@cases("faults", ["logs\n", f"logs\n{MOCAP}", "Link1:Markr3"])
def test_what_configure_and_ingest_would_refuse_is_printed(
    files,
    capsys,
    old,
    new,
    words,
):
    edit(files[0], old, new)
    assert words in refused(capsys, "[0-9]+")


TIME = np.arange(1000) * 0.008
UNITS = {"time_unit": "s", "angle_unit": "rad"}  # suggested, as no archive states them


def angles(t: np.ndarray) -> np.ndarray:
    """Angles in rad of three joints that repeat a motion without rest."""
    return np.stack(
        [np.sin(t), 0.7 * np.cos(1.4 * t), 0.4 * np.sin(0.8 * t + 1)],
        axis=1,
    )


def test_an_archive_states_its_traps_and_the_values_that_settle_them(root, tmp_path):
    (logs := tmp_path / "archives").mkdir()
    jitter = np.random.default_rng(1).normal(0, 3e-4, len(TIME))
    for number, early in ((1, 0.8), (2, 0.96)):
        commanded = np.pi / 180 * angles(TIME + early)
        arrays = {"positions": angles(TIME), "target_positions": commanded}
        np.savez(logs / f"run_{number}.npz", times=1.5e9 + TIME + jitter, **arrays)
    findings = inspect(logs)
    assert [finding.format for finding in findings] == ["NumPy archive of joints"] * 2

    settled = {
        "clock": "rows",
        "target_factor": "57.29577951308232",
        "rest": "0",
    } | UNITS
    for finding, delay in zip(findings, ("0.8", "0.96"), strict=True):
        assert finding.suggested.keys() == {*settled, "target_delay", "pose_noise"}
        assert finding.suggested.items() >= (settled | {"target_delay": delay}).items()
        # recordings that are settled differently each have a line
        line = f"suggested is {delay}: dataset.joint_log.target_delay"
        assert as_table(findings, logs).count(line) == 1
    tool_call("new_dataset", ["lab", "--from", str(logs)])()
    proposed = (root / "data/raw/lab/dataset.yaml").read_text()
    assert "clock: ??? # suggested is rows; " in proposed
    assert "joints: ??? # 3 joints; names of the logged joints" in proposed
    assert (
        "suggested is {run_1: 0.8, run_2: 0.96}; the command differs from the"
        in proposed
    )
    assert (
        "rate: ??? # suggested is 125; 1/s"
        in (root / "conf/dataset/lab.yaml").read_text()
    )


def test_a_unit_in_an_arrays_name_is_no_question_and_a_joint_that_stands_still_is_named(
    tmp_path,
):
    commanded, measured = (np.rad2deg(angles(TIME)) for _ in range(2))
    measured[:, 2] = 0.0
    for word in ("_deg", ""):
        arrays = {
            f"actual_pos{word}": measured,
            f"target_pos{word}": commanded,
            "time": TIME,
        }
        np.savez(tmp_path / "run.npz", **arrays)
        (finding,) = inspect(tmp_path)
        assert ("angle_unit" in finding.suggested) == (word == "")
        assert finding.facts["joints_that_stand_still"] == [3]
        assert "tracking error 0 of the motion" in finding.facts["command"]
