"""What a stage writes beside its tables: numbers in full precision, folders whole or not at all."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pipeline.core import contracts
from pipeline.core.errors import ContractError


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf, np.float64("nan")])
def test_metrics_that_are_no_numbers_are_refused_and_the_old_ones_stay(broken, tmp_path):
    file = tmp_path / "new" / "metrics.json"
    contracts.write_metrics({"good": 1.0}, file)
    with pytest.raises(ContractError, match="worse, worst not finite"):
        contracts.write_metrics({"good": 2.0, "worse": broken, "worst": broken}, file)
    assert json.loads(file.read_text()) == {"good": 1.0}
    assert [path.name for path in file.parent.iterdir()] == ["metrics.json"]


def test_metrics_keep_every_digit_and_their_kind(tmp_path):
    metrics = {
        "share": np.float64(0.1) + np.float64(0.2),
        "count": np.int64(3),
        "at_end": np.bool_(True),
    }
    contracts.write_metrics(metrics, tmp_path / "metrics.json")
    assert json.loads((tmp_path / "metrics.json").read_text()) == {
        "share": 0.1 + 0.2,
        "count": 3,
        "at_end": True,
    }


def test_a_folder_is_replaced_whole(tmp_path):
    folder = tmp_path / "data" / "track"
    for name in ("old", "new"):
        with contracts.replacing(folder) as partial:
            (partial / name).write_text(name)
            assert not (folder / "new").exists()
    assert [path.name for path in folder.iterdir()] == ["new"]
    assert [path.name for path in folder.parent.iterdir()] == ["track"]


@pytest.mark.parametrize("error", [ContractError("refused"), KeyboardInterrupt()])
def test_a_failure_leaves_the_old_folder_and_nothing_else(error, tmp_path):
    folder = tmp_path / "track"
    folder.mkdir()
    (folder / "old").write_text("old")
    with pytest.raises(type(error)), contracts.replacing(folder) as partial:
        (partial / "new").write_text("new")
        raise error
    assert [path.name for path in tmp_path.iterdir()] == ["track"]
    assert [path.name for path in folder.iterdir()] == ["old"]


def test_what_a_killed_run_left_behind_does_not_enter_the_folder(tmp_path):
    left = tmp_path / ".track.partial"
    left.mkdir()
    (left / "torn").write_text("torn")
    with contracts.replacing(tmp_path / "track") as partial:
        assert not list(partial.iterdir())
