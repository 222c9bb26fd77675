"""Filters against no filter: differences, shares of the gain, verdicts."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.filters import NONE
from pipeline.statistics.filters import Filtered
from pipeline.studies.filters.scores import (
    AT_REST,
    COVERAGE,
    INFORMED,
    LOG,
    RMS,
    over_none,
    placed,
    scored,
    verdicts,
)

JOINTS = ("a", "b")


@pytest.fixture(scope="module")
def rows():
    """Errors of three sizes, each stated as it is, of 12 takes of 50 steps."""
    rng = np.random.default_rng(6)
    unit = rng.standard_normal((12, 50, 2))

    def of_size(size: float) -> Filtered:
        covariance = np.broadcast_to(size**2 * np.eye(2), (12, 50, 2, 2))
        return Filtered(size * unit, covariance, np.zeros((2, 2)))

    filters = {
        NONE: of_size(2.0),
        "good": of_size(1.5),
        INFORMED: of_size(1.0),
        "bad": of_size(3.0),
    }
    return scored(filters, JOINTS, np.arange(50) < 10)


def test_the_share_gained_runs_from_no_filter_to_the_informed_yardstick(rows):
    gained = placed(rows).set_index(["filter", "score", "joint"])["gained"]
    assert gained[("good", RMS, "a")] == pytest.approx(0.5)
    assert gained[("bad", RMS, "b")] == pytest.approx(-1.0)
    assert gained[(INFORMED, LOG, "all")] == pytest.approx(1.0)
    assert np.isnan(gained[(NONE, RMS, "a")]) and np.isnan(gained[("good", COVERAGE, "a")])


def test_there_is_no_share_of_what_the_yardstick_does_not_gain(rows):
    worse = rows.replace({"filter": {INFORMED: "bad", "bad": INFORMED}})
    assert placed(worse)["gained"].isna().all()


def test_a_filter_is_better_or_worse_beyond_its_interval(rows):
    decided = verdicts(rows)
    by_filter = decided.groupby("filter")[["better", "worse"]].all()
    assert by_filter.loc["good"].tolist() == [True, False]
    assert by_filter.loc["bad"].tolist() == [False, True]
    # control: an interval that holds zero
    neither = verdicts(rows.assign(low=-1.0, high=1.0))
    assert not neither[["better", "worse"]].to_numpy().any()


def test_errors_are_told_over_no_filter_s_and_steps_at_rest_by_themselves(rows):
    ratio = rows.assign(ratio=over_none(rows)).set_index(["filter", "score", "joint"])["ratio"]
    assert ratio[("good", RMS, "a")] == pytest.approx(0.75) and ratio[(NONE, RMS, "b")] == 1
    logs = rows.set_index(["filter", "score"])["mean"]
    assert logs[("good", AT_REST)] != logs[("good", LOG)]
