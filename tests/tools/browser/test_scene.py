"""An arm in space in a browser: it is drawn where its frames have it, and turns by slider and by
mouse.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from spatial_take import BIAS

pytestmark = pytest.mark.slow

TURN, TILT = "#play-turn", "#play-tilt"


def drawn(page) -> dict:
    """What is drawn: points of the links and of the path, the ellipses' transforms."""
    return page.evaluate(
        """() => {
            const points = (id) => document.getElementById(id).getAttribute("points")
                .split(" ").map((point) => point.split(",").map(Number));
            const tips = [...document.querySelectorAll("#play-scene .tip")].map((tip) => [
                tip.dataset.model,
                tip.firstElementChild.getAttribute("transform")
                    .match(/-?[\\d.]+(e-?\\d+)?/g).map(Number),
            ]);
            return { links: points("play-links"), path: points("play-path"),
                     tips: Object.fromEntries(tips) };
        }"""
    )


def view_of(page) -> tuple[np.ndarray, np.ndarray, dict]:
    """(2, 3) the axes of the picture, right and down, in the arm's base; its middle; the frame."""
    yaw, pitch = (np.radians(float(page.locator(x).input_value())) for x in (TURN, TILT))
    right = [-np.sin(yaw), np.cos(yaw), 0]
    # what is up in the picture lies at right angles to it and to where one looks from
    towards = [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)]
    scene = json.loads(page.locator("#play-scene").get_attribute("data-scene"))
    axes = 0.9 / scene["radius"] * np.array([right, -np.cross(towards, right)])
    frames = page.evaluate("played.frames")
    return axes, np.array(scene["centre"]), frames[int(page.locator("#play-slider").input_value())]


@pytest.mark.parametrize(("turn", "tilt"), [(-60, 20), (30, 0), (0, 90)])
def test_links_and_ellipses_are_the_projection_of_what_the_frame_holds(in_space, turn, tilt):
    page = in_space.page
    for name, value in ((TURN, turn), (TILT, tilt)):
        page.locator(name).fill(str(value))
    axes, centre, frame = view_of(page)
    shown = drawn(page)
    expected = (np.array(frame["nodes"]) - centre) @ axes.T
    np.testing.assert_allclose(shown["links"], expected, atol=2e-4)
    assert list(shown["tips"]) == list(BIAS)
    for model, (a, b, c, d, u, v) in shown["tips"].items():
        tip, covariance = frame["tips"][model], np.zeros((3, 3))
        covariance[np.triu_indices(3)] = tip["covariance"]
        covariance += np.triu(covariance, 1).T
        np.testing.assert_allclose([u, v], axes @ (np.array(tip["place"]) - centre), atol=2e-4)
        root = np.array([[a, c], [b, d]])
        np.testing.assert_allclose(root @ root.T, axes @ covariance @ axes.T, rtol=0.01, atol=1e-6)
    # all of it is in the picture
    assert np.abs([*shown["links"], *shown["path"]]).max() <= 1


def test_it_turns_by_the_mouse_and_moves_with_the_slider(in_space):
    page = in_space.page
    page.locator("#play-scene").scroll_into_view_if_needed()
    before = drawn(page)
    box = page.locator("#play-scene").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 80, y + 30, steps=4)
    page.mouse.up()
    turned = drawn(page)
    assert page.locator(TURN).input_value() != "-60" and turned["links"] != before["links"]
    page.mouse.move(x, y)
    assert drawn(page) == turned  # released
    page.locator("#play-slider").focus()
    page.keyboard.press("ArrowRight")
    moved = drawn(page)
    assert moved["links"] != turned["links"] and moved["path"] == turned["path"]


def test_nothing_is_asked_of_anybody_and_the_page_is_accessible(in_space):
    in_space.page.locator("#player").scroll_into_view_if_needed()
    assert in_space.errors == [] and all(url.startswith("file:") for url in in_space.requests)
    result = Axe().run(in_space.page, context="#player").response["violations"]
    assert [f"{rule['id']}: {rule['nodes'][0]['html'][:200]}" for rule in result] == []
    assert in_space.page.locator("#play-depth").count() == 0
    assert in_space.page.locator(".measured").count() == 0
