"""The page of a whole run, opened from the disk in a browser; skipped where there is none."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from conftest import run
from playwright.sync_api import Browser, Page, expect, sync_playwright

from pipeline.audit.run import read_run

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
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
    """A page in a browser, what it wrote on the console as an error, and what it asked other places for."""

    page: Page
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


@pytest.fixture(scope="session")
def project(reproduced: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reproduced project with the evidence of a second dataset, a real robot's without test takes, in its report."""
    folder = tmp_path_factory.mktemp("site") / "project"
    shutil.copytree(reproduced, folder, symlinks=True)
    here = read_run(folder / "reports/datasets/youbot.json")
    metrics = {name: values for name, values in here.metrics.items() if name.startswith(("motion", "fit", "simulate"))}
    other = replace(here, dataset="another", synthetic=False, metrics=metrics, tables={})
    (folder / "reports/datasets/another.json").write_text(other.to_json(), encoding="utf-8")
    done = run("dvc", "repro", cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


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
    opened.page.on("console", lambda message: opened.errors.append(message.text) if message.type == "error" else None)
    opened.page.on("pageerror", lambda error: opened.errors.append(str(error)))
    opened.page.on("request", lambda request: opened.requests.append(request.url))
    opened.page.goto(file.as_uri())
    expect(opened.page.locator("#play-now")).to_contain_text(" of ")
    return opened


@pytest.fixture
def opened(browser: Browser, project: Path) -> Iterator[Opened]:
    """The page on a wide screen."""
    found = open_page(browser, project / "reports/index.html", 1200)
    yield found
    found.page.close()


@pytest.fixture
def narrow(browser: Browser, project: Path) -> Iterator[Opened]:
    """The page on a narrow one."""
    found = open_page(browser, project / "reports/index.html", 360)
    yield found
    found.page.close()
