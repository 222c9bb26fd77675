"""Recordings by name and by part: all are found, each is kept or accounted for, and the truth that
a filter is held against is known.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from made_options import made

from pipeline.core import contracts
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.recordings.inventory import named_takes, take_name
from pipeline.recordings.quality import account, beside_limits, quality_row
from pipeline.recordings.steps import held_against, truth_of

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


NAMES = ["a/1.csv", "a/2.csv", "LICENSE", "old/3.csv", "old/4.csv"]


FOUND = [pd.DataFrame({"file": files}) for files in (NAMES, [*NAMES[2:], "depth/0.png"])]


def test_each_step_says_what_it_found_kept_and_left_out():
    rows = [
        quality_row(take, "training", "joint log", *row)
        for take, held in {
            "a": [("repetitions", 2), ("excursions_cut_off", 1), ("excursions_other_motion", 3)],
            "b": [("repetitions", 0), ("excursions_cut_off", 1), ("excursions_other_motion", 0)],
            "a_1": [("disturbance", 7.0, "robust standard deviations")],
            "a_2": [("disturbance", 0.5, "robust standard deviations")],
        }.items()
        for row in held
    ]
    quality = pd.DataFrame(rows)
    table = account(FOUND, quality, beside_limits(quality, {"disturbance": 6.0}))
    assert table.to_numpy().tolist() == [
        ["files", "all", 6, 3, "LICENSE, old (2)"],
        ["motions", "a", 6, 2, "cut off 1, other motion 3"],
        ["motions", "b", 1, 0, "cut off 1"],
        ["takes", "training", 2, 1, "a_1 (disturbance 7 beyond 6)"],
    ]
    # the control: without the limit nothing is left out
    stays = account(FOUND, quality, beside_limits(quality, {}))
    assert stays.iloc[-1].tolist() == ["takes", "training", 2, 2, ""]


def test_of_many_places_that_nothing_reads_the_first_are_named():
    many = pd.DataFrame({"file": [f"{i:02}/x" for i in range(11)]})
    none = pd.DataFrame(columns=["take", "quantity", "value", "part"])
    takes = pd.DataFrame(columns=["take", "part", "left_out", "beyond"])
    (row,) = account([many, many], none.astype({"quantity": str}), takes).to_numpy().tolist()
    assert row == ["files", "all", 11, 0, "00, 01, 02, 03, 04, 05, 06, 07, and in 3 more places"]


TRUE = pd.DataFrame({"take": ["a"], "part": ["test"], "k": [0], "t": [0.0], "q:arm": [0.5]})


@pytest.mark.parametrize(
    ("measurement", "synthetic", "true"),
    [("tip", True, True), ("tip", False, False), ("encoders", True, False), ("depth", True, False)],
)
def test_only_by_the_tip_and_only_where_there_is_a_truth(
    tmp_path, monkeypatch, measurement, synthetic, true
):
    monkeypatch.chdir(tmp_path)
    dataset = made(Dataset, recordings="raw/t/recordings", measurement=measurement)
    assert truth_of(dataset) == Path("raw/t/truth")
    if synthetic:
        Path("raw/t/truth").mkdir(parents=True)
        contracts.write(TRUE, "true_joints", truth_of(dataset))
    measured = TRUE.assign(**{"q:arm": 0.4})
    table, is_true = held_against(measured, dataset)
    assert is_true == true and table["q:arm"].tolist() == [0.5 if true else 0.4]
