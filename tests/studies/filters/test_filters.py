"""Scores beside the training mean, durations, and the page that states both."""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd
import pytest

from pipeline.core import config
from pipeline.core.filters import MEMORY, NONE
from pipeline.filtering.particle_filter import FilterOptions
from pipeline.models.kinds import options_type
from pipeline.statistics.filters import Filtered, no_filter
from pipeline.studies.filters import stage
from pipeline.studies.filters.figures import filters as figure
from pipeline.studies.filters.stage import COVERAGE, LOG, RMS, YARDSTICK
from pipeline.studies.frame import Results

JOINTS = ["a", "b"]


def known() -> dict[str, Filtered]:
    """The training mean, and a filter whose errors are half of its."""
    rng = np.random.default_rng(1)
    training, test = (rng.standard_normal((n, 12, 2)) for n in (200, 40))
    mean = no_filter(training, test)
    half = Filtered(mean.error / 2, mean.covariance / 4, np.zeros((2, 2)))
    return {NONE: mean, "half": half}


def test_a_filter_of_half_the_error_has_half_the_rms_and_ln_2_more_a_joint():
    rows = stage.score_rows(known(), JOINTS)
    half = rows[rows["filter"] == "half"].set_index(["score", "joint"])
    ratio = stage.error_ratio(half)
    assert ratio[RMS, "a"] == pytest.approx(0.5) and ratio[RMS, "b"] == pytest.approx(0.5)
    assert half.loc[(LOG, "all"), "difference"] == pytest.approx(2 * np.log(2))
    covered = rows[rows["score"] == COVERAGE].groupby("filter")["mean"].mean()
    assert covered["half"] == covered[NONE] == pytest.approx(0.68, abs=0.05)
    flags = stage.better_or_worse(rows)
    assert flags["better"].all() and not flags["worse"].any()


@pytest.mark.slow
def test_long_deviations_are_filtered_and_short_ones_are_not(laboratory):
    model = ("additive", options_type("additive")("additive", estimator="paper"))
    trial = partial(
        stage.duration_rows,
        laboratory=laboratory,
        model=model,
        filter_options=FilterOptions(200, "systematic", 0.5),
        sizes=(20, 8),
        seed=3,
    )
    rows = {factor: trial(factor) for factor in (0.1, 10.0)}
    ratios = {}
    for factor, each in rows.items():
        errors = each[each["score"] == RMS]
        ratios[factor] = stage.error_ratio(errors).groupby(errors["filter"]).mean()
    assert rows[0.1]["left"].iloc[0] < 0.1 < 0.8 < rows[10.0]["left"].iloc[0]
    for name in (MEMORY, YARDSTICK, "additive_closed"):
        assert ratios[10.0][name] < 0.9 and ratios[10.0][name] < ratios[0.1][name]
    # the yardstick knows the law
    assert ratios[10.0][YARDSTICK] <= 1.1 * ratios[10.0].min()
    # equal random numbers give equal rows
    pd.testing.assert_frame_equal(trial(10.0), rows[10.0])


def test_the_page_and_the_figure_follow_the_tables():
    filters = known()
    rows = stage.score_rows(filters, JOINTS)
    best = rows[rows["filter"] == "half"].assign(filter=YARDSTICK)
    linear = best.assign(filter=MEMORY)
    rows = pd.concat([rows, linear, best], ignore_index=True)
    lasting = pd.concat(
        [rows.assign(factor=x, sway_time=0.01 * x, left=0.2 * x) for x in (1.0, 3.0)]
    )
    options = stage.Options(training=4, test=4, model="additive", factors=[1.0, 3.0])
    tables = {"filters": rows, "filters_lasting": lasting}
    page = "\n".join(stage.page(Results(None, options, tables, {"filters": "the figure"})))
    assert "opposite in none, beyond 95 % intervals: half, open loop." in page
    assert "half, open loop: 2 of 2 rms errors" in page and "the figure" in page
    worse = rows.assign(high=np.where(rows["score"] == LOG, -1.0, rows["high"]))
    tables["filters"] = worse.assign(low=np.where(rows["score"] == LOG, -2.0, rows["low"]))
    page = "\n".join(stage.page(Results(None, options, tables, {"filters": "the figure"})))
    assert "beyond 95 % intervals: none." in page
    axes = figure.draw(rows, lasting).axes
    labels = [text.get_text() for text in axes[0].get_yticklabels()]
    assert labels == ["half, open loop", "linear, autocorrelation", "yardstick"]


def test_a_dataset_without_a_depth_camera_has_no_answer(project, capsys):
    stage.run()
    assert "filters: it has no depth camera" in capsys.readouterr().out
    assert config.COMPOSED.exists()
