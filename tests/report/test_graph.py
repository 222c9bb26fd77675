"""The graph of the stages has an arrow for every direct dependency and no other, and no box on another."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import pytest

from pipeline.report.graph import HEIGHT, WIDTH, Stage, draw, read_stages
from pipeline.stages.page import EXPERIMENT
from pipeline.typed_yaml import read_yaml

ROOT = Path(__file__).parents[2]
TEXT = """
stages:
  configure: # options → one configuration
    cmd: a
  fit: # parameters
    cmd: b
  score:
    cmd: c
  figures: # pictures
    cmd: d
"""
DEFINITIONS = {
    "configure": {"outs": [{"data/config.yaml": {"cache": False}}]},
    "fit": {"deps": ["data/raw/${dataset}"], "params": [{"data/config.yaml": ["seed"]}], "outs": ["data/fit/${item.model}"],
            "metrics": [{"reports/metrics/fit_${item.model}.json": {"cache": False}}]},
    "score": {"deps": ["data/fit"], "params": [{"data/config.yaml": ["seed"]}], "outs": ["data/score"]},
    "figures": {"deps": ["data/score", "data/fit/${item.model}", "reports/metrics"], "outs": ["reports/figures"]},
}  # fmt: skip


@pytest.fixture
def stages() -> list[Stage]:
    file = ROOT / "dvc.yaml"
    return read_stages(file.read_text(), read_yaml(file)["stages"], "youbot")


def test_a_stage_follows_directly_those_that_no_other_way_leads_to():
    found = {stage.name: stage for stage in read_stages(TEXT, DEFINITIONS, "lab")}
    assert {name: stage.after for name, stage in found.items()} == {
        "configure": [], "fit": ["configure"], "score": ["fit"], "figures": ["score"],
    }  # fmt: skip
    assert found["fit"].what == "parameters" and found["score"].what == ""
    assert found["fit"].reads == ["data/raw/lab"]
    assert found["fit"].writes == ["data/fit/*", "reports/metrics/fit_*.json"]


def test_a_way_through_a_metric_of_a_matrix_is_one():
    definitions = {"fit": DEFINITIONS["fit"], "report": {"deps": ["reports/metrics/fit_additive.json"], "outs": ["reports/report.md"]}}
    assert read_stages("", definitions, "lab")[1].after == ["fit"]
    definitions["report"]["deps"] = ["reports/metrics/filter_additive.json"]
    assert read_stages("", definitions, "lab")[1].after == []


def test_the_experiments_stages_all_say_what_they_do_and_lead_to_the_page(stages):
    assert all(stage.what for stage in stages)
    followed = {other for stage in stages for other in stage.after}
    assert {stage.name for stage in stages} - followed == {"page"}


def test_no_box_of_the_drawing_lies_on_another_or_outside(stages):
    drawing = draw(stages)
    assert [box.name for box in drawing.boxes] == [stage.name for stage in stages]
    for one, other in combinations(drawing.boxes, 2):
        assert abs(one.x - other.x) >= WIDTH or abs(one.y - other.y) >= HEIGHT
    assert all(0 <= box.x <= drawing.width - WIDTH and 0 <= box.y <= drawing.height - HEIGHT for box in drawing.boxes)


def test_every_arrow_leads_down_from_its_stage_to_the_one_that_follows(stages):
    drawing = draw(stages)
    at = {box.name: box for box in drawing.boxes}
    ends = []
    for arrow in drawing.arrows:
        x0, y0 = map(float, arrow.split("C")[0].removeprefix("M").split())
        x1, y1 = map(float, arrow.split()[-2:])
        start = next(name for name, box in at.items() if (box.x + WIDTH / 2, box.y + HEIGHT) == (x0, y0))
        end = next(name for name, box in at.items() if (box.x + WIDTH / 2, box.y - 4) == (x1, y1))
        assert at[start].y < at[end].y
        ends.append((start, end))
    assert sorted(ends) == sorted((other, stage.name) for stage in stages for other in stage.after)


def test_what_the_page_depends_on_in_the_experiments_place_is_the_experiment():
    assert EXPERIMENT.read_bytes() == Path("dvc.yaml").read_bytes()
