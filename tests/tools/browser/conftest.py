"""The page of a whole run, opened from the disk in a browser; skipped where there is none."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright
from spatial_take import spatial_take

from pipeline.tools.page.graph import draw
from pipeline.tools.page.page import Content, player_script, render
from pipeline.tools.page.player import player
from pipeline.tools.page.provenance import Costs
from pipeline.tools.page.stages import Stage

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
# a browser that asks nobody for anything
QUIET = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


@dataclass
class Opened:
    """A page in a browser, what it wrote on the console as an error, and what it asked other places
    for.
    """

    page: Page
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Headless Chromium with a profile of its own."""
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed (on Debian and Ubuntu: apt-get install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=QUIET)
        yield browser
        browser.close()


def open_page(browser: Browser, file: Path, width: int) -> Opened:
    """Open ``file`` in a window of ``width`` px and listen."""
    opened = Opened(browser.new_page(viewport={"width": width, "height": 900}))
    opened.page.on(
        "console",
        lambda message: opened.errors.append(message.text) if message.type == "error" else None,
    )
    opened.page.on("pageerror", lambda error: opened.errors.append(str(error)))
    opened.page.on("request", lambda request: opened.requests.append(request.url))
    opened.page.goto(file.as_uri())
    expect(opened.page.locator("#play-now")).to_contain_text(" of ")
    return opened


@pytest.fixture
def at_width(browser: Browser, results: Path) -> Iterator[Callable[[int], Opened]]:
    """Opens the page in a window of a width in px."""
    shown: list[Opened] = []

    def open_at(width: int) -> Opened:
        shown.append(open_page(browser, results / "reports/index.html", width))
        return shown[-1]

    yield open_at
    for each in shown:
        each.page.close()


@pytest.fixture
def opened(at_width: Callable[[int], Opened]) -> Opened:
    """The page on a wide screen."""
    return at_width(1200)


@pytest.fixture
def narrow(at_width: Callable[[int], Opened]) -> Opened:
    """The page on a narrow one."""
    return at_width(360)


@pytest.fixture
def in_space(browser: Browser, tmp_path: Path) -> Iterator[Opened]:
    """A page that plays a take of an arm in space, and holds nothing else."""
    stages = [Stage("fit", "parameters", ["data/fit/*"], [])]
    played = player(spatial_take())
    content = Content(
        dataset="lab",
        scale="smoke",
        decided=[],
        player=played,
        illustrations=[],
        studies=[],
        errata=[],
        stages=stages,
        drawing=draw(stages),
        tables=[],
        options={"seed": 7},
        outputs=[],
        recordings=[],
        libraries={},
        requirements="0" * 64,
        costs=Costs("a machine", "smoke", []),
    )
    file = tmp_path / "index.html"
    file.write_text(render(content), encoding="utf-8")
    (tmp_path / "player.js").write_text(player_script(played), encoding="utf-8")
    opened = open_page(browser, file, 1200)
    yield opened
    opened.page.close()
