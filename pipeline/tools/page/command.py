"""``python -m pipeline page [studies]``: one HTML page of the report and the model card, or of the
studies.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.core.contracts import write_text
from pipeline.core.errors import ContractError
from pipeline.tools.page.document import page

REPORTS = Path("reports")
RESULTS = [REPORTS / "report.md", REPORTS / "model_card.md"]
PAGE, STUDIES_PAGE = REPORTS / "index.html", REPORTS / "studies.html"


def run(words: list[str]) -> None:
    """Write reports/index.html, or reports/studies.html for the studies."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline page", description=__doc__.partition(": ")[2]
    )
    parser.add_argument(
        "part",
        nargs="?",
        choices=["results", "studies"],
        default="results",
        help="content of the page (default results)",
    )
    if parser.parse_args(words).part == "results":
        write_text(page("Results", RESULTS, REPORTS), PAGE)
        return
    studies = sorted((REPORTS / "studies").glob("*.md"))
    if not studies:
        raise ContractError("no study has run; run `dvc repro -P`", folder=REPORTS / "studies")
    write_text(page("Studies beyond the paper", studies, REPORTS), STUDIES_PAGE)
