"""One duration of the sweep: every filter on the same takes, and again the same."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core import config
from pipeline.core.filters import MEMORY
from pipeline.filtering.particle_filter import FilterOptions
from pipeline.studies.filters.lasting import Sweep, lasted
from pipeline.studies.filters.scores import COVERAGE, RMS, YARDSTICK, over_none


@pytest.fixture(scope="module")
def sweep(laboratory) -> Sweep:
    model = config.model_options(["additive"])["additive"]
    options = FilterOptions(200, "systematic", 0.5)
    return Sweep(laboratory, "additive", model, options, 30, 12, 5)


@pytest.mark.slow
def test_the_longer_a_deviation_lasts_the_more_the_yardstick_gains(sweep):
    brief, long = (lasted(factor, sweep) for factor in (0.2, 5.0))
    pd.testing.assert_frame_equal(long, lasted(5.0, sweep))
    assert brief["left"].max() < 0.3 < 0.8 < long["left"].min()
    assert set(long["filter"]) >= {"none", "additive_closed", MEMORY, YARDSTICK}
    gains = []
    for rows in (brief, long):
        best = rows[(rows["filter"] == YARDSTICK) & (rows["score"] == RMS)]
        gains.append(over_none(best).mean())
    assert gains[1] < 0.8 < gains[0] < 1.01
    covered = long[(long["filter"] == YARDSTICK) & (long["score"] == COVERAGE)]["mean"]
    assert np.all(np.abs(covered - 0.68) < 0.1)
