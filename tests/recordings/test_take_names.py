"""Every recording that a pattern matches keeps a name of its own, or none is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.recordings.take_names import named_takes, take_name

RAW = Path("recordings")


@pytest.mark.parametrize(
    ("pattern", "path", "name"),
    [
        ("optitrack/train_*.csv", "optitrack/train_1.csv", "train_1"),
        ("Movement_*/csv_files", "Movement_3/csv_files", "Movement_3"),
        ("Movement_*/csv_files/*.csv", "Movement_3/csv_files/a.csv", "Movement_3_csv_files_a"),
        ("day_[12]/run_?.npz", "day_2/run_1.npz", "day_2_run_1"),
        ("**/log.csv", "a/b/log.csv", "a_b"),
        ("logs/only.csv", "logs/only.csv", "only"),
    ],
)
def test_a_name_is_the_part_of_the_path_that_the_pattern_leaves_open(pattern, path, name):
    assert take_name(RAW / path, RAW, pattern) == name


def test_files_of_one_name_in_several_folders_are_all_there_and_a_collision_is_refused(tmp_path):
    for place in ("m_1/csv/a.csv", "m_1/csv/b.csv", "m_2/csv/a.csv", "m_2/csv/b.csv"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).touch()
    named = named_takes(tmp_path, "m_*/csv/*.csv", key="k")
    assert [*named] == ["m_1_csv_a", "m_1_csv_b", "m_2_csv_a", "m_2_csv_b"]
    assert named["m_2_csv_a"] == tmp_path / "m_2/csv/a.csv"
    assert [*named_takes(tmp_path, "m_*/csv", key="k")] == ["m_1", "m_2"]
    (tmp_path / "m_1/csv/a.txt").touch()
    with pytest.raises(RecordingError, match=r"'m_1_csv_a', the other is m_1/csv/a.csv") as refused:
        named_takes(tmp_path, "m_*/csv/*", key="k")
    assert refused.value.evidence == {"file": tmp_path / "m_1/csv/a.txt", "key": "k"}
    with pytest.raises(ConfigError, match="no pattern of files"):
        named_takes(tmp_path, "/m_*", key="k")
