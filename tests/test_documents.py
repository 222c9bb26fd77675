"""Links of every finished page lead somewhere; the drawing of the stages is of today's dvc.yaml."""

import re
import subprocess
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest
from markdown_it import MarkdownIt
from source_code import ROOT
from stage_drawing import PAGE, expected_page

TEMPLATES = (
    "pipeline/verdicts/templates",
    "pipeline/studies",
    "pipeline/tools/page",
    "tests/benchmarks",
)


def pages(ending: str) -> list[str]:
    """Return the finished pages that git tracks, templates excluded."""
    command = ["git", "ls-files", "-z", f"*{ending}"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    names = [name for name in listed.stdout.split("\0") if name]
    return [name for name in names if not name.startswith(TEMPLATES)]


class LinksAndAnchors(HTMLParser):
    """Targets of the links and images of a page, and its anchors."""

    def __init__(self, text: str):
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list) -> None:
        named = dict(attributes)
        if "id" in named:
            self.anchors.add(named["id"])
        link = named.get("href") or named.get("src")
        if link and tag != "link":
            self.links.append(link)


def markdown_page(text: str) -> LinksAndAnchors:
    """Return links and anchors of Markdown; a heading's anchor is GitHub's."""
    parser = MarkdownIt("commonmark").enable("table")
    page = LinksAndAnchors(parser.render(text))

    tokens = parser.parse(text)
    for opening, heading in pairwise(tokens):
        if opening.type == "heading_open":
            words = "".join(child.content for child in heading.children)
            page.anchors.add(re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-"))
    return page


def broken_links(name: str) -> list[str]:
    """Return the relative links of a page whose file or anchor does not exist."""
    page = read_page(ROOT / name)
    broken = []
    for link in page.links:
        if re.match(r"[a-z]+:", link):  # another site, or data inside the page
            continue
        path, _, anchor = link.partition("#")
        target = (ROOT / name).parent / path if path else ROOT / name
        if not target.exists():
            broken.append(link)
        elif anchor and target.suffix in {".md", ".html"}:
            if anchor not in read_page(target).anchors:
                broken.append(link)
    return broken


def read_page(file: Path) -> LinksAndAnchors:
    text = file.read_text(encoding="utf-8")
    return LinksAndAnchors(text) if file.suffix == ".html" else markdown_page(text)


@pytest.mark.parametrize("name", pages(".md") + pages(".html"))
def test_every_relative_link_and_anchor_exists(name):
    assert broken_links(name) == []


def test_a_lost_file_and_a_lost_anchor_are_seen():
    page = markdown_page("# A title\n\n[there](README.md#a-title) [lost](lost.md)\n")
    assert page.links == ["README.md#a-title", "lost.md"]
    assert page.anchors == {"a-title"}


def test_the_drawing_of_the_stages_is_of_todays_file():
    text = PAGE.read_text(encoding="utf-8")
    assert text == expected_page(text), "run python tests/helpers/stage_drawing.py"
