"""The page says what there is and what there is not, and takes no text for markup."""

from __future__ import annotations

from dataclasses import replace
from html import unescape

import pandas as pd
import pytest

from pipeline.audit.claims import decide, parse_claims
from pipeline.audit.comparison import NOTHING, compare_models
from pipeline.audit.errata import correct, parse_errata
from pipeline.audit.run import Run
from pipeline.audit.verdicts import GROUPS, Decided
from pipeline.report.graph import Stage, draw
from pipeline.report.illustrations import Download, Illustration
from pipeline.report.page import SHOWN, Content, readable, render
from pipeline.report.provenance import Costs

TEXTS = {key: f"the {key}" for key in ("where", "quantity", "reason")} | {"stage": "score", "value": {"file": "metrics/m", "key": "a"}}
CLAIMS = parse_claims(
    [
        TEXTS | {"id": "below", "about": "method", "statement": "less than <b>half</b> & more", "rule": "below", "limit": 0.5},
        TEXTS
        | {"id": "printed", "about": "specimen", "statement": "it is 0.25", "rule": "within_relative", "tolerance": 0.2, "published": 0.25},
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
STAGES = [Stage("fit", "parameters", [], ["data/fit/*"], []), Stage("score", "numbers", ["data/fit"], ["data/score"], ["fit"])]


def decided(value: float) -> Decided:
    return Decided("lab", "synthetic", decide(CLAIMS, {"metrics/m": {"a": value}}, "synthetic"))


@pytest.fixture
def content() -> Content:
    run = Run("lab", "smoke", True, {}, {"m": {"a": 0.3}}, {})
    return Content(
        dataset="lab", scale="smoke", decided=[decided(0.3)], comparisons=[compare_models(run)], player=None, illustrations=[],
        changes=None, errata=correct(parse_errata([ERRATUM]), {}, []), stages=STAGES, drawing=draw(STAGES), tables=[], options={"seed": 7},
        outputs=[], recordings=[], libraries={"numpy": "2.4"}, requirements="0" * 64,
        costs=Costs("a machine", "paper", [("fit", 61.25, 2.5)]),
    )  # fmt: skip


def test_verdicts_come_first_and_those_that_recordings_cannot_give_are_kept_apart(content):
    page = unescape(render(content))
    method, specimen = page.index(GROUPS["method"][0]), page.index(GROUPS["specimen"][0])
    assert method < page.index('id="claim-below"') < specimen < page.index('id="claim-printed"') < page.index('id="models"')
    assert "reproduced</span>" in page[method:specimen] and "cannot be decided with synthetic data</span>" in page[specimen:]
    assert "Published 0.25." in page


def test_the_time_of_every_stage_stands_with_the_machine_that_it_was_measured_on(content):
    page = render(content)
    assert "Time per stage on a machine, scale paper" in page
    assert "<td>61.2</td><td>2.5</td>" in page


def test_another_value_gives_another_verdict(content):
    page = render(replace(content, decided=[decided(0.7)]))
    assert 'class="badge no"' in page and 'class="badge no"' not in render(content)


def test_what_the_dataset_lacks_is_said_and_no_library_is_taken_along_for_it(content):
    page = render(content)
    assert "There is nothing to play" in page and NOTHING in page and "No variation was run" in page
    assert len(page) < 50_000


def test_no_text_is_taken_for_markup(content):
    figure = Illustration("f", "T<i>", "C", "", {}, "a.py", 'data:image/png;base64,"', [], ["fit"])
    page = render(replace(content, illustrations=[figure]))
    assert "less than &lt;b&gt;half&lt;/b&gt; &amp; more" in page and "T&lt;i&gt;" in page and 'base64,"' not in page


def test_what_is_played_cannot_end_its_script(content):
    frames = {"take": "a</script>", "models": {}, "figures": {}, "frames": []}
    page = render(replace(content, player=frames))
    assert "a\\u003c/script>" in page and "a</script>" not in page


def test_of_a_long_table_the_first_rows_are_shown_and_that_is_said(content):
    rows = pd.DataFrame({"model": "additive", "value": range(SHOWN + 5)})
    table = readable(Download("t.csv", "reports/tables/t.csv", len(rows), 9, "data:text/csv;base64,"), rows)
    assert len(table.rows) == SHOWN and table.rows[-1] == ["additive", str(SHOWN - 1)]
    assert f"the first {SHOWN} are shown" in render(replace(content, tables=[table]))
