"""The page holds its Markdown files whole: nothing of Markdown is left in it, links lead somewhere,
and figures are inside.
"""

from __future__ import annotations

import io
import re
from base64 import b64decode
from html.parser import HTMLParser
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pipeline.core.errors import ContractError
from pipeline.tools.page.command import RESULTS, page

MARKDOWN = re.compile(r"\*\*|\]\(|^\s*#+ |\|\s*---|^```|!\[", re.MULTILINE)

REPORT = """# Results: `lab` & more

First, see [Why](card.md#why-2), [the table](#a-table), [errata](errata.md#sign)
and [elsewhere](https://example.org/a).

## A table

| claim | of <all> |
| --- | --- |
| **x** below 1<br>y above | ✓ |

## A figure

![A drawn figure](figures/drawn.svg)
"""
CARD = "# Card\n\n## Why\n\nBecause.\n\n## Why\n\nAgain, of [the report](report.md).\n"


class Parsed(HTMLParser):
    """Texts outside code, addresses, anchors and tags of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.texts, self.addresses, self.anchors = [], [], []
        self.pictures, self.open = [], []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        values = dict(attrs)
        if tag not in ("meta", "img", "br", "hr"):
            self.open.append(tag)
        self.addresses += [values["href"]] if tag == "a" else []
        self.anchors += [values["id"]] if "id" in values else []
        self.pictures += [values] if tag == "img" else []

    def handle_startendtag(self, tag: str, attrs: list) -> None:
        self.handle_starttag(tag, attrs)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"code", "style"} & {*self.open}:
            self.texts.append(data)


@pytest.fixture
def reports(tmp_path: Path) -> Path:
    (tmp_path / "figures").mkdir()
    Image.new("RGB", (300, 200), "teal").save(tmp_path / "figures/drawn.png")
    (tmp_path / "report.md").write_text(REPORT, encoding="utf-8")
    (tmp_path / "card.md").write_text(CARD, encoding="utf-8")
    return tmp_path


def test_two_files_become_one_page(reports):
    html = page("Results <1>", [reports / "report.md", reports / "card.md"], reports)
    parsed = Parsed(html)
    assert not parsed.open and "<title>Results &lt;1&gt;</title>" in html
    assert len(set(parsed.anchors)) == len(parsed.anchors)
    inside = {address[1:] for address in parsed.addresses if address.startswith("#")}
    assert inside <= {*parsed.anchors} and {"card--why-2", "report--a-table", "card"} <= inside
    outside = [address for address in parsed.addresses if not address.startswith("#")]
    assert outside == ["errata.md#sign", "https://example.org/a"]
    text = "".join(parsed.texts)
    assert "of <all>" in text and "<br>" not in text and "Results: " in text
    assert not MARKDOWN.search(text)
    contents = html.partition("<nav")[2].partition("</nav>")[0]
    named = ["Results: lab &amp; more", "A table", "A figure", "Card", "Why", "Why"]
    assert re.findall(r">([^<>\n]+)</a>", contents) == named
    (figure,) = parsed.pictures
    assert figure["alt"] == "A drawn figure"
    kind, _, data = figure["src"].partition(";base64,")
    with Image.open(io.BytesIO(b64decode(data))) as image:
        assert kind == "data:image/png" and image.size == (300, 200)
        assert image.convert("RGB").getpixel((5, 5)) == (0, 128, 128)


@given(st.text(alphabet="<>&\"'`*_[]()#|!$\n\\ ab", max_size=60))
def test_no_text_becomes_markup_of_its_own(tmp_path_factory, text):
    file = tmp_path_factory.mktemp("page") / "report.md"
    file.write_text("# Title\n\n" + text.replace("![", "[") + "\n", encoding="utf-8")
    html = page("", [file], file.parent)
    assert not Parsed(html).open and "<script" not in html


@pytest.mark.parametrize("missing", ["card.md", "figures/drawn.png"])
def test_a_missing_file_is_refused_by_name(reports, missing):
    (reports / missing).unlink()
    with pytest.raises(ContractError, match=missing):
        page("", [reports / "report.md", reports / "card.md"], reports)


def test_the_committed_report_reads_as_a_page():
    folder = Path(__file__).parents[2] / "reports/youbot"
    html = page("Results", [folder / file for file in RESULTS], folder)
    parsed = Parsed(html)
    assert not MARKDOWN.search("".join(parsed.texts))
    inside = {address[1:] for address in parsed.addresses if address.startswith("#")}
    assert inside <= {*parsed.anchors}
    beside = [address.partition("#")[0] for address in parsed.addresses if ":" not in address]
    assert [name for name in beside if not (folder / name).exists()] == []
    assert not re.search(r"""(src|href)=["'](https?:)?//""", html.partition("<main>")[0])
