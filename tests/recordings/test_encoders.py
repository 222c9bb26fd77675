"""Logs of encoders as a table: at their own rate, on the motion's clock, refused where they are not
those of the arm.
"""

from __future__ import annotations

import numpy as np
import pytest
from made_options import made

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Dataset, Robot
from pipeline.core.options.instruments import Encoders
from pipeline.formats.joints.table import joint_labels, write_joint_table
from pipeline.recordings.joint_logs import encoder_rows

JOINTS = ["shoulder", "elbow"]


def dataset(**options) -> Dataset:
    stated = {
        "training": "logs/train_*.csv",
        "test": "logs/test_*.csv",
        "time": "time",
        "actual": joint_labels("actual", JOINTS),
    }
    robot = Robot("arm.urdf", JOINTS, task=["x"])
    return made(Dataset, robot=robot, encoders=Encoders(**stated | options))


URDF = """<robot name="arm"><link name="base"/><link name="upper"/><link name="lower"/>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
<limit velocity="2" effort="1" lower="-9" upper="9"/></joint></robot>
"""


@pytest.fixture
def raw(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "logs").mkdir()
    q = np.random.default_rng(1).normal(0, 1e-3, (40, 2)).round(4)
    for take in ("test_b", "test_a", "train_a"):
        signals = {"target": np.zeros((40, 2)), "actual": q}
        write_joint_table(tmp_path / f"logs/{take}.csv", 7 + np.arange(40) / 250, signals, JOINTS)
    return tmp_path, q


def test_every_log_of_a_take_is_read_at_its_own_rate(raw):
    folder, q = raw
    (trained, _), (rows, quality), (other, _) = encoder_rows(folder, dataset(start=6.9))
    takes = [(each["take"].iloc[0], each["part"].iloc[0]) for each in (trained, rows, other)]
    assert takes == [("train_a", "training"), ("test_a", "test"), ("test_b", "test")]
    np.testing.assert_allclose(rows["t"], 0.1 + np.arange(40) / 250, atol=1e-9)
    np.testing.assert_allclose(rows[["q:shoulder", "q:elbow"]], q, atol=1e-9)
    assert {row["quantity"]: row["value"] for row in quality}["rows"] == 40


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"training": "logs/run_*.csv"}, RecordingError, "no log matches 'logs/run_"),
        ({"actual": ["actual_shoulder"]}, ConfigError, "1 columns for the 2 joints"),
        ({"actual": ["actual_shoulder", "actual_wrist"]}, RecordingError, "actual_wrist"),
    ],
)
def test_logs_of_other_joints_are_refused(raw, options, error, words):
    with pytest.raises(error, match=words):
        encoder_rows(raw[0], dataset(**options))


def test_a_wrapped_reading_is_unwrapped_and_counted_and_a_step_no_joint_makes_refused(raw):
    folder, q = raw
    turning = q + np.linspace(3.0, 3.4, 40)[:, None] * [1, 0]
    wrapped = (turning + np.pi) % (2 * np.pi) - np.pi
    time, file = 7 + np.arange(40) / 250, folder / "logs/train_a.csv"
    write_joint_table(file, time, {"actual": wrapped}, JOINTS)
    (rows, quality), *_ = encoder_rows(folder, dataset())
    np.testing.assert_allclose(rows[["q:shoulder", "q:elbow"]], turning, atol=1e-7)
    assert [r["value"] for r in quality if r["quantity"] == "unwrapped_jumps"] == [
        np.sum(np.abs(np.diff(wrapped[:, 0])) > np.pi)
    ]
    q[20, 1] += 0.05
    write_joint_table(file, time, {"actual": q}, JOINTS)
    with pytest.raises(
        RecordingError, match=r"elbow \(actual\) steps .* allows 2 rad/s"
    ) as refused:
        encoder_rows(folder, dataset())
    assert refused.value.evidence["time"] == 0.08
