"""Joint logs in Parquet: by the names of their columns, refused where damaged."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Head
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.parquet import FORMAT, read_parquet

ANGLES = np.random.default_rng(1).normal(size=(5, 12))
LABELS = [f"{signal}_q_{j}" for signal in ("actual", "target") for j in (1, 10, 2, 3, 4, 5)]
ROWS = pd.DataFrame(ANGLES, columns=LABELS).assign(time=np.arange(5) / 100, mode="servo")


@pytest.fixture
def file(tmp_path):
    ROWS.to_parquet(tmp_path / "run.parquet")
    return tmp_path / "run.parquet"


def test_columns_of_one_name_are_the_joints_in_the_order_of_their_numbers(file):
    assert FORMAT.recognises(Head.read(file))
    log = read_parquet(file, LogOptions())
    np.testing.assert_array_equal(log.signals["actual"], ANGLES[:, [0, 2, 3, 4, 5, 1]])
    np.testing.assert_array_equal(log.signals["target"], ANGLES[:, [6, 8, 9, 10, 11, 7]])


def test_the_option_names_columns(file):
    options = LogOptions("time", signals={"actual": ["target_q_2", "actual_q_1"]})
    log = read_parquet(file, options)
    np.testing.assert_array_equal(log.signals["actual"], ANGLES[:, [8, 0]])
    with pytest.raises(RecordingError, match=r"there are .*actual_q_10") as refused:
        read_parquet(file, LogOptions(signals={"actual": ["absent", "actual_q_1"]}))
    assert refused.value.evidence["key"] == "dataset.joint_log.signals"


def test_an_empty_cell_and_a_damaged_file_are_refused(file):
    content = file.read_bytes()
    ROWS.assign(actual_q_2=[0.0, None, 0.0, 0.0, 0.0]).to_parquet(file)
    with pytest.raises(RecordingError, match=r"actual_q holds .*nan") as refused:
        read_parquet(file, LogOptions())
    assert refused.value.evidence["row"] == 1
    file.write_bytes(content[:-20])
    with pytest.raises(RecordingError, match="damaged"):
        read_parquet(file, LogOptions())
