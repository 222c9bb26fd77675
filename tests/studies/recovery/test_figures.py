"""What the figures of the estimators show: which marks and lines, of which numbers, on which
axes.
"""

from __future__ import annotations

import numpy as np
import study_tables

from pipeline.figures.style import LIGHT_GREY, RECORDED
from pipeline.studies.recovery.figures import parameter_recovery, sigma_b_choices


def marks(axes):
    """(N, 2) positions of the marks, row by row."""
    return np.concatenate([container.lines[0].get_xydata() for container in axes.containers])


def test_parameter_recovery_has_a_row_per_estimator_and_a_mark_per_parameter_that_has_a_symbol():
    figure = parameter_recovery.draw(study_tables.parameter_recovery(), study_tables.JOINTS)
    bias, coverage = figure.axes
    labels = [label.get_text().split(":")[0] for label in bias.get_yticklabels()]
    assert labels == ["additive", "wishart, true 0.25", "wishart ml, true 0.25"]
    # of the additive model the covariance is left out
    np.testing.assert_allclose(marks(bias)[:, 0], [-20, -20, -20])
    np.testing.assert_allclose(marks(coverage)[:, 0], [90, 90, 90])
    np.testing.assert_array_equal(marks(bias)[:, 1], marks(coverage)[:, 1])
    assert np.all(np.diff(marks(bias)[:, 1]) > 0) and bias.get_ylim()[0] > bias.get_ylim()[1]


def test_parameter_recovery_shows_every_interval_whole():
    bias = parameter_recovery.draw(study_tables.parameter_recovery(), study_tables.JOINTS).axes[0]
    low, high = bias.get_xlim()
    for container in bias.containers:
        (bars,) = container.lines[2]
        for segment in bars.get_segments():
            np.testing.assert_allclose(segment[:, 0], [-20 - 1.96, -20 + 1.96])
            assert low < segment[0, 0] and segment[1, 0] < high


def test_sigma_b_choices_draws_every_source_over_both_choices_and_marks_what_is_used():
    choices = study_tables.sigma_b_choices()
    figure = sigma_b_choices.draw(choices)
    for axes, column, used in zip(figure.axes, ("share", "floor"), (1.0, 0.2), strict=True):
        rows = choices.query(
            "varied == @name", local_dict={"name": {"share": "ratio"}.get(column, column)}
        )
        (marked,) = (line for line in axes.lines if line.get_color() == LIGHT_GREY)
        assert set(marked.get_xdata()) == {used}
        curves = [line for line in axes.lines if len(line.get_xdata()) == 3]
        expected = [
            rows[rows["source"] == source]
            for source in ("recorded", "drawn", "drawn without measurement noise")
        ]
        for curve, drawn in zip(curves, expected, strict=True):
            np.testing.assert_array_equal(curve.get_xydata(), drawn[[column, "sigma_b"]])
        assert curves[0].get_color() == RECORDED["color"]
        (truth,) = (line for line in axes.lines if line.get_linestyle() == ":")
        assert (
            set(truth.get_ydata()) == {0.25}
            and truth.get_color() == curves[1].get_color() == curves[2].get_color()
        )
    assert figure.axes[0].get_xscale() == "log"
