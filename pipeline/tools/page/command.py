"""``python -m pipeline page [studies]``: HTML page of the report, the model card, errata, datasets,
recordings, equations and glossary, or of the studies, with styles and figures inside.
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
from markdown_it.token import Token
from PIL import Image

from pipeline.configuration import config
from pipeline.core.contracts import write_text
from pipeline.core.errors import ContractError

REPORTS = Path("reports")
STUDIES = REPORTS / "studies"
# sections of the page of results, by path from the dataset's folder
RESULTS = (
    "report.md",
    "model_card.md",
    "errata.md",
    "../datasets.md",
    "recordings.md",
    "../equations.md",
    "../glossary.md",
)
PAPER = "Motion and wrench uncertainties of robotic manipulators, reproduced"
TEMPLATE = Path(__file__).with_name("page.html")
COLOURS = 64  # of a figure on the page, enough for its lines and shades
# px, least width of a figure of two columns, which scrolls on a narrow screen
WIDE = 900
FOLDED = ("model_card", "errata")  # pages whose sections are folded
IN_CARDS = "report"  # page whose parts under headings of level 3 are beside each other
FOLD = r"<details><summary>\1</summary>\2</details>\n"
FOLDS = re.compile(r"(<h2 .*?</h2>)(.*?)(?=<h2 |\Z)", re.DOTALL)
# an anchor before a heading, as the Markdown of the errata states it
ANCHOR = re.compile(
    r"<p>&lt;a id=&quot;([\w-]+)&quot;&gt;&lt;/a&gt;</p>\s*(<h\d [^>]*>)",
)
CARD = re.compile(r"<h3 .*?(?=<h3 |\Z)", re.DOTALL)
CARDS = re.compile(r"(?:<h3 .*?(?=<h[1-3] |\Z))+", re.DOTALL)
ONE_CARD = r'<div class="card">\n\g<0></div>\n'
CARD_GROUP = '<div class="cards">\n{}</div>\n'
FIGURE = re.compile(r'(<p [^>]*class="figure"[^>]*><img [^>]*>)\s+(.+?)</p>', re.DOTALL)
# an interval or a number with an exponent in a text, which stays on one line
NUMBER = re.compile(r"(?<=[\s;>(])(?:\[-?\d[^][<>]*\]|-?\d[\d.]*e-\d+)(?=[^<>]*<)")
DEPTH = 2  # levels of headings in the table of contents, of a page that is not folded
Heading = tuple[int, str, str]  # level (1: title), anchor and text


def run(part: str = "results") -> None:
    """Write reports/DATASET/index.html, or reports/studies.html for the studies."""
    if part == "results":
        dataset = config.sections("page").dataset.name
        folder = REPORTS / dataset
        title = f"{PAPER}: dataset {dataset}"
        out = folder / "index.html"
        files = [Path(os.path.normpath(folder / name)) for name in RESULTS]
    else:
        title = f"{PAPER}: studies beyond the paper"
        out = REPORTS / "studies.html"
        files = sorted(STUDIES.glob("*.md"))
        if not files:
            message = "no study has run; run `dvc repro -P`"
            raise ContractError(message, folder=STUDIES)
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
    file: Path,
    files: Sequence[Path],
    folder: Path,
) -> tuple[str, list[Heading]]:
    """Return the HTML of a Markdown file, and its headings for the table of contents."""
    try:
        content = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        raise ContractError(
            "no such page in UTF-8; run `dvc repro -P`",
            file=file,
        ) from None
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = parser.parse(content)
    headings: list[Heading] = []
    for place, token in enumerate(tokens):
        if token.type == "heading_open":
            heading = _heading(token, tokens[place + 1], file, headings)
            token.attrs["id"] = heading[1]
            headings.append(heading)
        for child in token.children or []:
            if child.type == "image":
                picture = file.parent / str(child.attrs["src"])
                child.attrs |= _figure_attributes(picture)
            elif child.type == "link_open":
                link = str(child.attrs["href"])
                child.attrs["href"] = _address(link, file, files, folder)
        if token.children and token.children[0].type == "image":
            tokens[place - 1].attrs["class"] = "figure"
    html = _arranged(parser.renderer.render(tokens, parser.options, {}), file)
    if file.stem in FOLDED:
        headings = headings[:1]
    return html, headings or [(1, "", file.stem)]


def _heading(
    token: Token,
    content: Token,
    file: Path,
    headings: Sequence[Heading],
) -> Heading:
    """Return level, anchor and text of a heading after the earlier ``headings``: the anchor is the
    file's name and GitHub's slug, the title's the file's name only.
    """
    text = "".join(child.content for child in content.children or [])
    slug = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")
    is_title = not headings and token.tag == "h1"
    anchor = _anchor(file, "" if is_title else slug)
    twin = re.compile(rf"{re.escape(anchor)}(-\d+)?")
    twins = [name for _, name, _ in headings if twin.fullmatch(name)]
    if twins:
        anchor = f"{anchor}-{len(twins) + 1}"
    return int(token.tag[1]), anchor, escape(text)


def _arranged(html: str, file: Path) -> str:
    """Return the ``html`` of a file with sections folded or beside each other, and the anchors
    that the Markdown states.
    """
    html = html.replace("&lt;br&gt;", "<br>")  # line ends in a table's cells
    html = ANCHOR.sub(rf'\2<span id="{file.stem}--\1"></span>', html)
    html = NUMBER.sub(r'<span class="number">\g<0></span>', html)
    html = FIGURE.sub(r"\1</p>\n<p>\2</p>", html)
    if file.stem in FOLDED:
        return FOLDS.sub(FOLD, html)
    if file.stem == IN_CARDS:
        return CARDS.sub(
            lambda cards: CARD_GROUP.format(CARD.sub(ONE_CARD, cards[0])),
            html,
        )
    return html


def _anchor(file: Path, slug: str) -> str:
    return "--".join(filter(None, (file.stem, slug)))


def _address(href: str, file: Path, files: Sequence[Path], folder: Path) -> str:
    """Return the address on the page for the link ``href`` in ``file``."""
    if re.match(r"[a-z]+:", href):
        return href
    path, mark, slug = href.partition("#")
    target = file
    if path:
        target = Path(os.path.normpath(file.parent / path))
    anchor = _anchor(target, slug)
    if target in files:
        return f"#{anchor}"
    if target.suffix == ".md" and target.parent.name == STUDIES.name:
        studies = target.parent.with_suffix(".html")
        return f"{_relative(studies, folder)}#{anchor}"
    return f"{_relative(target, folder)}{mark}{slug}"


def _relative(file: Path, folder: Path) -> str:
    return Path(os.path.relpath(file, folder)).as_posix()


def _figure_attributes(file: Path) -> dict[str, str]:
    """Return a figure's attributes: data URL of its PNG in few colours, and class by its shape."""
    picture = file.with_suffix(".png")
    written = io.BytesIO()
    try:
        with Image.open(picture) as image:
            shape = "wide" if image.width > WIDE else "high"
            few = image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    except OSError:
        raise ContractError(
            "no such PNG; run the stage that draws it",
            file=picture,
        ) from None
    few.save(written, "PNG", optimize=True)
    address = f"data:image/png;base64,{b64encode(written.getvalue()).decode('ascii')}"
    return {"src": address, "class": shape}
