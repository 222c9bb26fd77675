"""Markdown files of the reports as one HTML page that needs no other file: styles and figures are
in it.
"""

from __future__ import annotations

import io
import os
import re
from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from string import Template

from markdown_it import MarkdownIt
from markdown_it.token import Token
from PIL import Image

from pipeline.core.errors import ContractError

TEMPLATE = Path(__file__).with_name("page.html")
COLOURS = 64  # of a figure on the page, which the drawn lines and shades fit in
WIDE = 1.4  # width by height of a figure that scrolls on a narrow screen
# a frame that scrolls and that the keyboard reaches
FRAME = {"role": "region", "aria-label": "wide content", "tabindex": 0}
DEPTH = 2  # levels of headings in the table of contents


@dataclass
class Section:
    """A Markdown file as a part of the page: HTML, title, and the anchors of its headings.

    ``headings`` holds level (1 for the title), anchor and text.
    """

    file: Path
    html: str = ""
    headings: list[tuple[int, str, str]] = field(default_factory=list)


def page(title: str, files: Sequence[Path], folder: Path) -> str:
    """Return the page of Markdown ``files``, one section each, to be written into ``folder``.

    Links between the files become links inside the page, others lead to files from ``folder``.
    Raises ContractError for a file or a figure that is missing.
    """
    sections = [_section(file, files, folder) for file in files]
    parts = [
        f'<section aria-label="{escape(one.file.stem)}">\n{one.html}</section>' for one in sections
    ]
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=escape(title), contents=_contents(sections), sections="\n".join(parts)
    )


def _section(file: Path, files: Sequence[Path], folder: Path) -> Section:
    if not file.is_file():
        raise ContractError(
            "no such page; run `dvc repro` (`dvc repro -P` for the studies)", file=file
        )
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = parser.parse(file.read_text(encoding="utf-8"))
    section = Section(file)
    for place, token in enumerate(tokens):
        if token.type == "heading_open":
            _name_heading(section, token, tokens[place + 1])
        elif token.type == "inline" and {child.type for child in token.children} == {"image"}:
            tokens[place - 1].attrs |= FRAME | {"class": "figure"}
        for child in token.children or []:
            if child.type == "image":
                child.attrs |= _embedded(file.parent / str(child.attrs["src"]))
            elif child.type == "link_open":
                child.attrs["href"] = _address(str(child.attrs["href"]), file, files, folder)
    html = parser.renderer.render(list(_framed(tokens)), parser.options, {})
    section.html = html.replace("&lt;br&gt;", "<br>")  # line ends in the cells of a table
    return section


def _name_heading(section: Section, token: Token, inline: Token) -> None:
    text = "".join(child.content for child in inline.children or [])
    level = int(token.tag[1])
    taken = {anchor for _, anchor, _ in section.headings}
    anchor = _anchor(section.file, "" if level == 1 and not taken else _slug(text))
    number = 1
    while (unique := anchor if number == 1 else f"{anchor}-{number}") in taken:
        number += 1
    token.attrs["id"] = unique
    section.headings.append((level, unique, text))


def _slug(text: str) -> str:
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")


def _anchor(file: Path, slug: str) -> str:
    return "--".join(filter(None, (file.stem, slug)))


def _address(href: str, file: Path, files: Sequence[Path], folder: Path) -> str:
    """Where a link of ``file`` leads from the page."""
    if re.match(r"[a-z]+:", href):
        return href
    path, mark, slug = href.partition("#")
    target = Path(os.path.normpath(file.parent / path)) if path else file
    if target in files:
        return f"#{_anchor(target, slug)}"
    return Path(os.path.relpath(target, folder)).as_posix() + mark + slug


def _embedded(file: Path) -> dict[str, str]:
    """The address of a figure that holds it whole, its PNG of few colours; and its shape."""
    picture = file.with_suffix(".png")
    if not picture.is_file():
        raise ContractError("no such figure; run the stage that draws it", file=picture)
    written = io.BytesIO()
    with Image.open(picture) as image:
        shape = "wide" if image.width > WIDE * image.height else "high"
        few = image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    few.save(written, "PNG", optimize=True)
    address = f"data:image/png;base64,{b64encode(written.getvalue()).decode('ascii')}"
    return {"src": address, "class": shape}


def _framed(tokens: Sequence[Token]) -> Iterator[Token]:
    """Put each table into a frame."""
    for token in tokens:
        if token.type == "table_open":
            yield Token("frame_open", "div", 1, attrs=FRAME | {"class": "table"}, block=True)
        yield token
        if token.type == "table_close":
            yield Token("frame_close", "div", -1, block=True)


def _contents(sections: Sequence[Section]) -> str:
    """The table of contents: every section, and below it its headings."""
    lines = ["<ul>"]
    for section in sections:
        (_, anchor, title), *headings = section.headings or [(1, "", section.file.stem)]
        inner = [
            f'<li><a href="#{name}">{escape(text)}</a></li>'
            for level, name, text in headings
            if level <= DEPTH
        ]
        below = "\n".join(["", "<ul>", *inner, "</ul>"]) if inner else ""
        lines.append(f'<li><a href="#{anchor}">{escape(title)}</a>{below}</li>')
    return "\n".join([*lines, "</ul>"])
