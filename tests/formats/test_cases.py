"""Files as other programs write them, each read right or refused by its name: small ones written
here, and, where they are beside the project, the public cases that they stand for.
"""

from __future__ import annotations

import runpy
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.force.record import ForceLogOptions, read_force_table
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.table import read_joint_table
from pipeline.recordings.movement import UNWRAPPED, read_log, read_movement
from pipeline.tools.inspect.command import inspect
from pipeline.tools.inspect.finding import Finding

CASES = Path(__file__).parents[2].parent / "shared/cases"
TIME = np.arange(60) / 125
Q = np.stack([np.sin(3 * TIME), 0.2 + 0.5 * TIME**2], axis=1)
ROWS = np.column_stack([TIME, Q + 1e-4, Q]).round(6)
LABELS = ["time", "q_0", "q_1", "q_target_0", "q_target_1"]
SIGNALS = {"actual": ["q_0", "q_1"], "target": ["q_target_0", "q_target_1"]}


def table(
    *above: str, mark: str = ",", decimal: str = ".", labels: bool = True, last: str = ""
) -> str:
    """The rows under the lines ``above``."""
    header = [mark.join(LABELS) + (f"{mark}{last}" if last else "")] if labels else []
    rows = [mark.join(f"{cell:.6f}" for cell in row).replace(".", decimal) for row in ROWS.tolist()]
    rows = [row + (mark if last else "") for row in rows]
    return "\n".join([*above, *header, *rows, ""])


def beside(column: str, at: int, cell: str) -> str:
    """The table with another ``column`` whose cells hold ``cell``, %d being the row."""
    lines = [line.split(",") for line in table().splitlines()]
    for number, cells in enumerate(lines):
        cells.insert(at, column if number == 0 else cell.replace("%d", str(number)))
    return "\n".join([*map(",".join, lines), ""])


TABLES = {
    "plain": (table(), {}),
    "settings": (table("Sensor,Rokubi", "Sampling rate,125"), {}),
    "settings, semicolons and decimal commas": (table("Rate;125", mark=";", decimal=","), {}),
    "settings, tabs": (table("Rate\t125", "Operator\tA. B.", mark="\t"), {}),
    "settings, padded": (table("Sampling rate,125,,,"), {}),
    "comment": (table("# recorded on Monday", mark=" "), {}),
    "title, padded": (table("Arm test of 5 March,,,,"), {}),
    "byte-order mark and CRLF": ("\ufeff" + table("Rate,125").replace("\n", "\r\n"), {}),
    "quotes": (table().replace("q_0", '"q_0"'), {}),
    "empty last column": (table(last="note"), {"note": "nothing"}),
    "words": (beside("mode", 1, "IDLE"), {"mode": "words"}),
    "quoted words with commas": (beside("mode", 1, '"a, b"'), {"mode": "words"}),
    "dates": (beside("clock", 1, "2024-03-05 10:15:%d.5"), {"clock": "dates or times"}),
    "footer": (table() + "end of file\n", {}),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_recognised_labelled_and_read_whatever_is_above_and_beside_its_numbers(
    tmp_path, name
):
    text, left_out = TABLES[name]
    (tmp_path / "run.csv").write_bytes(text.encode())
    (finding,) = inspect(tmp_path / "run.csv")
    assert (finding.format, finding.stops) == ("table of numbers", [])
    assert finding.facts["signals"] == SIGNALS and finding.facts["time"] == "time"
    assert finding.facts.get("columns_without_numbers", {}) == left_out
    log = read_joint_table(tmp_path / "run.csv", LogOptions("time", joints=2, signals=SIGNALS))
    np.testing.assert_allclose(log.time, TIME, atol=1e-6)
    np.testing.assert_allclose(log.signals["target"], Q, atol=1e-6)
    assert log.counts["cut_rows"] == (name == "footer")


def test_a_time_of_day_is_named_and_its_table_is_read_without_a_time(tmp_path):
    lines = [line.split(",", 1)[1] for line in table().splitlines()]
    stamped = [f"2024-03-05 10:15:{k / 125:09.6f},{line}" for k, line in enumerate(lines[1:])]
    (tmp_path / "run.csv").write_text("\n".join([f"timestamp,{lines[0]}", *stamped, ""]))
    (finding,) = inspect(tmp_path / "run.csv")
    assert finding.facts["columns_without_numbers"] == {"timestamp": "dates or times"}
    assert finding.facts["signals"] == SIGNALS and "time" not in finding.facts
    log = read_joint_table(tmp_path / "run.csv", LogOptions(None, 125.0, joints=2, signals=SIGNALS))
    np.testing.assert_allclose(log.signals["target"], Q, atol=1e-6)


FOREIGN = {
    "TRC": ("PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\n100\nFrame#\tTime\tA\n1\t0.0\t1\n", "C3D"),
    "Qualisys": ("NO_OF_FRAMES\t2\nFREQUENCY\t100\nFrame\tTime\tA X\n1\t0\t5\n2\t1\t6\n", "C3D"),
    "Vicon": ("Trajectories\n100\n,,Arm:a,,\nFrame,Sub Frame,X,Y,Z\n1,0,1,2,3\n", "C3D"),
    "Vicon ": ("\ufeffModel Outputs,,,\r\n100,,,\r\nFrame,Sub Frame,X\r\n1,0,1\r\n", "C3D"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_an_export_of_motion_capture_that_is_no_table_is_named_with_what_to_export(tmp_path, name):
    text, instead = FOREIGN[name]
    (tmp_path / "take.csv").write_text(text)
    (finding,) = inspect(tmp_path / "take.csv")
    assert name.strip() in finding.format and instead in finding.stops[0]
    with pytest.raises(RecordingError, match=f"{name.strip()}.*{instead}"):
        read_joint_table(tmp_path / "take.csv", LogOptions(joints=2, signals={"actual": None}))


def test_a_motion_of_opensim_is_read_in_the_unit_that_it_states(tmp_path):
    head = "run\nnRows=60\nnColumns=5\ninDegrees=yes\nendheader"
    (tmp_path / "run.mot").write_text(table(head, mark="\t"))
    (finding,) = inspect(tmp_path / "run.mot")
    assert "OpenSim" in finding.version and finding.facts["signals"] == SIGNALS
    options = LogOptions("time", joints=2, signals=SIGNALS)
    with pytest.raises(RecordingError, match="in deg by the header") as refused:
        read_joint_table(tmp_path / "run.mot", options)
    assert refused.value.evidence["key"] == "dataset.joint_log.angle_unit"


def test_one_number_a_line_is_said_to_be_one_column(tmp_path):
    (tmp_path / "q.txt").write_text("".join(f"{angle}\n" for angle in Q[:, 0]))
    (finding,) = inspect(tmp_path / "q.txt")
    assert finding.facts["columns"] == 1
    assert "one number a line" in finding.open[0][0]
    assert finding.open[0][1] == "dataset.joint_log.signals"
    with pytest.raises(RecordingError, match="one number a line is one column"):
        read_joint_table(tmp_path / "q.txt", LogOptions(joints=2, signals={"actual": None}))
    log = read_joint_table(
        tmp_path / "q.txt", LogOptions(None, 125.0, joints=1, signals={"actual": [0]})
    )
    np.testing.assert_array_equal(log.signals["actual"][:, 0], Q[:, 0])


@pytest.fixture
def case(tmp_path):
    """A function that gives the folder of a case, its files made by its make.py."""

    def made(name: str) -> Path:
        places = [*CASES.glob(f"{name}-*")]
        if not places:
            pytest.skip(f"the public cases are not at {CASES}")
        folder = tmp_path / name
        folder.mkdir()
        for file in places[0].iterdir():
            shutil.copyfile(file, folder / file.name)
        if (folder / "make.py").is_file():
            given, sys.argv = sys.argv, ["make.py", str(folder)]
            try:
                runpy.run_path(str(folder / "make.py"))
            finally:
                sys.argv = given
        return folder

    return made


def alone(file: Path) -> Finding:
    (finding,) = inspect(file)
    return finding


def test_case_02_rostopic(case):
    columns = {"t": "time", **{f"f{a}": f"field.wrench.force.{a}" for a in "xyz"}}
    options = ForceLogOptions(columns=columns, force_unit="N", time_unit="ns")
    folder = case("02")
    for name, held in (("wrench.csv", "words"), ("wrench_empty_frame.csv", "nothing")):
        file = folder / name
        assert alone(file).facts["columns_without_numbers"] == {"field.header.frame_id": held}
        record = read_force_table(file, options)
        assert (len(record.time), record.rate) == (200, pytest.approx(100, rel=1e-4))


def test_case_03_qd_is_a_speed(case):
    signals = alone(case("03") / "motion.csv").facts["signals"]
    assert signals["actual"] == [f"q_{j}" for j in range(6)]
    assert signals["target"] == [f"tq_{j}" for j in range(6)]


@pytest.mark.slow
def test_case_06_wrapped_angles(case):
    folder = case("06")
    names = {"actual": [f"q_{j}" for j in range(6)], "target": [f"q_target_{j}" for j in range(6)]}
    options = LogOptions("time", joints=6, signals=names)
    control = read_log(folder / "control/run.csv", options)
    for name, jumps in (("both_wrap", 32), ("actual_wraps", 16)):
        log = read_log(folder / name / "run.csv", options)
        assert log.counts[UNWRAPPED] == jumps == alone(folder / name / "run.csv").gaps[UNWRAPPED]
        np.testing.assert_allclose(log.signals["actual"], control.signals["actual"], atol=2e-8)


@pytest.mark.slow
def test_case_08_two_publishers(case):
    folder, counted = case("08"), {}
    for name in ("gripper_on_the_same_topic", "gripper_first", "message_twice", "control"):
        options = LogOptions(joints=2, names=("a", "b"))
        counted[name] = read_movement({folder / name: options}, 100.0)[1]
    assert counted["message_twice"]["doubled_rows"] == 6
    assert counted["gripper_first"]["messages_of_other_joints"] == 60
    assert counted["gripper_on_the_same_topic"]["messages_of_other_joints"] == 60
    read_movement({folder / "order_of_joints_changes": options}, 100.0)
    for name in ("same_stamp_other_values", "without_stamps"):
        with pytest.raises(RecordingError):
            read_movement({folder / name: options}, 100.0)


def test_cases_09_13_and_15_tables(case):
    above = case("09")
    options = ForceLogOptions()
    control = read_force_table(above / "control.csv", options)
    for name in ("comma.csv", "tab.tsv", "semicolon.csv"):
        np.testing.assert_array_equal(read_force_table(above / name, options).force, control.force)
    for name in ("qtm_like.tsv", "trc_like.trc", "nexus_like.csv"):
        assert "C3D" in alone(above / name).stops[0]
    for file in [*case("13").glob("*.csv"), *case("15").glob("*.csv")]:
        assert alone(file).facts["signals"] == SIGNALS and not alone(file).stops


@pytest.mark.slow
def test_case_10_libfranka(case):
    finding = alone(case("10") / "log.csv")
    named = {"actual": [f"q[{j}]" for j in range(7)], "target": [f"q_d[{j}]" for j in range(7)]}
    assert finding.facts["signals"] == named and not finding.units
