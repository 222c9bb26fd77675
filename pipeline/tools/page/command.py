"""``python -m pipeline page [studies]``: one HTML page of the report and the model card, or of the
studies.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.core import config
from pipeline.core.contracts import write_text
from pipeline.core.errors import ContractError
from pipeline.tools.page.document import page

REPORTS, RESULTS = Path("reports"), ("report.md", "model_card.md")


def run(words: list[str]) -> None:
    """Write reports/DATASET/index.html, or reports/studies.html for the studies."""
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
        folder = REPORTS / config.sections("page").dataset.name
        write_text(
            page("Results", [folder / name for name in RESULTS], folder), folder / "index.html"
        )
        return
    studies = sorted((REPORTS / "studies").glob("*.md"))
    if not studies:
        raise ContractError("no study has run; run `dvc repro -P`", folder=REPORTS / "studies")
    write_text(page("Studies beyond the paper", studies, REPORTS), REPORTS / "studies.html")
