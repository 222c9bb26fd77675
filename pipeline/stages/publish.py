"""publish: copies of tables, numbers, figures and evidence in reports.

It is a separate stage, because DVC's run cache restores no stage with outputs in git.
"""

import shutil
from pathlib import Path

from pipeline.configuration import config
from pipeline.core import contracts

SCORE, FIGURES, REPORTS = Path("data/score"), Path("data/figures"), Path("reports")
CAPTIONS = "captions.json"


def run() -> None:
    """Copy the results to ``reports/DATASET`` and the evidence to ``reports/datasets``."""
    name = config.sections("publish").dataset.name
    reports = REPORTS / name
    for source in (SCORE / "tables", SCORE / "metrics", FIGURES):
        with contracts.replacing(reports / source.name) as folder:
            for file in source.iterdir():
                if file.name != CAPTIONS:
                    shutil.copyfile(file, folder / file.name)
    for source, file in (
        (FIGURES / CAPTIONS, reports / CAPTIONS),
        (SCORE / "evidence.json", REPORTS / f"datasets/{name}.json"),
    ):
        contracts.write_text(source.read_text(encoding="utf-8"), file)
