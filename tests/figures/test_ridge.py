"""The figure of the ridge: a row of panels per Gaussian model, a dot at the best bound."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.figures import ridge
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
