"""The page holds its Markdown files whole, with links that lead somewhere and figures inside."""

import io
import os
import re
from base64 import b64decode
from pathlib import Path
from xml.etree.ElementTree import Element, fromstring

import pytest
from omegaconf import OmegaConf
from PIL import Image
from source_code import MODULES, ROOT, covers, needed, package

from pipeline.core.errors import ContractError
from pipeline.tools.page.command import RESULTS, page


def test_the_page_of_the_studies_depends_on_the_code_that_writes_it():
    pipelines = OmegaConf.load(ROOT / "pipeline/studies/dvc.yaml")
    deps = OmegaConf.to_container(pipelines)["stages"]["studies_page"]["deps"]
    harmless = {name for name in MODULES if package(name) in ("configuration", "core")}
    files = []
    for name in needed("pipeline.tools.page.command", harmless):
        if MODULES[name].stat().st_size:
            files.append(MODULES[name].relative_to(ROOT).as_posix())

    files.remove("pipeline/__init__.py")
    uncovered = [file for file in files if not any(covers(dep, file) for dep in deps)]

    assert uncovered == []


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


def parsed(html: str) -> Element:
    """Return the tree of a page; raises ParseError for a page that is not well-formed."""
    closed = re.sub(r"<(meta[^>]*|br|hr)>", r"<\1/>", html)
    return fromstring(closed.removeprefix("<!doctype html>"))


def text_outside_code(page: Element) -> str:
    """Return the text of a page without code, style and script."""
    for tag in ("code", "style", "script"):
        for element in page.iter(tag):
            element.text = ""
    return "".join(page.itertext())


def anchors_of(page: Element) -> list[str]:
    """Return all anchors of a page."""
    return [element.get("id") for element in page.iter() if element.get("id")]


def addresses_of(page: Element) -> tuple[set[str], list[str]]:
    """Return the anchors that links inside a page lead to, and the links to other places."""
    links = [link.get("href") for link in page.iter("a")]
    inside = {link[1:] for link in links if link.startswith("#")}
    return inside, [link for link in links if not link.startswith("#")]


@pytest.fixture
def reports(tmp_path: Path) -> Path:
    (tmp_path / "figures").mkdir()
    Image.new("RGB", (300, 200), "teal").save(tmp_path / "figures/drawn.png")
    (tmp_path / "report.md").write_text(REPORT, encoding="utf-8")
    (tmp_path / "card.md").write_text(CARD, encoding="utf-8")
    return tmp_path


CONTENTS = ["Results: lab & more", "A table", "A figure", "Card", "Why", "Why"]


@pytest.fixture
def one_page(reports) -> str:
    files = [reports / "report.md", reports / "card.md"]
    return page("Results <1>", files, reports)


def test_two_files_become_one_page_with_their_links(one_page):
    tree = parsed(one_page)
    assert "<title>Results &lt;1&gt;</title>" in one_page
    anchors = anchors_of(tree)
    assert len({*anchors}) == len(anchors)

    inside, outside = addresses_of(tree)
    assert {"card--why-2", "report--a-table", "card"} <= inside <= {*anchors}
    assert outside == ["errata.md#sign", "https://example.org/a"]
    assert [link.text for link in tree.find(".//nav").iter("a")] == CONTENTS


def test_the_page_shows_plain_text_and_the_figure_itself(one_page):
    tree = parsed(one_page)
    shown = text_outside_code(tree)
    assert "of <all>" in shown and "<br>" not in shown and "Results: " in shown
    assert not MARKDOWN.search(shown)

    (figure,) = tree.iter("img")
    assert figure.get("alt") == "A drawn figure"
    kind, _, data = figure.get("src").partition(";base64,")
    assert kind == "data:image/png"
    with Image.open(io.BytesIO(b64decode(data))) as image:
        assert image.size == (300, 200)
        pixel = image.convert("RGB").getpixel((5, 5))
    assert pixel == (0, 128, 128)


def test_an_interval_and_an_exponent_stay_on_one_line_in_texts_only(reports):
    text = (
        "# R\n\nBy -4.1e-05 [1.5, 2e-3], not 7.\n\n![Of 2e-3 rad](figures/drawn.png)\n"
    )
    (reports / "card.md").write_text(text)
    tree = parsed(page("", [reports / "card.md"], reports))
    whole = [span.text for span in tree.iter("span")]
    assert whole == ["-4.1e-05", "[1.5, 2e-3]"]
    assert tree.find(".//img").get("alt") == "Of 2e-3 rad"


@pytest.mark.parametrize("name", ["figures/drawn.png", "card.md"])
@pytest.mark.parametrize("damaged", [True, False])
def test_a_damaged_and_a_missing_file_are_named(reports, name, damaged):
    if damaged:
        (reports / name).write_bytes(b"\xff")
    else:
        (reports / name).unlink()
    with pytest.raises(ContractError, match=name):
        page("", [reports / "card.md", reports / "report.md"], reports)


def test_figures_are_beside_each_other_with_their_text_and_a_card_is_folded(reports):
    figure = "![A figure](figures/drawn.png)\nCompare.\n- it holds<br>**lab ✓**\n\n"
    text = f"# R\n\n## F\nKey.\n\n### One\n{figure}### Two\n{figure}## Next\nThe end.\n"
    (reports / "report.md").write_text(text)
    (reports / "model_card.md").write_text(
        "# Card\n\nAnswer.\n\n## Why\nA rule.\n\n## More\nx\n",
    )
    tree = parsed(page("", [reports / "report.md", reports / "model_card.md"], reports))
    cards = [part for part in tree.iter("div") if part.get("class") == "card"]
    assert [card.find("h3").text for card in cards] == ["One", "Two"]

    for card in cards:
        picture, caption = card.findall("p")
        assert picture.find("img") is not None and caption.text == "Compare."
        assert card.find(".//strong").text == "lab ✓"
        assert "The end" not in "".join(card.itertext())
    folded = ["".join(summary.itertext()).split() for summary in tree.iter("summary")]
    assert folded == [["Why"], ["More"]]


def test_anchors_of_errata_lead_to_their_headings_and_studies_to_their_page(reports):
    (reports / "errata.md").write_text(
        '# Errata\n\n<a id="sign"></a>\n\n## 1. A sign\n\nWrong.\n',
    )
    (reports / "report.md").write_text(
        "# R\n\n[why](errata.md#sign), [study](studies/pose.md#answer)\n",
    )

    html = page("", [reports / "report.md", reports / "errata.md"], reports)

    tree = parsed(html)
    (heading,) = [h2 for h2 in tree.iter("h2") if "A sign" in "".join(h2.itertext())]
    assert heading.find("span").get("id") == "errata--sign"
    addresses = [link.get("href") for link in tree.findall(".//main//a[@href]")]
    assert addresses == ["#errata--sign", "studies.html#pose--answer"]
    contents = [link.text for link in tree.find(".//nav").iter("a")]
    assert contents == ["R", "Errata"]


def test_no_table_or_figure_is_a_tab_stop_and_folded_sections_are_printed(reports):
    html = page("", [reports / "report.md"], reports)
    assert "tabindex" not in html and "wide content" not in html
    assert "beforeprint" in html and "::details-content" in html


def test_the_committed_report_reads_as_a_page():
    folder = ROOT / "reports/youbot"
    files = [Path(os.path.normpath(folder / file)) for file in RESULTS]

    html = page("Results", files, folder)

    tree = parsed(html)
    assert not MARKDOWN.search(text_outside_code(tree))
    inside, outside = addresses_of(tree)
    assert inside <= {*anchors_of(tree)}
    for link in outside:
        if ":" not in link:
            file = link.partition("#")[0]
            assert (folder / file).exists(), link
    head = html.partition("<main>")[0]
    assert not re.search(r"""(src|href)=["'](https?:)?//""", head)
