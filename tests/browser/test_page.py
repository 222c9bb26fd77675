"""The page in a browser: everything is there, it plays by keyboard, asks nobody, fits a phone, and is accessible."""

from __future__ import annotations

import base64
import gzip
import io
import json
import re
from itertools import pairwise

import pandas as pd
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

pytestmark = pytest.mark.slow

SLIDER = "#play-slider"


def test_every_claim_has_its_verdict_for_every_dataset(opened, project):
    claims = json.loads((project / "reports/claims.json").read_text())
    assert [of["dataset"] for of in claims["datasets"]] == ["youbot", "another"]
    for claim in claims["claims"]:
        shown = opened.page.locator(f"#claim-{claim['id']}")
        assert claim["statement"] in shown.locator(".statement").inner_text()
        verdicts = [text.split(maxsplit=1)[1] for text in shown.locator(".badge").all_inner_texts()]
        assert verdicts == [of["verdict"] for of in claim["datasets"].values()]


def test_a_claim_opens_by_keyboard_and_shows_its_numbers_and_how_to_recompute_them(opened):
    claim = opened.page.locator("#claim-mean-error")
    assert not claim.locator(".evidence").is_visible()
    claim.locator("summary").focus()
    opened.page.keyboard.press("Enter")
    text = claim.locator(".evidence").inner_text()
    assert "Published: 0.02" in text and "wishart: " in text and "dvc repro score" in text
    assert "reports/metrics/motion.json: wishart_greatest_mean_error_rad" in text


def test_every_figure_is_there_with_a_text_for_those_who_do_not_see_it(opened, project):
    captions = json.loads((project / "reports/figures/captions.json").read_text())
    assert captions
    for name, caption in captions.items():
        figure = opened.page.locator(f"#figure-{name}")
        image = figure.locator("img")
        image.scroll_into_view_if_needed()
        assert image.evaluate("image => image.complete && image.naturalWidth") > 100
        assert image.get_attribute("alt").startswith(caption["title"])
        assert caption["script"] in figure.inner_text()


def content(page, link) -> tuple[str, bytes]:
    """Name and bytes of what a link offers."""
    kind, _, data = link.get_attribute("href").partition(";base64,")
    plain = base64.b64decode(data)
    return link.get_attribute("download"), gzip.decompress(plain) if kind == "data:application/gzip" else plain


def test_every_table_can_be_taken_from_the_page(opened, project):
    reported = {file.name: file.read_bytes() for file in (project / "reports/tables").glob("*.csv")}
    offered = dict(content(opened.page, link) for link in opened.page.locator("a[download]").all())
    assert {name: offered[name] for name in reported} == reported
    captions = json.loads((project / "reports/figures/captions.json").read_text())
    behind = {source for caption in captions.values() for source in caption["sources"] if source.endswith(".parquet")}
    for source in behind - {f"data/{name}.parquet" for name in reported}:
        stem = source.rpartition("/")[2].removesuffix(".parquet")
        found = offered.get(f"{stem}.csv") or offered[f"{stem}.csv.gz"]
        table = pd.read_csv(io.BytesIO(found))
        if f"{stem}.csv" not in reported:
            pd.testing.assert_frame_equal(table, pd.read_parquet(project / source), check_dtype=False, rtol=1e-4)


def test_a_download_is_a_file_and_no_request(opened):
    opened.page.locator("#table-wrench_study\\.csv summary").click()
    with opened.page.expect_download() as download:
        opened.page.locator("#table-wrench_study\\.csv a[download]").click()
    assert download.value.suggested_filename == "wrench_study.csv"


def state(page) -> tuple:
    """What is drawn at this frame: the image, the links, the cursors, the ellipses, the numbers."""
    return page.evaluate(
        """() => [
            document.getElementById("play-depth").layout.images[0].source,
            document.getElementById("play-depth").data[0].x,
            document.getElementById("play-joints").layout.shapes.map((shape) => shape.x0),
            [...document.querySelectorAll("[id^=play-spread-]")].map((plot) => plot.data[0].x),
            document.getElementById("play-values").innerText,
        ]"""
    )


def test_the_slider_moves_by_keyboard_and_everything_with_it(opened):
    page = opened.page
    played = json.loads(page.locator("#played").text_content())
    last = len(played["frames"]) - 1
    page.locator(SLIDER).focus()
    page.keyboard.press("Home")
    before = state(page)
    page.keyboard.press("ArrowRight")
    assert page.locator(SLIDER).input_value() == "1"
    after = state(page)
    assert all(one != other for one, other in zip(before, after, strict=True))
    page.keyboard.press("End")
    image, links, cursors, _, _ = state(page)
    frame = played["frames"][last]
    assert (image, links, cursors) == (frame["image"], frame["u"], [frame["t"]])
    said = page.locator(SLIDER).get_attribute("aria-valuetext")
    assert said == page.locator("#play-now").inner_text() == f"{last + 1} of {last + 1}, {frame['t']:.2f} s"
    for model, values in frame["models"].items():
        cells = page.locator(f"#play-values tr[data-model={model}] td").all_inner_texts()
        assert cells[0] == f"{values['error'][0]:.1f} ± {values['bound'][0]:.1f}" and cells[3] == str(values["ess"])
    page.keyboard.press("Home")
    assert state(page) == before


def test_the_button_plays_and_stops(opened):
    page = opened.page
    button = page.locator("#play-button")
    page.locator(SLIDER).focus()
    page.keyboard.press("Home")
    button.focus()
    page.keyboard.press("Space")
    assert button.inner_text() == "Pause"
    expect(page.locator("#play-now")).to_contain_text(re.compile("^[2-9] of"))
    page.keyboard.press("Space")
    stopped = page.locator(SLIDER).input_value()
    page.wait_for_timeout(500)
    assert page.locator(SLIDER).input_value() == stopped and button.inner_text() == "Play"


def test_every_model_is_drawn_beside_the_others(opened):
    models = opened.page.locator("#player .models > section")
    assert models.count() == 3
    places = [models.nth(i).bounding_box() for i in range(3)]
    assert len({place["y"] for place in places}) == 1 and len({place["x"] for place in places}) == 3
    for plot in opened.page.locator(".plot").all():
        assert plot.locator("svg.main-svg").first.bounding_box()["height"] > 100


def test_nothing_is_asked_of_any_host_and_nothing_goes_wrong(opened, project):
    page = opened.page
    for section in page.locator("main section").all():
        section.scroll_into_view_if_needed()
    page.locator(SLIDER).focus()
    page.keyboard.press("End")
    assert opened.errors == []
    elsewhere = [url for url in opened.requests if not url.startswith("data:")]
    assert elsewhere == [(project / "reports/index.html").as_uri()]
    # the page forbids itself to ask, and what it would ask is seen here
    page.evaluate("fetch('https://example.org/').catch(() => null)")
    page.wait_for_timeout(200)
    assert any("Content Security Policy" in error for error in opened.errors)


def test_links_within_the_page_lead_somewhere(opened):
    missing = opened.page.evaluate(
        """[...document.querySelectorAll('a[href^="#"]')].map((a) => a.getAttribute("href").slice(1))
            .filter((id) => !document.getElementById(id))"""
    )
    assert missing == []
    twice = opened.page.evaluate(
        "[...document.querySelectorAll('[id]')].map((e) => e.id).filter((id, place, all) => all.indexOf(id) !== place)"
    )
    assert twice == []


def test_the_first_stop_of_the_keyboard_leads_past_the_navigation(opened):
    opened.page.keyboard.press("Tab")
    assert opened.page.evaluate("document.activeElement.className") == "skip"
    opened.page.keyboard.press("Enter")
    assert opened.page.url.endswith("#claims")


def test_headings_do_not_skip_a_level(opened):
    levels = [int(tag[1]) for tag in opened.page.evaluate("[...document.querySelectorAll('h1, h2, h3, h4')].map((e) => e.tagName)")]
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))


def test_a_narrow_screen_needs_no_scrolling_aside(narrow):
    assert narrow.page.evaluate("document.documentElement.scrollWidth") <= 360
    narrow.page.evaluate("document.querySelectorAll('details').forEach((details) => (details.open = true))")
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
    return [f"{of['id']}: {of['nodes'][0]['html'][:200]}" for of in Axe().run(page).response["violations"]]


def test_the_page_is_accessible_wide_and_narrow_folded_and_unfolded(opened, narrow):
    assert violations(narrow.page) == []
    opened.page.evaluate("document.querySelectorAll('details').forEach((details) => (details.open = true))")
    assert violations(opened.page) == []


def test_the_check_of_accessibility_sees_what_is_not(opened):
    opened.page.evaluate(
        "document.querySelector('article img').removeAttribute('alt'); document.querySelector('.badge').style.color = '#dddddd';"
    )
    found = " ".join(violations(opened.page))
    assert "image-alt" in found and "color-contrast" in found
