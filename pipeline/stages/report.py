"""report: verdicts on the paper's claims for every dataset that has a run, the paper's numbers,
figures and errata, the model card, and the places of its equations in the code.
"""

from __future__ import annotations

import json
from pathlib import Path

from pipeline.core import config, contracts
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import validated
from pipeline.verdicts import report_page
from pipeline.verdicts.claims import Stated, parse_claims
from pipeline.verdicts.decision import decide_each, verdict_data
from pipeline.verdicts.equations import citations, equations_page, parse_items
from pipeline.verdicts.errata import correct, errata_page, parse_errata
from pipeline.verdicts.filters import filters_part
from pipeline.verdicts.model_card import model_card, predictors
from pipeline.verdicts.readings import readings_part
from pipeline.verdicts.run import read_runs

REPORTS, DATASETS = Path("reports"), Path("reports/datasets")
CLAIMS, ERRATA = Path("reports/claims.yaml"), Path("pipeline/verdicts/errata.yaml")
PACKAGE, PAPER = Path("pipeline"), Path("pipeline/verdicts/paper.yaml")
BEYOND = ("studies", "tools")  # what goes beyond the paper comes after its report


def run() -> None:
    """Decide the claims on every run's numbers, and write claims.json, report.md, errata.md,
    equations.md and model_card.md of the dataset, and datasets.md.
    """
    name = config.sections("report").dataset.name
    runs, reports = read_runs(DATASETS, first=name), REPORTS / name
    here = runs[0]
    stated = validated(Stated, read_yaml(CLAIMS), file=CLAIMS)
    decided = decide_each(parse_claims(stated.claims), runs, stated.recordings_of_the_paper)
    errata = parse_errata(read_yaml(ERRATA).get("errata"))
    items = parse_items(read_yaml(PAPER).get("items"))
    sources = citations(PACKAGE, items, BEYOND)
    captions = json.loads((reports / "captions.json").read_text(encoding="utf-8"))
    datasets = [
        {"dataset": each.dataset, "scale": each.scale, "recordings": whose.recordings}
        for each, whose in zip(runs, decided, strict=False)  # the last needs no run
    ]
    claims = {"datasets": datasets, "claims": verdict_data(decided)}
    shown = [run for run in runs if run is here or run.dataset in report_page.ROBOTS]
    parts = [
        ("Claims that fail", report_page.failures(here, decided)),
        ("Readings of LU or QR", readings_part(shown)),
        ("Published against ours", report_page.published_and_ours(here, decided)),
        ("Predictors", predictors(here) if "predictions" in here.tables else ""),
        ("Filters", filters_part(here)),
        ("Figures", report_page.figures(captions, items, sources)),
        ("The gravest errata of the paper", report_page.gravest_errata(errata)),
        ("More", report_page.LINKS),
    ]
    pages = {
        "claims.json": json.dumps(claims, indent=2, ensure_ascii=False) + "\n",
        "report.md": report_page.report_page(here, decided, parts),
        "errata.md": errata_page(correct(errata, here, decided)),
        "model_card.md": model_card(here, runs[1:]),
        "recordings.md": report_page.recordings_page(here),
    }
    summary = report_page.summary_numbers(here, decided)
    contracts.write_metrics(summary, reports / "summary.json")
    for file, text in pages.items():
        contracts.write_text(text, reports / file)
    contracts.write_text(report_page.datasets_page(decided), REPORTS / "datasets.md")
    contracts.write_text(equations_page(items, sources), REPORTS / "equations.md")
