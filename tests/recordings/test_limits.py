"""The limits of a take: what is beyond any is left out and named, nothing else is, and two takes of
a part have to stay.
"""

from __future__ import annotations

import pandas as pd
import pytest
from pipeline.core.options.limits import Limits

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.recordings.limits import beside_limits, reasons, require_enough
from pipeline.recordings.quality import quality_row


def quality(residuals: dict[str, float], part: str = "training") -> pd.DataFrame:
    rows = [
        quality_row(take, part, "motion capture", "residual_rms", value, "m")
        for take, value in residuals.items()
    ]
    return pd.DataFrame(
        rows
        + [quality_row(take, part, "motion capture", "marker_samples", 1e6) for take in residuals]
    )


def test_a_take_beyond_a_limit_is_left_out_and_one_at_the_limit_stays():
    takes = beside_limits(quality({"a": 1e-3, "b": 1.001e-3, "c": 2e-4}), {"residual_rms": 1e-3})
    assert takes[["take", "left_out"]].values.tolist() == [["a", False], ["b", True], ["c", False]]
    assert reasons(takes) == ["b (residual_rms 0.001 beyond 0.001)"]


def test_without_a_stated_limit_no_take_is_left_out():
    for limits in ({}, {"residual_rms": None}, vars(Limits())):
        takes = beside_limits(quality({"a": 1e3}), limits)
        assert not takes["left_out"].any() and takes["limit"].isna().all() and reasons(takes) == []


def test_a_take_is_left_out_whole_for_one_measure_and_a_clock_may_drift_to_neither_side():
    drift = [
        quality_row(take, "training", "depth camera", "clock_drift", value, "s/s")
        for take, value in {"a": -0.05, "b": 0.01}.items()
    ]
    rows = pd.concat([pd.DataFrame(drift), quality({"a": 1e-4, "b": 1e-4})])
    takes = beside_limits(rows, {"clock_drift": 0.02, "residual_rms": 1e-3})
    assert takes.loc[takes["take"] == "a", "left_out"].tolist() == [True, True]
    assert takes.loc[takes["take"] == "a", "beyond"].tolist() == [False, True]
    assert not takes.loc[takes["take"] == "b", "left_out"].any()


def test_a_take_that_is_less_disturbed_than_others_stays():
    rows = [
        quality_row(take, "training", "joint log", "disturbance", value)
        for take, value in {"a": -7.0, "b": 7.0}.items()
    ]
    assert beside_limits(pd.DataFrame(rows), {"disturbance": 6.0})["left_out"].tolist() == [
        False,
        True,
    ]


def test_what_does_not_tell_how_good_a_take_is_does_not_enter_and_training_takes_come_first():
    rows = pd.concat([quality({"z": 1e-4}, "test"), quality({"y": 1e-4, "x": 1e-4})])
    takes = beside_limits(rows, {})
    assert set(takes["measure"]) == {"residual_rms"}
    assert takes["take"].tolist() == ["x", "y", "z"]


def test_fewer_than_two_takes_of_a_part_are_refused_by_the_limits_name():
    rows = pd.concat([quality({"a": 1e-4, "b": 1e-4}), quality({"c": 5e-3, "d": 1e-4}, "test")])
    with pytest.raises(
        RecordingError,
        match=r"1 test take\(s\) where 2.* c \(residual_rms 0.005.*dataset\.limits\.residual_rms",
    ):
        require_enough(beside_limits(rows, {"residual_rms": 1e-3}))
    require_enough(beside_limits(rows, {"residual_rms": 1e-2}))


def test_a_single_take_that_no_limit_leaves_out_is_for_others_to_judge():
    require_enough(beside_limits(quality({"a": 1e-4}), {"residual_rms": 1e-3}))


@pytest.mark.parametrize("limits", [{"residual_rms": -1e-3}, {"clock_drift": float("nan")}])
def test_a_limit_that_no_size_keeps_is_refused(limits):
    with pytest.raises(ConfigError, match=next(iter(limits))):
        Limits(**limits)
