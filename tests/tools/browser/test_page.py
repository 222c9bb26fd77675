"""The page in a browser: everything is there, it asks nobody, fits a phone, and
is accessible.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import pandas as pd
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from pipeline.tools.page.illustrations import SHOWN

pytestmark = pytest.mark.slow

SLIDER = "#play-slider"
LARGEST = 400_000  # bytes of a file


def test_every_claim_has_its_verdict_for_every_dataset(opened, results):
    claims = json.loads((results / "reports/claims.json").read_text())
    assert [each["dataset"] for each in claims["datasets"]] == ["youbot", "another"]
    for claim in claims["claims"]:
        shown = opened.page.locator(f"#claim-{claim['id']}")
        assert claim["statement"] in shown.locator(".statement").inner_text()
        verdicts = [text.split(maxsplit=1)[1] for text in shown.locator(".badge").all_inner_texts()]
        assert verdicts == [each["verdict"] for each in claim["datasets"].values()]


def test_a_claim_opens_by_keyboard_and_shows_its_numbers_and_how_to_recompute_them(opened):
    claim = opened.page.locator("#claim-mean-error")
    assert not claim.locator(".evidence").is_visible()
    claim.locator("summary").focus()
    opened.page.keyboard.press("Enter")
    text = claim.locator(".evidence").inner_text()
    assert "Published: 0.02" in text and "wishart: " in text and "dvc repro score" in text
    assert "reports/metrics/motion.json: wishart_greatest_mean_error_rad" in text


def test_every_figure_is_there_with_a_text_for_those_who_do_not_see_it(opened, results):
    captions = json.loads((results / "reports/figures/captions.json").read_text())
    assert captions
    for name, caption in captions.items():
        figure = opened.page.locator(f"#figure-{name}")
        image = figure.locator("img")
        image.scroll_into_view_if_needed()
        image.evaluate("image => image.decode()")
        assert image.evaluate("image => image.naturalWidth") > 100
        assert image.get_attribute("alt").startswith(caption["title"])
        assert caption["script"] in figure.inner_text()


def test_every_table_can_be_taken_from_beside_the_page(opened, results):
    page = opened.page
    links = page.evaluate("[...document.links].map((a) => a.getAttribute('href'))")
    files = {(results / "reports" / link.split("#")[0]).resolve() for link in links}
    files -= {(results / "reports").resolve()}  # of links within the page
    assert sorted(file for file in files if not file.is_file()) == []
    reported = set((results / "reports/tables").glob("*.csv"))
    captions = json.loads((results / "reports/figures/captions.json").read_text())
    behind = {
        results / source
        for caption in captions.values()
        for source in caption["sources"]
        if source.endswith(".parquet")
        and not (results / f"reports/tables/{Path(source).stem}.csv").is_file()
    }
    assert reported and behind and {file.resolve() for file in reported | behind} <= files


def test_the_first_rows_of_a_table_are_the_files(opened, results):
    rows = pd.read_csv(results / "reports/tables/wrench_study.csv")
    shown = opened.page.locator("#table-wrench_study\\.csv")
    shown.locator("summary").click()
    assert shown.locator("tbody tr").count() == min(len(rows), SHOWN)
    cells = shown.locator("tbody tr").first.locator("td").all_inner_texts()
    assert [float(cell.replace(",", "")) for cell in cells[1:3]] == pytest.approx(
        rows.iloc[0, 1:3].astype(float).tolist(), rel=1e-3
    )


def test_a_study_is_one_link_away_with_its_figure(opened):
    opened.page.locator("#studies li a", has_text="drawn").click()
    study = opened.page.locator("#study-drawn")
    assert "What a study finds" in study.inner_text()
    study.locator("img").evaluate("image => image.decode()")
    assert study.locator("img").evaluate("image => image.naturalWidth") == 300
    assert opened.errors == [] and violations(opened.page) == []


def test_the_page_is_small_and_opens_at_once(browser, results):
    file = results / "reports/index.html"
    for name in (file.name, "studies.html", "player.js"):
        assert (file.parent / name).stat().st_size <= LARGEST
    waits = []
    for _ in range(3):
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto(file.as_uri())
        # two frames after loading everything has been drawn
        waits.append(
            page.evaluate(
                """() => new Promise((done) => requestAnimationFrame(() =>
                    requestAnimationFrame(() => done(performance.now()))))"""
            )
        )
        page.close()
    assert min(waits) < 1500, waits


@pytest.mark.parametrize("width", [1280, 400])
def test_a_wide_table_scrolls_visibly_and_its_first_column_stays(at_width, width):
    page = at_width(width).page
    page.evaluate("document.querySelectorAll('details').forEach((d) => (d.open = true))")
    frames = page.locator(".scrolled").all()
    wide = [f for f in frames if f.evaluate("f => f.scrollWidth > f.clientWidth + 1")]
    assert wide
    for frame in frames:
        # what does not fit is in a frame, and is shaded where it goes on
        cut = frame.evaluate("f => f.scrollWidth > f.clientWidth + 1")
        (expect(frame).to_contain_class if cut else expect(frame).not_to_contain_class)(
            "more-right"
        )
    outside = "[...document.querySelectorAll('table')].filter((t) => !t.closest('.scrolled'))"
    assert page.evaluate(f"{outside}.length") == 0
    tables = [f for f in wide if f.locator("table").count()]
    for frame in tables:
        frame.evaluate("f => { f.scrollLeft = f.scrollWidth }")
        expect(frame).to_have_class("scrolled more-left")
        edge, cell = frame.bounding_box()["x"], frame.locator("th").first.bounding_box()["x"]
        assert cell == pytest.approx(edge, abs=2)


def test_nothing_is_asked_of_any_host_and_nothing_goes_wrong(opened, results):
    page = opened.page
    for section in page.locator("main section").all():
        section.scroll_into_view_if_needed()
    page.locator(SLIDER).focus()
    page.keyboard.press("End")
    assert opened.errors == []
    beside = ("data:", (results / "reports").as_uri())
    assert [url for url in opened.requests if not url.startswith(beside)] == []
    # the page forbids itself to ask, and what it would ask is seen here
    with page.expect_console_message(lambda said: "Content Security Policy" in said.text):
        page.evaluate("fetch('https://example.org/').catch(() => null)")
    assert any("Content Security Policy" in error for error in opened.errors)


def test_links_within_the_page_lead_somewhere(opened):
    missing = opened.page.evaluate(
        """[...document.querySelectorAll('a[href^="#"]')]
            .map((a) => a.getAttribute("href").slice(1))
            .filter((id) => !document.getElementById(id))"""
    )
    assert missing == []
    twice = opened.page.evaluate(
        "[...document.querySelectorAll('[id]')].map((e) => e.id).filter((id, place, all) => "
        "all.indexOf(id) !== place)"
    )
    assert twice == []


def test_the_first_stop_of_the_keyboard_leads_past_the_navigation(opened):
    opened.page.keyboard.press("Tab")
    assert opened.page.evaluate("document.activeElement.className") == "skip"
    opened.page.keyboard.press("Enter")
    opened.page.wait_for_url("**/index.html#claims")


def test_headings_do_not_skip_a_level(opened):
    levels = [
        int(tag[1])
        for tag in opened.page.evaluate(
            "[...document.querySelectorAll('h1, h2, h3, h4')].map((e) => e.tagName)"
        )
    ]
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))


def test_a_narrow_screen_needs_no_scrolling_aside(narrow):
    assert narrow.page.evaluate("document.documentElement.scrollWidth") <= 360
    narrow.page.evaluate(
        "document.querySelectorAll('details').forEach((details) => (details.open = true))"
    )
    assert narrow.page.evaluate("document.documentElement.scrollWidth") <= 360
    models = narrow.page.locator("#player .models > section")
    assert len({models.nth(i).bounding_box()["x"] for i in range(3)}) == 1


def test_in_print_the_claims_are_unfolded_and_the_controls_gone(opened):
    page = opened.page
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.locator("#claims details:not([open])").count() == 0
    assert not page.locator("nav").is_visible() and not page.locator(SLIDER).is_visible()
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.locator("#claims details[open]").count() == 0


def violations(page) -> list[str]:
    return [
        f"{rule['id']}: {rule['nodes'][0]['html'][:200]}"
        for rule in Axe().run(page).response["violations"]
    ]


def test_the_page_is_accessible_wide_and_narrow_folded_and_unfolded(opened, narrow):
    assert violations(narrow.page) == []
    opened.page.evaluate(
        "document.querySelectorAll('details').forEach((details) => (details.open = true))"
    )
    assert violations(opened.page) == []


def test_the_check_of_accessibility_sees_what_is_not(opened):
    opened.page.evaluate(
        "document.querySelector('article img').removeAttribute('alt'); "
        "document.querySelector('.badge').style.color = '#dddddd';"
    )
    faults = " ".join(violations(opened.page))
    assert "image-alt" in faults and "color-contrast" in faults
