"""What the figures of the estimators show: which marks and lines, of which numbers, on which axes."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.figures import parameter_recovery, ridge, sigma_b_choices
from pipeline.figures.style import LIGHT_GREY, RECORDED, VERMILLION


def marks(axes):
    """(N, 2) positions of the marks, row by row."""
    return np.concatenate([container.lines[0].get_xydata() for container in axes.containers])


def test_parameter_recovery_has_a_row_per_estimator_and_a_mark_per_parameter_that_has_a_symbol(tables):
    figure = parameter_recovery.draw(tables["parameter_recovery"])
    bias, coverage = figure.axes
    labels = [label.get_text().split(":")[0] for label in bias.get_yticklabels()]
    assert labels == ["additive", "wishart, true 0.25", "wishart ml, true 0.25"]
    # of the additive model the covariance is left out
    np.testing.assert_allclose(marks(bias)[:, 0], [-20, -20, -20])
    np.testing.assert_allclose(marks(coverage)[:, 0], [90, 90, 90])
    np.testing.assert_array_equal(marks(bias)[:, 1], marks(coverage)[:, 1])
    assert np.all(np.diff(marks(bias)[:, 1]) > 0) and bias.get_ylim()[0] > bias.get_ylim()[1]


def test_parameter_recovery_shows_every_interval_whole(tables):
    bias = parameter_recovery.draw(tables["parameter_recovery"]).axes[0]
    low, high = bias.get_xlim()
    for container in bias.containers:
        (bars,) = container.lines[2]
        for segment in bars.get_segments():
            np.testing.assert_allclose(segment[:, 0], [-20 - 1.96, -20 + 1.96])
            assert low < segment[0, 0] and segment[1, 0] < high


def test_sigma_b_choices_draws_every_source_over_both_choices_and_marks_what_is_used(tables):
    figure = sigma_b_choices.draw(tables["sigma_b_choices"])
    for axes, column, used in zip(figure.axes, ("share", "floor"), (1.0, 0.2), strict=True):
        rows = tables["sigma_b_choices"].query("varied == @name", local_dict={"name": {"share": "ratio"}.get(column, column)})
        (marked,) = (line for line in axes.lines if line.get_color() == LIGHT_GREY)
        assert set(marked.get_xdata()) == {used}
        curves = [line for line in axes.lines if len(line.get_xdata()) == 3]
        expected = [rows[rows["source"] == source] for source in ("recorded", "drawn", "drawn without measurement noise")]
        for curve, of_source in zip(curves, expected, strict=True):
            np.testing.assert_array_equal(curve.get_xydata(), of_source[[column, "sigma_b"]])
        assert curves[0].get_color() == RECORDED["color"]
        (truth,) = (line for line in axes.lines if line.get_linestyle() == ":")
        assert set(truth.get_ydata()) == {0.25} and truth.get_color() == curves[1].get_color() == curves[2].get_color()
    assert figure.axes[0].get_xscale() == "log"


def test_ridge_has_a_row_of_panels_per_gaussian_model_and_a_dot_at_the_best_bound(tables):
    both = [tables["ridges"], tables["ridges"].assign(model="gaussian_ml")]
    for count in (1, 2):
        figure = ridge.draw(pd.concat(both[:count]), ["additive", "gaussian", "gaussian_ml"])
        assert len(figure.axes) == 2 * count
        excess, shape = figure.axes[:2]
        line, dot = excess.lines
        np.testing.assert_array_equal(line.get_ydata(), tables["ridges"]["excess"])
        assert dot.get_color() == VERMILLION and dot.get_xdata()[0] == 18.0
        alpha, level = shape.lines[:2]
        np.testing.assert_allclose(alpha.get_ydata(), 18.0 / tables["ridges"]["u"])
        np.testing.assert_array_equal(level.get_ydata(), 1.0)
