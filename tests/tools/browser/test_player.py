"""The player in a browser: it goes by keyboard and by its button, a panel a joint and a model."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from pipeline.verdicts.run import read_run

pytestmark = pytest.mark.slow

SLIDER = "#play-slider"


def state(page) -> tuple:
    """What is drawn at this frame: image, links, cursors, ellipses, dots, numbers."""
    return page.evaluate(
        """() => {
            const all = (selector, name) =>
                [...document.querySelectorAll(selector)].map((e) => e.getAttribute(name));
            return [
                document.getElementById("play-image").getAttribute("href"),
                document.getElementById("play-links").getAttribute("points"),
                all(".cursor", "x1"),
                all(".ellipse", "transform"),
                all(".measured", "cx"),
                document.getElementById("play-values").innerText,
            ];
        }"""
    )


def test_the_slider_moves_by_keyboard_and_everything_with_it(opened):
    page = opened.page
    frames = page.evaluate("played.frames")
    last = len(frames) - 1
    page.locator(SLIDER).focus()
    page.keyboard.press("Home")
    before = state(page)
    page.keyboard.press("ArrowRight")
    assert page.locator(SLIDER).input_value() == "1"
    after = state(page)
    assert all(one != other for one, other in zip(before, after, strict=True))
    outlines = "[...document.querySelectorAll('.shape')].map((e) => e.getAttribute('d'))"
    assert all(page.evaluate(outlines))
    page.keyboard.press("End")
    image, links, cursors, ellipses, dots, _ = state(page)
    frame = frames[last]
    assert (image, links) == (frame["image"], frame["links"])
    assert set(cursors) == {f"{frame['cursor']}%"}
    assert ellipses == [text for shown in frame["models"].values() for text in shown["ellipses"]]
    assert dots[: len(frame["dots"])] == [f"{x:g}" for x, _ in frame["dots"]]
    said = page.locator(SLIDER).get_attribute("aria-valuetext")
    assert said == page.locator("#play-now").inner_text()
    assert said == f"{last + 1} of {last + 1}, {frame['t']} s"
    for model, shown in frame["models"].items():
        cells = page.locator(f"#play-values tr[data-model={model}] td").all_inner_texts()
        assert cells == shown["texts"]
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
        box = plot.bounding_box()
        assert box["height"] > 100 and box["width"] > 200
        labels = plot.locator("text").all_inner_texts()
        assert labels or plot.get_attribute("id") == "play-depth"


def test_every_joint_has_its_panel_by_its_name(opened, results):
    joints = read_run(results / "reports/datasets/youbot.json").joints
    for plot in opened.page.locator("[id^=play-error-], #play-joints").all():
        texts = plot.locator("text").all_text_contents()
        panels = [text.partition(" (")[0].replace(" ", "_") for text in texts if "rad)" in text]
        assert panels == joints
    header = opened.page.locator("#player thead th").all_inner_texts()
    assert header == ["model", *(joint.replace("_", " ") for joint in joints), "particles"]
