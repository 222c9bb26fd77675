"""report: what holds of the paper's claims in every dataset there is a run of, the numbers of this run, the errata and the equations."""

from __future__ import annotations

import json
from pathlib import Path

from pipeline import config
from pipeline.audit.advantage import advantage_section
from pipeline.audit.claims import Stated, parse_claims
from pipeline.audit.comparison import compare_models, comparison_section
from pipeline.audit.controls import control_section
from pipeline.audit.equations import citations, equations_page, parse_items
from pipeline.audit.errata import correct, errata_page, parse_errata
from pipeline.audit.results import results_page
from pipeline.audit.run import read_runs
from pipeline.audit.strict import build
from pipeline.audit.verdicts import decide_each, verdict_data, verdict_section
from pipeline.typed_yaml import read_yaml

REPORTS, DATASETS = Path("reports"), Path("reports/datasets")
CLAIMS, ERRATA = Path("reports/claims.yaml"), Path("pipeline/audit/errata.yaml")
PACKAGE, PAPER = Path("pipeline"), Path("pipeline/audit/paper.yaml")


def run() -> None:
    """Decide the claims on every run's evidence, and write claims.json, report.md, errata.md and equations.md."""
    settings = config.sections("report")
    runs = read_runs(DATASETS, first=settings.dataset.name)
    stated = build(Stated, read_yaml(CLAIMS), file=CLAIMS)
    decided = decide_each(parse_claims(stated.claims), runs, stated.recordings_of_the_paper)
    here = runs[0]
    datasets = [{"dataset": of.dataset, "scale": of.scale, "recordings": whose.recordings} for of, whose in zip(runs, decided, strict=True)]
    claims = {"datasets": datasets, "claims": verdict_data(decided)}
    opening = [verdict_section(decided), comparison_section([compare_models(of) for of in runs])]
    for of in runs:
        if "log_score_differences" in of.tables:
            opening.append(advantage_section(of.dataset, of.tables["log_score_differences"], of.matrix_models, of.rivals))
    if "control_scores" in here.tables:
        opening.append(control_section(here.tables["control_scores"], here.matrix_models))
    errata = errata_page(correct(parse_errata(read_yaml(ERRATA).get("errata")), here.evidence, decided[0].verdicts))
    items = parse_items(read_yaml(PAPER).get("items"))
    _write("claims.json", json.dumps(claims, indent=2, ensure_ascii=False) + "\n")
    _write("report.md", results_page(here.dataset, here.scale, list(here.models), here.metrics, here.tables, opening))
    _write("errata.md", errata)
    _write("equations.md", equations_page(items, citations(PACKAGE, items)))


def _write(name: str, text: str) -> None:
    partial = REPORTS / f".{name}.partial"
    partial.write_text(text, encoding="utf-8")
    partial.replace(REPORTS / name)
