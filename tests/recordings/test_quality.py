"""Counts are summed up by their unit, and a take beyond a stated limit is left out."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Limits
from pipeline.recordings.quality import (
    beside_limits,
    metrics,
    quality_row,
    reasons,
    require_enough,
    side_by_side,
    summarised,
)

CAMERA, LOG = "depth camera", "joint log"
SHARES, CORRELATIONS = [0.2, 0.9, 0.4, 0.6], [0.999, 0.98, 0.97, 0.99]


def measured(quantity: str, values: dict[str, float], part: str = "training", unit: str = "m"):
    """A value of the ``quantity`` of each take."""
    rows = [quality_row(take, part, LOG, quantity, value, unit) for take, value in values.items()]
    return pd.DataFrame(rows)


@pytest.fixture
def quality() -> pd.DataFrame:
    rows = [
        quality_row(f"take_{i}", "test", CAMERA, *row)
        for i in range(4)
        for row in (
            ("dropped_frames", i),
            ("dropped_share", SHARES[i], "share"),
            ("clock_correlation", CORRELATIONS[i], "1"),
            ("clock_offset", 0.1 * i - 0.1, "s"),
        )
    ]
    return pd.DataFrame([*rows, quality_row("take_0", "test", LOG, "cut_rows", 700, "row")])


def test_each_quantity_is_summed_up_as_its_unit_declares_and_no_share_exceeds_one(quality):
    table = summarised(quality).set_index("quantity")
    assert table.loc["dropped_frames", "total"] == 6 and np.isnan(table["mean"]["dropped_frames"])
    for name, values in (("dropped_share", SHARES), ("clock_correlation", CORRELATIONS)):
        assert table.loc[name, "mean"] == pytest.approx(np.mean(values))
        assert np.isnan(table.loc[name, "total"])
        assert tuple(table.loc[name, ["least", "greatest"]]) == (min(values), max(values))
    assert "cut_rows" not in table.index
    numbers = metrics(summarised(quality))
    assert numbers["depth_camera_dropped_frames"] == 6
    bounded = {name: value for name, value in numbers.items() if "share" in name or "corr" in name}
    assert {*bounded} == {"mean_depth_camera_dropped_share", "mean_depth_camera_clock_correlation"}
    assert all(0 <= value <= 1 for value in bounded.values())
    # the control: sums, as if they were counts, are beyond
    sums = metrics(summarised(quality.assign(unit="count")))
    assert sums["depth_camera_dropped_share"] > 1 and sums["depth_camera_clock_correlation"] > 1


def test_takes_stand_side_by_side_with_the_reason_why_one_is_left_out(quality):
    table = side_by_side(beside_limits(quality, {"clock_offset": 0.15, "dropped_share": 0.8}))
    table = table.set_index("take")
    assert list(table) == ["part", "dropped_share", "clock_offset (s)", "left_out", "reason"]
    assert table["dropped_share"].tolist() == SHARES
    assert table["left_out"].tolist() == [False, True, False, True]
    assert table["reason"].dropna().to_dict() == {
        "take_1": "dropped_share 0.9 beyond 0.8",
        "take_3": "clock_offset 0.2 beyond 0.15",
    }
    assert side_by_side(beside_limits(quality, {}))["reason"].isna().all()


def test_a_take_beyond_a_limit_is_left_out_and_one_at_the_limit_or_without_stays():
    takes = measured("residual_rms", {"a": 1e-3, "b": 1.001e-3, "c": 2e-4})
    takes = beside_limits(takes, {"residual_rms": 1e-3})
    assert takes[["take", "left_out"]].values.tolist() == [["a", False], ["b", True], ["c", False]]
    assert reasons(takes) == ["b (residual_rms 0.001 beyond 0.001)"]
    for limits in ({}, {"residual_rms": None}, vars(Limits())):
        takes = beside_limits(measured("residual_rms", {"a": 1e3}), limits)
        assert not takes["left_out"].any() and takes["limit"].isna().all() and reasons(takes) == []


def test_a_take_is_left_out_whole_for_one_measure_and_a_clock_may_drift_to_neither_side():
    tables = [
        measured("clock_drift", {"a": -0.05, "b": 0.01}, unit="s/s"),
        measured("residual_rms", {"a": 1e-4, "b": 1e-4}),
        measured("marker_samples", {"a": 1e6, "b": 1e6}, unit="count"),
    ]
    takes = beside_limits(pd.concat(tables), {"clock_drift": 0.02, "residual_rms": 1e-3})
    assert takes.loc[takes["take"] == "a", "left_out"].tolist() == [True, True]
    assert takes.loc[takes["take"] == "a", "beyond"].tolist() == [False, True]
    assert not takes.loc[takes["take"] == "b", "left_out"].any()
    assert set(takes["measure"]) == {"clock_drift", "residual_rms"}  # and no count of samples
    # to be less disturbed than others is no reason
    takes = beside_limits(measured("disturbance", {"a": -7.0, "b": 7.0}), {"disturbance": 6.0})
    assert takes["left_out"].tolist() == [False, True]


def test_fewer_than_two_takes_of_a_part_are_refused_by_the_limits_name():
    parts = {"training": {"a": 1e-4, "b": 1e-4}, "test": {"c": 5e-3, "d": 1e-4}}
    rows = pd.concat([measured("residual_rms", each, part) for part, each in parts.items()])
    words = r"1 test take\(s\) where 2.* c \(residual_rms 0.005.*dataset\.limits\.residual_rms"
    with pytest.raises(RecordingError, match=words):
        require_enough(beside_limits(rows, {"residual_rms": 1e-3}))
    require_enough(beside_limits(rows, {"residual_rms": 1e-2}))
    # a single take that no limit leaves out is for others to judge
    one = measured("residual_rms", {"a": 1e-4})
    require_enough(beside_limits(one, {"residual_rms": 1e-3}))
