"""The figure of a survey: a symbol for every claim and level, and what turns stands out."""

from __future__ import annotations

import pandas as pd
import pytest
from matplotlib.colors import to_rgba
from matplotlib.patches import Rectangle

from pipeline.figures.style import BLUE, VERMILLION
from pipeline.studies.claim_grid import LARGE, SMALL
from pipeline.studies.survey.figure import MARKERS, draw, word_of

LEVELS = [("base condition", ""), ("clearance", "0"), ("clearance", "2")]
COUNTS = {  # claim → holds and fails of 4 conditions at each level
    ("motion", "first-claim", "method"): [(4, 0), (4, 0), (1, 3)],
    ("motion", "second-claim", "robots"): [(0, 4), (4, 0), (0, 0)],
    ("wrench", "third-claim", "method"): [(4, 0)],
}


@pytest.fixture
def panels():
    rows = [
        {
            "study": study,
            "factor": factor,
            "level": level,
            "claim": claim,
            "about": about,
            "conditions": 4,
            "holds": holds,
            "fails": fails,
        }
        for (study, claim, about), counts in COUNTS.items()
        for (factor, level), (holds, fails) in zip(LEVELS, counts, strict=False)
    ]
    return draw(pd.DataFrame(rows)).axes


def symbols(axes) -> dict[tuple[int, int], object]:
    return {
        (int(line.get_xdata()[0]), int(line.get_ydata()[0])): line
        for line in axes.lines
        if line.get_linestyle() == "None"
    }


def test_every_claim_has_the_symbol_of_its_counts_at_every_level(panels):
    expected = [["all", "all", "some"], ["none", "all", "no evidence"]]
    drawn = symbols(panels[0])
    assert len(drawn) == 6
    assert {place: line.get_marker() for place, line in drawn.items()} == {
        (x, y): MARKERS[word] for y, words in enumerate(expected) for x, word in enumerate(words)
    }
    assert to_rgba(drawn[0, 0].get_color()) == to_rgba(BLUE) and to_rgba(
        drawn[0, 1].get_color()
    ) == to_rgba(VERMILLION)
    # a quarter that holds is nearer to failing
    red, _, blue, _ = to_rgba(drawn[2, 0].get_color())
    assert red > blue


def test_what_turned_is_shaded_and_large_and_only_that(panels):
    shaded = {
        (round(patch.get_x() + 0.5), round(patch.get_y() + 0.5))
        for patch in panels[0].patches
        if isinstance(patch, Rectangle)
    }
    assert shaded == {(2, 0), (1, 1), (2, 1)}
    sizes = {place: line.get_markersize() for place, line in symbols(panels[0]).items()}
    assert sizes[1, 0] == SMALL and sizes[0, 0] == sizes[1, 1] == LARGE


def test_each_study_has_its_panel_and_claims_that_synthetic_conditions_do_not_decide_an_asterisk(
    panels,
):
    labels = [[label.get_text() for label in axes.get_yticklabels()] for axes in panels]
    assert ["first claim", "second claim*"] in labels and ["third claim"] in labels
    assert [label.get_text() for label in panels[0].get_xticklabels()] == ["", "0", "2"]


@pytest.mark.parametrize(
    ("holds", "fails", "word"),
    [(2, 0, "all"), (0, 2, "none"), (1, 1, "some"), (0, 0, "no evidence")],
)
def test_the_word_is_that_of_the_conditions_with_evidence(holds, fails, word):
    assert word_of(holds, fails) == word and len(set(MARKERS.values())) == 4
