"""publish: copies of tables, numbers, figures and evidence in reports.

It is a separate stage, because DVC's run cache restores no stage with outputs in git.
"""

import shutil
from pathlib import Path

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.results import EVIDENCE, TRIALS, evidence_folder, pages_folder

SCORE = Path("data/score")
FIGURES = Path("data/figures")
CAPTIONS = "captions.json"


def run() -> None:
    """Copy the results to ``reports/DATASET`` and the evidence to ``reports/datasets``, those of a
    trial of a dataset with results to ``reports/trials``. A whole run removes a trial's evidence.
    """
    settings = config.sections("publish")
    name = settings.dataset.name
    scale = settings.scale.name
    place = pages_folder(name, scale)
    evidence = evidence_folder(name, scale)
    if place == TRIALS:
        print(
            f"publish: a trial: the results are in {place / name}, and the results of"
            f" {name} in reports stay as they are",
        )
    reports = place / name
    for source in (SCORE / "tables", SCORE / "metrics", FIGURES):
        with contracts.replacing(reports / source.name) as folder:
            for file in source.iterdir():
                if file.name != CAPTIONS:
                    shutil.copyfile(file, folder / file.name)
    for source, file in (
        (FIGURES / CAPTIONS, reports / CAPTIONS),
        (SCORE / "evidence.json", evidence / EVIDENCE / f"{name}.json"),
    ):
        contracts.write_text(source.read_text(encoding="utf-8"), file)
    if evidence != TRIALS:
        (TRIALS / EVIDENCE / f"{name}.json").unlink(missing_ok=True)
