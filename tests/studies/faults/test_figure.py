"""The figure of the faults: a mark for every severity of a fault that is not always refused, at
what it costs.
"""

from __future__ import annotations

import pytest
import study_tables

from pipeline.studies.faults.figures import faults
from pipeline.studies.faults.figures.faults import CIRCLE, CROSS, DIAMOND, SHADES, UNNOTICED


@pytest.fixture
def panels():
    return faults.draw(study_tables.faults()).axes


def marks(axes, marker: str) -> list[tuple[float, str]]:
    return [
        (line.get_xdata()[0], line.get_markerfacecolor())
        for line in axes.lines
        if line.get_marker() == marker
    ]


def test_each_severity_has_a_mark_at_the_error_it_leaves(panels):
    take, depth, force = panels
    assert marks(take, CIRCLE["marker"]) == [(1.0, SHADES[0]), (2.0, SHADES[1])]
    assert marks(depth, CIRCLE["marker"]) == [(1.0, SHADES[0]), (1.0, SHADES[1]), (2.0, SHADES[2])]
    assert [x for x, _ in marks(force, CIRCLE["marker"])] == [faults.LEAST, 0.1, 1.0]


def test_what_was_refused_is_a_cross_and_what_always_was_is_not_drawn(panels):
    take = panels[0]
    assert [len(marks(axes, CROSS["marker"])) for axes in panels] == [1, 0, 0]
    assert [label.get_text() for label in take.get_yticklabels()] == ["dropped"]
    assert marks(take, CROSS["marker"])[0][0] > 2.0


def test_what_nobody_noticed_looks_like_no_repair():
    table = study_tables.faults()
    table.loc[table["instrument"] == "depth camera", "outcome"] = UNNOTICED
    take, depth, _ = faults.draw(table).axes
    assert [x for x, _ in marks(depth, DIAMOND["marker"])] == [1.0, 1.0, 2.0] and not marks(
        depth, CIRCLE["marker"]
    )
    assert not marks(take, DIAMOND["marker"])
