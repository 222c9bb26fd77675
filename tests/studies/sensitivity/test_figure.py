"""The figure of the sensitivity: a symbol for every claim and variation, and what changed stands
out.
"""

from __future__ import annotations

import pytest
import study_tables
from matplotlib.patches import Rectangle

from pipeline.studies.claim_grid import LARGE, SMALL
from pipeline.studies.sensitivity.figures import sensitivity
from pipeline.studies.sensitivity.figures.sensitivity import SYMBOLS


@pytest.fixture
def axes():
    return sensitivity.draw(study_tables.sensitivity()).axes[0]


def symbols(axes) -> dict[tuple[int, int], object]:
    return {
        (int(line.get_xdata()[0]), int(line.get_ydata()[0])): line
        for line in axes.lines
        if line.get_linestyle() == "None"
    }


def test_every_claim_has_the_symbol_and_the_colour_of_its_verdict_in_every_variation(axes):
    expected = [["holds", "fails", "no evidence", "holds"], ["fails", "fails", "holds", "holds"]]
    drawn = symbols(axes)
    assert len(drawn) == 8
    for (x, y), line in drawn.items():
        style = SYMBOLS[expected[y][x]]
        assert (line.get_marker(), line.get_color()) == (style["marker"], style["color"])


def test_what_came_out_otherwise_is_shaded_and_large_and_only_that(axes):
    shaded = {
        (round(patch.get_x() + 0.5), round(patch.get_y() + 0.5))
        for patch in axes.patches
        if isinstance(patch, Rectangle)
    }
    assert shaded == {(1, 0), (2, 0), (2, 1), (3, 1)}
    for (x, y), line in symbols(axes).items():
        assert line.get_markersize() == (LARGE if x == 0 or (x, y) in shaded else SMALL)


def test_verdicts_are_told_apart_without_colour():
    assert len({style["marker"] for style in SYMBOLS.values()}) == len(SYMBOLS)


def test_claims_that_synthetic_recordings_do_not_decide_have_an_asterisk(axes):
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        "first claim",
        "second claim*",
    ]
    assert [label.get_text() for label in axes.get_xticklabels()] == [
        "base case",
        "not aligned",
        "other draws",
        "other takes",
    ]
