"""The graph of the stages has an arrow for every direct dependency and no other, and no box on
another.
"""

from __future__ import annotations

from itertools import combinations

import pytest

from pipeline.tools.page.graph import HEIGHT, WIDTH, draw
from pipeline.tools.page.stages import Stage

FOLLOWS = {
    "configure": [],
    "record": ["configure"],
    "ingest": ["configure", "record"],
    "track": ["ingest"],
    "fit": ["track"],
    "filter": ["fit"],
    "wrench": ["ingest"],
    "score": ["filter", "wrench"],
    "recovery": ["fit"],
    "figures": ["score"],
}


@pytest.fixture
def stages() -> list[Stage]:
    return [Stage(name, "", [], after) for name, after in FOLLOWS.items()]


def test_no_box_of_the_drawing_lies_on_another_or_outside(stages):
    drawing = draw(stages)
    assert [box.name for box in drawing.boxes] == [stage.name for stage in stages]
    for one, other in combinations(drawing.boxes, 2):
        assert abs(one.x - other.x) >= WIDTH or abs(one.y - other.y) >= HEIGHT
    assert all(
        0 <= box.x <= drawing.width - WIDTH and 0 <= box.y <= drawing.height - HEIGHT
        for box in drawing.boxes
    )


def test_every_arrow_leads_down_from_its_stage_to_the_one_that_follows(stages):
    drawing = draw(stages)
    at = {box.name: box for box in drawing.boxes}
    ends = []
    for arrow in drawing.arrows:
        x0, y0 = map(float, arrow.split("C")[0].removeprefix("M").split())
        x1, y1 = map(float, arrow.split()[-2:])
        start = next(
            name for name, box in at.items() if (box.x + WIDTH / 2, box.y + HEIGHT) == (x0, y0)
        )
        end = next(name for name, box in at.items() if (box.x + WIDTH / 2, box.y - 4) == (x1, y1))
        assert at[start].y < at[end].y
        ends.append((start, end))
    assert sorted(ends) == sorted((other, stage.name) for stage in stages for other in stage.after)
