"""The studies' pages of Markdown as parts of the page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup

from pipeline.tools.page.pictures import picture

LOWEST = 6  # heading of HTML
ROWS = 9  # of a table at most; a longer one is linked


@dataclass(frozen=True)
class StudyPage:
    """A study's name, the title of its page, its file, and the page below the title as HTML."""

    name: str
    title: str
    file: Path
    html: Markup


def study_pages(folder: Path, reports: Path) -> list[StudyPage]:
    """The pages of ``folder`` by name, none where no study has run; links lead from ``reports``,
    where the page of results lies.
    """
    return [study_page(file, reports) for file in sorted(folder.glob("*.md"))]


def study_page(file: Path, reports: Path) -> StudyPage:
    """The page of one study: headings one level lower, pictures of a known size, tables in frames
    that scroll.
    """
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = parser.parse(file.read_text(encoding="utf-8"))
    title = file.stem
    if len(tokens) > 1 and tokens[0].type == "heading_open" and tokens[0].tag == "h1":
        title, tokens = tokens[1].content, tokens[3:]
    tokens = _shortened(tokens, file, parser)
    for token in tokens:
        if token.type in ("heading_open", "heading_close"):
            token.tag = f"h{min(int(token.tag[1]) + 1, LOWEST)}"
        for child in token.children or []:
            if child.type == "image":
                shown = picture((file.parent / str(child.attrs["src"])).with_suffix(".png"))
                child.attrs |= {
                    "src": Path(os.path.relpath(shown.file, reports)).as_posix(),
                    "width": shown.width,
                    "height": shown.height,
                    "loading": "lazy",
                }
            elif child.type == "link_open":
                _lead_from(child, file.parent, reports)
    html = parser.renderer.render(_framed(tokens, title), parser.options, {})
    return StudyPage(file.stem, title, file, Markup(html))


def _shortened(tokens: Sequence[Token], file: Path, parser: MarkdownIt) -> list[Token]:
    """``tokens`` with a link in place of each long table, so that the page of results stays small;
    ``file`` is the study's own page.
    """
    short, place = [], 0
    while place < len(tokens):
        end = place + 1
        part = tokens[place:end]
        if tokens[place].type == "table_open":
            end = next(k for k in range(place, len(tokens)) if tokens[k].type == "table_close") + 1
            part = tokens[place:end]
            rows = sum(token.type == "tr_open" for token in part) - 1
            if rows > ROWS:
                part = parser.parse(f"A table of {rows} rows stands in [the study]({file.name}).")
        short += part
        place = end
    return short


def _lead_from(link: Token, folder: Path, reports: Path) -> None:
    address = str(link.attrs["href"])
    if ":" not in address and not address.startswith("#"):
        place, mark, part = address.partition("#")
        link.attrs["href"] = Path(os.path.relpath(folder / place, reports)).as_posix() + mark + part


def _framed(tokens: Sequence[Token], title: str) -> list[Token]:
    """``tokens`` with each table in a frame that a keyboard reaches, named by the heading above."""
    framed, heading, number = [], title, 0
    for place, token in enumerate(tokens):
        if token.type == "heading_open":
            heading = tokens[place + 1].content
        if token.type == "table_open":
            number += 1
            label = f"{title}: {heading}, table {number}"
            attributes = {"class": "scrolled", "role": "region", "aria-label": label, "tabindex": 0}
            framed.append(Token("frame_open", "div", 1, attrs=attributes, block=True))
        framed.append(token)
        if token.type == "table_close":
            framed.append(Token("frame_close", "div", -1, block=True))
    return framed
