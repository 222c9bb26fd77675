"""Logs of one movement, of whichever format."""

from __future__ import annotations

import numpy as np
import pytest
from joint_files import log, read_movement, table
from written_logs import write_joint_log

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Kind, begins
from pipeline.formats.joints.log import JointLog, LogOptions
from pipeline.recordings import movement


def test_logs_of_one_movement_are_paired_row_by_row_as_far_as_the_shortest_goes(tmp_path):
    for name, samples, seed in (("a.csv", 100, 1), ("b.csv", 93, 2)):
        write_joint_log(tmp_path / name, log(samples, seed=seed))
    (a, b), counts = read_movement(tmp_path, ["a.csv", "b.csv"], joints=6, rate=125.0)
    assert counts == {"cut_rows": 0, "blank_rows": 0, "doubled_rows": 0, "rows_without_partner": 7}
    np.testing.assert_allclose(a, log(100, seed=1).signals["actual"][:93], rtol=0, atol=1e-6)
    np.testing.assert_allclose(b, log(93, seed=2).signals["actual"], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("time", "file", "words"),
    [
        (np.delete(np.arange(51), 20) * 0.008, "a.csv", "by 0.016 s at 0.152 s"),
        (np.arange(50) * 0.01, "a.csv", "by 0.01 s at 0 s"),
        (np.arange(50) * 0.008 + 0.004, "b.csv", "not those of a.csv"),
    ],
)
def test_clocks_that_skip_or_disagree_are_refused(tmp_path, time, file, words):
    write_joint_log(tmp_path / "a.csv", log(50))
    write_joint_log(tmp_path / "b.csv", log(50))
    write_joint_log(tmp_path / file, JointLog(time, {"actual": log(50).signals["actual"]}, {}))
    with pytest.raises(RecordingError, match=words) as caught:
        read_movement(tmp_path, ["a.csv", "b.csv"], joints=6, rate=125.0)
    assert caught.value.evidence["file"] == tmp_path / file


def test_one_table_of_several_signals_is_counted_once(tmp_path):
    table(tmp_path, "t,q,qd", "0.000,0.5,1", "0.008,0.6,2", "0.008,0.6,2", "", "0.016,0.7")
    (q, qd), counts = read_movement(
        tmp_path, ["log.txt"] * 2, joints=1, rate=125.0, columns=[["q"], ["qd"]]
    )
    assert (q.tolist(), qd.tolist()) == ([[0.5], [0.6]], [[1], [2]])
    assert counts == {"cut_rows": 1, "blank_rows": 1, "doubled_rows": 1, "rows_without_partner": 0}


def test_a_log_of_another_format_is_told_by_how_it_begins(tmp_path, monkeypatch):
    def read(file, options):
        values = np.loadtxt(file, skiprows=1)
        return JointLog(values[:, 0], {"actual": values[:, 1:], "target": values[:, 1:]}, {})

    known = Format("a format", Kind.JOINTS, read, begins(b"MARK"))
    monkeypatch.setattr(movement, "formats_in", lambda *_: (known,))
    (tmp_path / "log.txt").write_text("MARK\n0 1 2\n0.1 3 4\n")
    signals, _ = movement.read_movement({tmp_path / "log.txt": LogOptions(joints=2)}, 10.0)
    assert [*signals] == ["actual", "target"] and signals["target"].tolist() == [[1, 2], [3, 4]]
    # of its signals those that the options name, and no other number of joints than they say
    named = LogOptions(joints=2, signals={"target": None})
    assert [*movement.read_movement({tmp_path / "log.txt": named}, 10.0)[0]] == ["target"]
    with pytest.raises(RecordingError, match="holds 2 joints, not 3") as refused:
        movement.read_movement({tmp_path / "log.txt": LogOptions(joints=3)}, 10.0)
    assert refused.value.evidence["key"] == "dataset.joint_log.joints"
    # the control: what does not begin so is a plain table, whose signals the options have to name
    (tmp_path / "log.txt").write_text("0 1 2\n0.1 3 4\n")
    signals, _ = movement.read_movement({tmp_path / "log.txt": named}, 10.0)
    assert signals["target"].tolist() == [[1, 2], [3, 4]]
