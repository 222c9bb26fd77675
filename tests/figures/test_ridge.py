"""The figures of what the fits leave open: the ridge of (α, u), and σ̂_B over the weight."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.figures import ridge, sigma_b_over_weight
from pipeline.figures.style import VERMILLION


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


def test_sigma_b_over_the_weight_has_a_named_line_for_each_source_and_the_moment_estimate(tables):
    table = tables["sigma_b_weights"]
    figure = sigma_b_over_weight.draw(table, ["additive", "wishart"])
    (axes,) = figure.axes
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert len(axes.lines) == len(labels) == len({*labels}) == 5
    by_label = {line.get_label(): line for line in axes.lines}
    recorded = table[(table["source"] == "recorded") & (table["point"] == "curve")]
    np.testing.assert_array_equal(by_label["recorded takes"].get_ydata(), recorded["sigma_b"])
    assert [*by_label["weight that returns it"].get_xdata()] == [5e-3, 5e-5]
    assert axes.get_xscale() == "log" and "rad" in axes.get_xlabel()
    # two models, the second in no other figure and without a moment estimate
    other = table[table["point"] != "moments"].assign(model="wishart_ml")
    assert len(sigma_b_over_weight.draw(pd.concat([table, other]), ["wishart"]).axes) == 2
