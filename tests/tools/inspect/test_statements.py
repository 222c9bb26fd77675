"""What is said of a recording is true, and what is known of it is said."""

from __future__ import annotations

import errno

import numpy as np
import pytest
from motive_files import MARKER, columns_file
from written_logs import write_joint_log

from pipeline.formats.depth.image import write_depth
from pipeline.formats.joints.log import JointLog
from pipeline.tools.inspect import examine
from pipeline.tools.inspect.examine import inspect
from pipeline.tools.inspect.finding import UNKNOWN
from pipeline.tools.inspect.layout import layout
from pipeline.tools.inspect.report import as_table
from pipeline.tools.new_dataset.command import dataset_texts

TIME = np.arange(1000) * 0.008


def archive(file, progress: np.ndarray) -> None:
    q = np.array([0.3, -1.0, 0.8]) + progress[:, None] * [1.0, 0.5, -0.7]
    np.savez(file, times=TIME, positions=q, target_positions=q)


def test_a_motion_that_is_cut_off_is_none_that_never_rests(tmp_path):
    archive(tmp_path / "cut.npz", np.clip(TIME - 4, 0, None) ** 2)
    (finding,) = inspect(tmp_path / "cut.npz")
    assert (finding.facts["motions"], finding.gaps["motions_cut_off"]) == ("0 whole", 1)
    assert "rest" not in finding.facts.get("settings", {})
    # the control: a command without rest
    archive(tmp_path / "on.npz", np.sin(TIME))
    (finding,) = inspect(tmp_path / "on.npz")
    assert finding.facts["settings"]["rest"] == "0" and "motions_cut_off" not in finding.gaps


def test_joints_at_rest_have_no_lag(tmp_path):
    archive(tmp_path / "rest.npz", np.random.default_rng(1).normal(0, 1e-5, len(TIME)))
    (finding,) = inspect(tmp_path / "rest.npz")
    assert finding.facts["command"] == "at rest, missed by 0 rad"
    assert {option.rpartition(".")[2] for _, option in finding.open} == {"time_unit", "angle_unit"}


def test_of_a_depth_image_is_said_what_is_seen_and_not_what_its_encoding_would_say(tmp_path):
    write_depth(tmp_path / "d.png", np.array([[0, 0, 2047, 900]], np.uint16).repeat(4, axis=0))
    (finding,) = inspect(tmp_path / "d.png")
    assert finding.facts["share_not_above_zero"] == 0.5
    assert not [name for name in finding.facts if "without" in name]
    assert "share not above zero 0.5" in as_table([finding], tmp_path)


def test_a_cloud_says_its_organisation_and_the_share_without_position(tmp_path):
    (tmp_path / "c.pcd").write_text(
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 2\n"
        "POINTS 4\nDATA ascii\n1 2 3\nnan nan nan\n4 5 6\n7 8 9\n"
    )
    table = as_table(inspect(tmp_path), tmp_path)
    assert "organised 2 × 2; share without position 0.25" in table


def test_a_file_that_cannot_be_read_is_called_by_no_format(tmp_path, monkeypatch):
    (tmp_path / "q.csv").write_text("1,2\n")

    def refuse(file):
        raise OSError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(examine, "known_as", refuse)
    (finding,) = inspect(tmp_path / "q.csv")
    assert (finding.format, finding.kind) == (UNKNOWN, UNKNOWN)
    assert "Permission denied" in finding.stops[0]


def test_a_rate_and_the_printed_times_that_contradict_it_are_both_shown(tmp_path):
    rows = "".join(f"{k},{0.5 * k:.3f},1,2,3\n" for k in range(12))
    (finding,) = inspect(columns_file(tmp_path, MARKER + rows))
    assert finding.rate == 100.0 and finding.facts["rate_by_the_printed_times"] == "2 Hz"
    assert "rate by the printed times 2 Hz" in as_table([finding], tmp_path)
    # the control
    rows = "".join(f"{k},{0.01 * k:.3f},1,2,3\n" for k in range(12))
    (finding,) = inspect(columns_file(tmp_path, MARKER + rows))
    assert "rate_by_the_printed_times" not in finding.facts


def test_the_step_of_another_table_in_the_folder_is_not_the_joint_logs(tmp_path):
    for number in (1, 2):
        folder = tmp_path / f"move_{number}"
        folder.mkdir()
        rows = np.random.default_rng(number).normal(size=(len(TIME), 6))
        for name in ("q_actual", "q_target"):
            write_joint_log(folder / f"{name}.csv", JointLog(TIME, {"actual": rows}, {}))
        table = np.column_stack([4 * TIME / 0.008, rows])
        np.savetxt(folder / "a_force.csv", table, "%.4f", ",")
    proposed = dataset_texts("lab", "lab", layout(inspect(tmp_path), tmp_path), tmp_path)[0]
    assert "movements: move_*" in proposed and "steps by" not in proposed
    for number in (1, 2):
        (tmp_path / f"move_{number}/a_force.csv").unlink()
    proposed = dataset_texts("lab", "lab", layout(inspect(tmp_path), tmp_path), tmp_path)[0]
    assert "# steps by 0.008" in proposed


def test_repeated_and_zero_rows_of_a_table_are_counted(tmp_path):
    (tmp_path / "t.csv").write_text("1.5,2\n1.5,2\n0,0\n3,4\n")
    (finding,) = inspect(tmp_path / "t.csv")
    assert (finding.gaps["repeated_rows"], finding.gaps["zero_rows"]) == (1, 1)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("b.h5", b"\x89HDF\r\n\x1a\n" + bytes(200), "HDF5"),
        ("c.npz", b"PK\3\4" + bytes(200), "an archive without arrays"),
        ("d.npy", b"\x93NUMPY" + bytes(200), "in one .npz"),
        ("e.csv", b"time,q1,q2,q3\n", "without rows of numbers"),
        ("f.bin", b"\1\2\0\3" * 9, "binary data"),
        ("README", b"Recorded on Monday.\n", "text without a table"),
    ],
)
def test_what_is_not_recognised_says_why_and_what_to_do(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    findings = inspect(tmp_path)
    assert words in findings[0].facts["reason"]
    last = as_table(findings, tmp_path).splitlines()[-1]
    assert last.startswith("not recognised, ") and last.endswith(f": {name}") and words in last


def test_a_joint_without_a_range_beside_a_valid_chain_stops_nothing(tmp_path, zoo):
    finger = (
        '<link name="finger"/><joint name="j9" type="revolute"><parent link="tip"/>'
        '<child link="finger"/><axis xyz="0 1 0"/><limit velocity="1" effort="1"/></joint></robot>'
    )
    text = (zoo / "three.urdf").read_text().replace("</robot>", finger)
    (tmp_path / "hand.urdf").write_text(text)
    (finding,) = inspect(tmp_path / "hand.urdf")
    assert finding.facts["chains"][0]["joints"] == ["j1", "j2", "j3"] and not finding.stops
    assert "j9 has no limits" in finding.facts["chains_refused"]
