"""How what was counted of each take is summed up: counts by their total, shares and correlations by
their mean, and row numbers not at all.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.recordings.limits import beside_limits
from pipeline.recordings.quality import metrics, quality_row, side_by_side, summarised

CAMERA, LOG = "depth camera", "joint log"
SHARES, CORRELATIONS = [0.2, 0.9, 0.4, 0.6], [0.999, 0.98, 0.97, 0.99]


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


def test_each_quantity_is_summed_up_as_its_unit_declares(quality):
    table = summarised(quality).set_index("quantity")
    assert table.loc["dropped_frames", "total"] == 6 and np.isnan(table["mean"]["dropped_frames"])
    for name, values in (("dropped_share", SHARES), ("clock_correlation", CORRELATIONS)):
        assert table.loc[name, "mean"] == pytest.approx(np.mean(values))
        assert np.isnan(table.loc[name, "total"])
        assert tuple(table.loc[name, ["least", "greatest"]]) == (min(values), max(values))
    assert "cut_rows" not in table.index


def test_no_share_and_no_correlation_of_the_metrics_is_greater_than_one(quality):
    numbers = metrics(summarised(quality))
    assert numbers["depth_camera_dropped_frames"] == 6
    bounded = {name: value for name, value in numbers.items() if "share" in name or "corr" in name}
    assert {*bounded} == {
        "mean_depth_camera_dropped_share",
        "mean_depth_camera_clock_correlation",
    }
    assert all(0 <= value <= 1 for value in bounded.values())
    # the control: sums, as if they were counts, are beyond
    sums = metrics(summarised(quality.assign(unit="count")))
    assert sums["depth_camera_dropped_share"] > 1 and sums["depth_camera_clock_correlation"] > 1


def test_the_same_quantity_of_two_instruments_is_summed_up_for_each(quality):
    other = quality[quality["quantity"] == "dropped_frames"].assign(instrument=LOG, value=2.0)
    numbers = metrics(summarised(pd.concat([quality, other])))
    assert (numbers["depth_camera_dropped_frames"], numbers["joint_log_dropped_frames"]) == (6, 8)


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
