"""Accounts that inspect gives of recordings: every format is named, what the file states is shown,
what it leaves open is asked with its option, and damage is a finding.
"""

import json
import shutil
import sys
from pathlib import Path

import pytest
from case_tables import cases_beside
from motive_files import rows_file
from sample_recordings import write_zoo
from source_code import ROOT

from pipeline.__main__ import main
from pipeline.core.typed_yaml import read_yaml
from pipeline.tools.inspect.command import as_json, as_table, describe_file, inspect
from pipeline.tools.inspect.finding import Finding

cases = cases_beside(__file__)
FORMATS = read_yaml(Path(__file__).with_suffix(".yaml"))["formats"]
STATED = read_yaml(Path(__file__).with_name("findings.yaml"))
BODY_ROWS = [f"frame,{k},{k / 100:.6f},1,1,{k},0,1,0,0,0,1,0,0,0,0" for k in range(9)]


@pytest.fixture(scope="module")
def zoo(tmp_path_factory) -> Path:
    """A folder of one recording of every format; read only."""
    folder = tmp_path_factory.mktemp("zoo")
    write_zoo(folder)
    return folder


@pytest.fixture(scope="module")
def findings(zoo) -> dict[str, Finding]:
    """The account of each recording, by its place in the folder."""
    return {
        finding.file.relative_to(zoo).as_posix(): finding for finding in inspect(zoo)
    }


def options(finding: Finding) -> list[str]:
    return [question.option for question in finding.open]


def test_every_format_is_recognised_in_a_folder_as_alone(zoo, findings):
    expected = {name: form for form, names in FORMATS.items() for name in names}
    assert {name: finding.format for name, finding in findings.items()} == expected
    for name, finding in findings.items():
        assert not finding.stops, name
        if "[" not in name:  # a sequence of files
            assert describe_file(zoo / name) == finding, name


@pytest.mark.parametrize("name", STATED)
def test_what_a_recording_states_and_leaves_open_is_shown(findings, name):
    finding = findings[name]
    stated = STATED[name]
    open_options = options(finding)

    for attribute, value in stated.get("shown", {}).items():
        if isinstance(value, float):
            value = pytest.approx(value, abs=1e-6)
        assert getattr(finding, attribute) == value, attribute
    for fact, value in stated.get("facts", {}).items():
        assert finding.facts[fact] == value, fact
    if "open" in stated:
        assert open_options == stated["open"]
    for option in stated.get("among_open", []):
        assert option in open_options


def test_markers_are_named_and_the_topics_of_a_bag_are_a_choice(findings):
    assert len(findings["columns.csv"].facts["markers"]) == 9
    for name in FORMATS["ROS bag"]:
        bag = findings[name]
        assert bag.facts["topics"]["/depth"] == ["sensor_msgs/msg/Image", 3]
        assert "several topics could be meant: /depth, /other" in bag.open[0].question


def test_a_robot_states_its_arms_and_planar_chains(tmp_path, zoo, findings):
    robot = findings["three.urdf"]
    urdf = (zoo / "three.urdf").read_text()
    assert robot.facts["joints"] == {"revolute": ["j1", "j2", "j3"], "fixed": ["j4"]}
    assert robot.facts["chains"] == [{"joints": ["j1", "j2", "j3"], "tools": ["tip"]}]
    assert not robot.open

    def changed(text: str) -> Finding:
        (tmp_path / "arm.urdf").write_text(text)
        return describe_file(tmp_path / "arm.urdf")

    bent = changed(urdf.replace('xyz="0 1 0"', 'xyz="1 0 0"', 1))
    assert bent.facts["arms"] == [{"joints": ["j1", "j2", "j3"], "tip": "tip"}]
    assert not bent.facts["chains"] and not bent.stops
    assert "robot.urdf" in changed(urdf.replace("<limit", "<no", 1)).stops[0]


@cases("refused", ["c.npz", "PK\3\4" + 200 * "\0", "unpack an archive"])
def test_what_a_reader_refuses_says_why_and_what_to_do(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)

    (finding,) = inspect(tmp_path)

    reason = finding.facts.get("reason", "")
    assert said in " ".join([reason, *finding.stops, *map(str, finding.open)])
    *_, last_line = as_table([finding], tmp_path).splitlines()
    assert said in last_line
    assert last_line.startswith("not recognised, ") or not reason


def test_a_sequence_names_its_damaged_and_missing_frames(zoo, tmp_path):
    shutil.copytree(zoo / "indexed", tmp_path / "a")
    (tmp_path / "a/depth/0001.png").unlink()
    frame = tmp_path / "a/depth/0000.png"
    frame.write_bytes(frame.read_bytes()[:-20])

    (finding,) = inspect(tmp_path)

    assert "1 of 4 frames of the index do not exist: depth/0001.png" in finding.stops[0]
    assert finding.stops[1].startswith("0000.png: the depth frame is truncated")


def test_recordings_that_differ_in_a_number_share_a_line_and_json_has_each(tmp_path):
    for number in range(12):
        rows_file(tmp_path, "rigidbody,Ha\x1b[2Jnd,1,0", *BODY_ROWS)
        (tmp_path / "rows.csv").rename(tmp_path / f"take_{number}.csv")
    rows_file(tmp_path, "rigidbody,Hand,1,0", *BODY_ROWS)
    findings = inspect(tmp_path)
    table = as_table(findings, tmp_path)
    heads = [line for line in table.splitlines() if line[0] != " "]

    assert heads == ["rows.csv: Motive CSV 1.1", "take_*.csv (12): Motive CSV 1.1"]
    assert table.count("    ? the file does not state the unit of its lengths") == 2
    # a terminal acts on nothing that a file holds
    assert "\x1b" not in table and "Ha\N{REPLACEMENT CHARACTER}[2Jnd" in table

    read = json.loads(as_json(findings))
    assert len(read) == 13
    assert read[0]["open"][0].keys() == {"question", "option", "suggested"}


def test_the_command_prints_a_table_json_and_one_line_of_error(
    zoo,
    tmp_path,
    monkeypatch,
    capsys,
):
    def call(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["pipeline", "inspect", *map(str, words)])
        return (main(), *capsys.readouterr())

    code, text, _ = call(zoo / "columns.csv", "--json")
    assert code == 0 and json.loads(text)[0]["units"] == {"length": "m"}
    assert call(zoo / "columns.csv")[1].splitlines()[0].endswith(": Motive CSV 1.23")
    code, text, error = call(tmp_path / "nothing")
    assert (code, text) == (1, "")
    assert error.startswith("error: inspect: there is no such file or folder [file ")
    (tmp_path / "a.csv").write_bytes(b"1;2.5\n" * 200_000)
    assert "dataset.reading.file_mib" in call(tmp_path, "--reading", "file_mib=1")[1]
    assert "! " not in call(tmp_path, "--reading", "file_mib=2")[1]


SAMPLES = ROOT.parent / "shared/samples"


@pytest.mark.skipif(
    not SAMPLES.is_dir(),
    reason="files of real instruments are not beside it",
)
def test_files_that_real_instruments_wrote_are_told_apart():
    findings = {finding.file.name: finding for finding in inspect(SAMPLES)}
    for version in ("1.1", "1.21", "1.23"):
        assert findings[f"motive_v{version}_rigidbody.csv"].version == version

    stopped = [name for name, finding in findings.items() if finding.stops]
    assert stopped == ["motive_v1.23_empty.csv"]
    assert findings["motive_v1.23_markers_millimetres.csv"].units == {"length": "mm"}
    assert findings["motive_v1.1_rigidbody.csv"].open[0].option == "dataset.mocap.unit"
    force = findings["daqft_dotnet_semicolon.csv"]
    assert (force.rate, force.facts["decimal"]) == (62.5, ",")
    camera = findings["kinect2_ir_intrinsics.yaml"].facts
    assert camera["fx"] == pytest.approx(366.95, abs=0.01)
