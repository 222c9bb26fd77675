"""The page says what there is and what there is not, and takes no text for markup."""

from __future__ import annotations

import json
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest
from markupsafe import Markup

from pipeline.tools.page.graph import draw
from pipeline.tools.page.illustrations import Illustration, Table
from pipeline.tools.page.page import Content, beside, player_script, render, render_studies
from pipeline.tools.page.pictures import Picture
from pipeline.tools.page.player import Player
from pipeline.tools.page.plots import Axis, Panel, Plot, Shape
from pipeline.tools.page.provenance import Costs
from pipeline.tools.page.stages import Stage, StageRun
from pipeline.tools.page.study_pages import StudyPage
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import Decided, decide
from pipeline.verdicts.errata import correct, parse_errata
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import GROUPS

TEXTS = {key: f"the {key}" for key in ("where", "quantity", "reason")} | {
    "stage": "score",
    "value": {"file": "metrics/m", "key": "a"},
}
BELOW = {
    "id": "below",
    "about": "method",
    "statement": "less than <b>half</b> & more",
    "rule": "below",
    "limit": 0.5,
}
CLAIMS = parse_claims(
    [
        TEXTS | BELOW,
        TEXTS
        | {
            "id": "printed",
            "about": "specimen",
            "statement": "it is 0.25",
            "rule": "within_relative",
            "tolerance": 0.2,
            "published": 0.25,
        },
    ]
)
ERRATUM = {
    "id": "sign",
    "title": "A sign",
    "place": "Eq. 1",
    "paper": "minus",
    "fact": "plus",
    "done": "plus",
    "tests": ["tests/a.py::test_b"],
}
STAGES = [
    Stage("fit", "parameters", ["data/fit/*"], []),
    Stage("score", "numbers", ["data/score"], ["fit"]),
]
RUN = Run("lab", "smoke", True, ["a", "b", "c"], ["x", "z", "phi"], {}, {"m": {"a": 0.3}}, {})


def decided(value: float) -> Decided:
    verdicts = decide(CLAIMS, {"metrics/m": {"a": value}}, "synthetic", RUN.arm)
    return Decided("lab", "synthetic", verdicts)


@pytest.fixture
def content() -> Content:
    return Content(
        dataset="lab",
        scale="smoke",
        decided=[decided(0.3)],
        player=None,
        illustrations=[],
        studies=[],
        errata=correct(parse_errata([ERRATUM]), RUN, []),
        stages=STAGES,
        drawing=draw(STAGES),
        tables=[],
        options={"seed": 7},
        outputs=[StageRun("fit@a", "fit", "", "fit.py", {}, {"data/fit/a": "0f.dir"})],
        recordings=[],
        libraries={"numpy": "2.4"},
        requirements="0" * 64,
        costs=Costs("a machine", "paper", [("fit", 61.25, 2.5)]),
    )


def test_verdicts_come_first_and_those_that_recordings_cannot_give_are_kept_apart(content):
    page = unescape(render(content))
    method, specimen = page.index(GROUPS["method"][0]), page.index(GROUPS["specimen"][0])
    assert (
        method
        < page.index('id="claim-below"')
        < specimen
        < page.index('id="claim-printed"')
        < page.index('id="player"')
    )
    assert (
        "reproduced</span>" in page[method:specimen]
        and "cannot be decided with synthetic data</span>" in page[specimen:]
    )
    assert "Published 0.25." in page


def test_the_time_of_every_stage_stands_with_the_machine_that_it_was_measured_on(content):
    page = render(content)
    assert "Time per stage on a machine, scale paper" in page
    assert "<td>61.2</td><td>2.5</td>" in page


def test_another_value_gives_another_verdict(content):
    page = render(replace(content, decided=[decided(0.7)]))
    assert 'class="badge no"' in page and 'class="badge no"' not in render(content)


def test_a_claim_that_fails_says_why_for_its_dataset_alone(content):
    why = {"why": {"lab": "its arm is short", "other": "its arm is long"}}
    claims = parse_claims([TEXTS | BELOW | why])
    for value, reasons in ((0.7, 1), (0.3, 0)):
        verdicts = decide(claims, {"metrics/m": {"a": value}}, "synthetic", RUN.arm)
        shown = [Decided("lab", "synthetic", verdicts)]
        page = render(replace(content, decided=shown))
        assert page.count("its arm is short") == reasons and "its arm is long" not in page


def test_what_there_is_not_is_said(content):
    page = render(content)
    assert "There is nothing to play" in page and "No study has run" in page
    assert len(page) < 50_000


def test_no_text_is_taken_for_markup(content):
    picture = Picture(Path('reports/figures/f".png'), 3, 2)
    figure = Illustration("f", "T<i>", "C", "", {}, "a.py", picture, [], ["fit"])
    page = render(replace(content, illustrations=[figure]))
    assert (
        "less than &lt;b&gt;half&lt;/b&gt; &amp; more" in page
        and "T&lt;i&gt;" in page
        and 'f".png' not in page
    )


def test_what_is_played_stands_beside_the_page_the_outlines_in_the_order_of_the_shapes(content):
    panels = [Panel(Axis(0, 1, 9), Axis(0, 1, 9), 0, 0, "", [Shape(p, "")]) for p in ("M0", "M1")]
    plot = Plot(10, 10, panels)
    player = Player("test_001", [], {"a": ("A", "")}, plot, {"a": plot}, {"a": plot}, (4, 3), None,
                    True, [{"t": "0.25"}])  # fmt: skip
    page = render(replace(content, player=player))
    script = player_script(player)
    played = json.loads(script.removeprefix("window.played = ").removesuffix(";\n"))
    assert played["frames"] == [{"t": "0.25"}]
    assert [*played["paths"]] == ["play-joints", "play-error-a", "play-spread-a"]
    assert [*played["paths"].values()] == 3 * [["M0", "M1"]]
    assert all(f'id="{name}"' in page for name in played["paths"])
    assert page.count('class="shape"') == 6 and 'src="player.js"' in page
    assert player_script(None) == "window.played = null;\n" and 'src="player.js"' not in render(
        content
    )


def test_a_study_is_shown_as_its_page_says(content):
    study = StudyPage(
        "faults", "What faults cost", Path("reports/studies/faults.md"), Markup("<p>Much.</p>")
    )
    page = render_studies([study])
    assert "What faults cost" in page and "<p>Much.</p>" in page
    assert '<a href="studies/faults.md">' in page and "No study has run" not in page
    linked = render(replace(content, studies=[study]))
    assert '<a href="studies.html#study-faults">faults</a>: What faults cost' in linked
    assert 'id="study-faults"' in page and "No study has run" not in linked


def test_of_a_long_table_the_first_rows_are_shown_and_that_is_said(content):
    file = Path("reports/tables/t.csv")
    page = render(replace(content, tables=[Table(file, 1234, 9, ["a"], [["x"], ["y"]])]))
    assert "the first 2 are shown" in page and "(1,234 rows, 1 kB)" in page
    whole = render(replace(content, tables=[Table(file, 2, 9, ["a"], [["x"], ["y"]])]))
    assert "are shown" not in whole and '<a href="tables/t.csv">' in whole


def test_files_are_addressed_from_where_the_page_lies():
    assert beside(Path("reports/tables/a.csv")) == "tables/a.csv"
    assert beside(Path("data/score/a.parquet")) == "../data/score/a.parquet"
