"""``python -m pipeline page [studies]``: HTML page of the report and the model card, or of the
studies, with styles and figures inside.
"""

import io
import os
import re
from base64 import b64encode
from collections.abc import Sequence
from html import escape
from pathlib import Path

from jinja2 import Template
from markdown_it import MarkdownIt
from PIL import Image

from pipeline.configuration import config
from pipeline.core.contracts import write_text
from pipeline.core.errors import ContractError

REPORTS, RESULTS = Path("reports"), ("report.md", "model_card.md")
TEMPLATE = Path(__file__).with_name("page.html")
COLOURS = 64  # of a figure on the page, enough for its lines and shades
WIDE = (
    900  # px, least width of a figure of two columns, which scrolls on a narrow screen
)
# attributes of a frame that scrolls and can be focused by keyboard
FRAME = {"role": "region", "aria-label": "wide content", "tabindex": 0}
TABLE = '<div role="region" aria-label="wide content" tabindex="0" class="table">'
FOLDED = "model_card"  # page whose sections are folded
FOLD = r"<details><summary>\1</summary>\2</details>\n"
UNSEEN = re.compile(  # a folded paragraph
    r"<p>&lt;details&gt;&lt;summary&gt;(.*?)&lt;/summary&gt;(.*?)&lt;/details&gt;</p>"
)
FOLDS = re.compile(r"(<h2 .*?</h2>)(.*?)(?=<h2 |\Z)", re.DOTALL)
CARD = re.compile(r"<h3 .*?(?=<h3 |\Z)", re.DOTALL)
CARDS = re.compile(r"(?:<h3 .*?(?=<h[1-3] |\Z))+", re.DOTALL)
ONE_CARD = r'<div class="card">\n\g<0></div>\n'
CARD_GROUP = '<div class="cards">\n{}</div>\n'
FIGURE = re.compile(r'(<p [^>]*class="figure"[^>]*><img [^>]*>)\s+(.+?)</p>', re.DOTALL)
DEPTH = 2  # levels of headings in the table of contents


def run(part: str = "results") -> None:
    """Write reports/DATASET/index.html, or reports/studies.html for the studies."""
    if part == "results":
        title, folder = "Results", REPORTS / config.sections("page").dataset.name
        files, out = [folder / name for name in RESULTS], folder / "index.html"
    else:
        title, out = "Studies beyond the paper", REPORTS / "studies.html"
        files = sorted((REPORTS / "studies").glob("*.md"))
        if not files:
            message = "no study has run; run `dvc repro -P`"
            raise ContractError(message, folder=REPORTS / "studies")
    write_text(page(title, files, out.parent), out)
    print(f"page: wrote {out}")


def page(title: str, files: Sequence[Path], folder: Path) -> str:
    """Return the page of Markdown ``files``, one section each, to be written into ``folder``.

    Links between the files become links inside the page, others lead to files from ``folder``.
    Raises ContractError for a file or a figure that is missing.
    """
    sections = [(escape(file.stem), *_section(file, files, folder)) for file in files]
    template = Template(TEMPLATE.read_text(encoding="utf-8"), trim_blocks=True)
    return template.render(title=escape(title), sections=sections, depth=DEPTH) + "\n"


def _section(
    file: Path, files: Sequence[Path], folder: Path
) -> tuple[str, list[tuple[int, str, str]]]:
    """Return the HTML of a Markdown file, and level (1: title), anchor and text of its headings."""
    try:
        content = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        raise ContractError(
            "no such page in UTF-8; run `dvc repro -P`", file=file
        ) from None
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = parser.parse(content)
    headings: list[tuple[int, str, str]] = []
    for place, token in enumerate(tokens):
        if token.type == "heading_open":
            text = "".join(child.content for child in tokens[place + 1].children or [])
            slug = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")
            # an anchor is the file's name and GitHub's slug; the title's is the file's name only
            anchor = _anchor(file, slug if headings or token.tag != "h1" else "")
            twins = [
                name
                for _, name, _ in headings
                if re.fullmatch(rf"{anchor}(-\d+)?", name)
            ]
            token.attrs["id"] = f"{anchor}-{len(twins) + 1}" if twins else anchor
            headings.append((int(token.tag[1]), token.attrs["id"], escape(text)))
        elif (
            token.type == "inline"
            and token.children
            and token.children[0].type == "image"
        ):
            tokens[place - 1].attrs |= FRAME | {"class": "figure"}
        for child in token.children or []:
            if child.type == "image":
                child.attrs |= _figure_attributes(file.parent / str(child.attrs["src"]))
            elif child.type == "link_open":
                child.attrs["href"] = _address(
                    str(child.attrs["href"]), file, files, folder
                )
    html = parser.renderer.render(tokens, parser.options, {})
    html = html.replace("<table>", f"{TABLE}\n<table>").replace(
        "</table>", "</table>\n</div>"
    )
    html = UNSEEN.sub(
        FOLD, html.replace("&lt;br&gt;", "<br>")
    )  # line ends in a table's cells
    html = FIGURE.sub(r"\1</p>\n<p>\2</p>", html)
    if file.stem == FOLDED:
        html = FOLDS.sub(FOLD, html)
    else:  # parts under headings of level 3 are beside each other
        html = CARDS.sub(
            lambda found: CARD_GROUP.format(CARD.sub(ONE_CARD, found[0])), html
        )
    return html, headings or [(1, "", file.stem)]


def _anchor(file: Path, slug: str) -> str:
    return "--".join(filter(None, (file.stem, slug)))


def _address(href: str, file: Path, files: Sequence[Path], folder: Path) -> str:
    """Return the address on the page for the link ``href`` in ``file``."""
    if re.match(r"[a-z]+:", href):
        return href
    path, mark, slug = href.partition("#")
    target = Path(os.path.normpath(file.parent / path)) if path else file
    if target in files:
        return f"#{_anchor(target, slug)}"
    return Path(os.path.relpath(target, folder)).as_posix() + mark + slug


def _figure_attributes(file: Path) -> dict[str, str]:
    """Return a figure's attributes: data URL of its PNG in few colours, and class by its shape."""
    picture, written = file.with_suffix(".png"), io.BytesIO()
    try:
        with Image.open(picture) as image:
            shape = "wide" if image.width > WIDE else "high"
            few = image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    except OSError:
        raise ContractError(
            "no such PNG; run the stage that draws it", file=picture
        ) from None
    few.save(written, "PNG", optimize=True)
    address = f"data:image/png;base64,{b64encode(written.getvalue()).decode('ascii')}"
    return {"src": address, "class": shape}
