"""A study's page of Markdown becomes a part of the page of results."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from pipeline.core.errors import ContractError
from pipeline.tools.page.study_pages import study_pages

TEXT = """# What <it> costs

Opening, with a [link](faults/rows.csv), [another](../errata.md#sign) and <b>markup</b>.

![A figure](faults/figures/costs.png)

## Rows

| kind | cost |
|---|---|
| a | 1 |
"""


@pytest.fixture
def reports(tmp_path) -> Path:
    figures = tmp_path / "reports/studies/faults/figures"
    figures.mkdir(parents=True)
    Image.new("RGB", (30, 20), "white").save(figures / "costs.png")
    (tmp_path / "reports/studies/faults.md").write_text(TEXT)
    return tmp_path / "reports"


def test_its_figures_and_links_lead_from_where_the_page_lies(reports):
    (study,) = study_pages(reports / "studies", reports)
    assert (study.name, study.title) == ("faults", "What <it> costs")
    assert 'src="studies/faults/figures/costs.png"' in study.html
    assert 'width="30" height="20"' in study.html
    assert 'href="studies/faults/rows.csv"' in study.html
    assert 'href="errata.md#sign"' in study.html


def test_headings_are_below_the_pages_own_tables_scroll_and_markup_is_text(reports):
    (study,) = study_pages(reports / "studies", reports)
    assert "<h3>Rows</h3>" in study.html and "<h1>" not in study.html
    frame = study.html.index('<div class="scrolled" role="region"')
    assert frame < study.html.index("<table>") < study.html.index("</table>")
    assert "Rows, table 1" in study.html[frame:]
    assert "&lt;b&gt;markup" in study.html


def test_where_no_study_has_run_there_is_none(tmp_path):
    assert study_pages(tmp_path / "studies", tmp_path) == []


def test_a_figure_that_is_gone_is_named(reports):
    (reports / "studies/faults/figures/costs.png").unlink()
    with pytest.raises(ContractError, match=r"costs\.png"):
        study_pages(reports / "studies", reports)
