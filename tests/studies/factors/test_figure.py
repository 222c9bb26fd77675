"""The figure has a line and a bar for every reading, of the numbers that the table has."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.figures.style import BLUE, GREY, SKY
from pipeline.studies.factors.figures import factors


def table() -> pd.DataFrame:
    """Two orders of LU, one of them on no path, and QR of J, which is too wide."""
    rows = pd.DataFrame(
        {
            "factorisation": ["lu", "lu", "qr"],
            "rows": "x z φ",
            "joints": ["1-2-3", "1-3-2", "1-2-3"],
            "but_wider": [0.2, np.nan, 0.0],
            "all": [0.1, np.nan, 0.0],
        }
    )
    for name, factor in {
        "least": 0.7,
        "low": 0.8,
        "median": 1,
        "high": 1.2,
        "greatest": 90,
    }.items():
        rows[f"ratio_{name}"] = factor * np.array([1.0, np.nan, 3.0])
    other = rows.assign(but_wider=0.9, rest=0.0, speed="limit", subset="all")
    return pd.concat([other, rows.assign(rest=0.0, speed="matched", subset="all")])


def test_lines_and_bars_are_those_of_the_matched_speed_and_grey_where_nothing_holds():
    figure = factors.draw(table(), 2.0)
    ratio, share = figure.axes
    assert [label.get_text() for label in ratio.get_yticklabels()] == ["LU, x z φ", "QR of $J$"]
    thick = [line for line in ratio.lines if line.get_linewidth() == 1.6]
    np.testing.assert_allclose([line.get_xdata() for line in thick], [[0.8, 1.2], [2.4, 3.6]])
    assert thick[0].get_color() != GREY and thick[1].get_color() == GREY
    # what goes beyond the axis ends there with an arrow
    assert sum(line.get_marker() == ">" for line in ratio.lines) == 2
    widths = {
        colour: [
            bar.get_width() for bar in share.patches if bar.get_facecolor()[:3] == to_rgb(colour)
        ]
        for colour in (SKY, BLUE)
    }
    np.testing.assert_allclose(widths[SKY], [20, np.nan, 0])
    np.testing.assert_allclose(widths[BLUE], [10, np.nan, 0])
    assert [text.get_text().strip() for text in share.texts] == ["none: too wide"]
    assert "on no path" in [text.get_text() for text in ratio.texts]


def to_rgb(colour: str) -> tuple[float, ...]:
    return tuple(int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
