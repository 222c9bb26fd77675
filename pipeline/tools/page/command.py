"""page: everything that the paper's pipeline and the studies yield as one page, the card of the
dataset, and an RO-Crate that says how each file came about.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from types import SimpleNamespace

from pipeline.core import config, contracts
from pipeline.core.typed_yaml import read_yaml
from pipeline.tools.page.card import card, gather
from pipeline.tools.page.crate import describe
from pipeline.tools.page.graph import draw
from pipeline.tools.page.illustrations import illustrations, table
from pipeline.tools.page.page import Content, player_script, render, render_studies
from pipeline.tools.page.player import player
from pipeline.tools.page.provenance import (
    flat_options,
    locked_libraries,
    measured_costs,
    sha256_of,
)
from pipeline.tools.page.stages import StageRun, locked_runs, purpose, stages_in_order
from pipeline.tools.page.study_pages import study_pages
from pipeline.tools.page.take import read_take
from pipeline.verdicts.claims import Stated, parse_claims
from pipeline.verdicts.decision import decide_each
from pipeline.verdicts.errata import correct, parse_errata
from pipeline.verdicts.run import read_runs
from pipeline.verdicts.strict import build

HERE, STUDIES = Path("pipeline/tools/page"), Path("pipeline/studies")
REPORTS, RECORDINGS, LOCK = Path("reports"), Path("data/raw"), Path("dvc.lock")
DATASETS, FIGURES = REPORTS / "datasets", REPORTS / "figures"
TABLES, STUDY_PAGES = REPORTS / "tables", REPORTS / "studies"
PAGE, STUDIES_PAGE, PLAYER, CARD, CRATE = (
    REPORTS / "index.html",
    REPORTS / "studies.html",
    REPORTS / "player.js",
    REPORTS / "dataset_card.md",
    REPORTS / "ro-crate-metadata.json",
)
CLAIMS, ERRATA = REPORTS / "claims.yaml", Path("pipeline/verdicts/errata.yaml")
CITATION, REQUIREMENTS = Path("CITATION.cff"), Path("requirements.lock")
# measured apart, on one machine: what this run takes would make the page another every time
COSTS = REPORTS / "benchmarks/experiment.json"
# where trials run and what else changes no result is left out
SECTIONS = "dataset models filter articulation simulation wrench scale seed".split()


def run(words: list[str]) -> None:
    """Write the page, the card of the dataset and the crate from what has run."""
    argparse.ArgumentParser(prog="python -m pipeline page", description=__doc__).parse_args(words)
    settings = config.sections("page", HERE / "dvc.yaml")
    models = list(settings.models)
    recordings = locked_runs(RECORDINGS / settings.dataset.name / LOCK, models)
    locks = [LOCK, *sorted(STUDIES.glob("*/dvc.lock"))]
    outputs = [stage_run for file in locks for stage_run in locked_runs(file, models)]
    contracts.write_text(card(gather(settings)), CARD)
    content = _content(settings, recordings, outputs)
    contracts.write_text(render(content), PAGE)
    contracts.write_text(render_studies(content.studies), STUDIES_PAGE)
    contracts.write_text(player_script(content.player), PLAYER)
    crate = _crate(settings.dataset.name, [*recordings, *outputs, _own_run(settings.dataset.name)])
    text = json.dumps(crate, indent=1, ensure_ascii=False, sort_keys=True) + "\n"
    contracts.write_text(text, CRATE)


def _content(
    settings: SimpleNamespace, recordings: list[StageRun], outputs: list[StageRun]
) -> Content:
    runs = read_runs(DATASETS, first=settings.dataset.name)
    here = runs[0]
    stated = build(Stated, read_yaml(CLAIMS), file=CLAIMS)
    decided = decide_each(parse_claims(stated.claims), runs, stated.recordings_of_the_paper)
    errata = parse_errata(read_yaml(ERRATA).get("errata"))
    stages = stages_in_order([*recordings, *outputs])
    captions = json.loads((FIGURES / "captions.json").read_text(encoding="utf-8"))
    take = read_take(settings.dataset, list(settings.models))
    return Content(
        dataset=here.dataset,
        scale=here.scale,
        decided=decided,
        player=player(take) if take else None,
        illustrations=illustrations(captions, FIGURES, TABLES, outputs),
        studies=study_pages(STUDY_PAGES, REPORTS),
        errata=correct(errata, here, decided[0].verdicts),
        stages=stages,
        drawing=draw(stages),
        tables=[table(file) for file in sorted(TABLES.glob("*.csv"))],
        options={
            name: value
            for section in SECTIONS
            for name, value in flat_options(getattr(settings, section), section).items()
        },
        outputs=sorted(outputs, key=lambda stage_run: stage_run.name),
        recordings=recordings,
        libraries=locked_libraries(REQUIREMENTS.read_text(encoding="utf-8")),
        requirements=sha256_of(REQUIREMENTS),
        costs=measured_costs(COSTS),
    )


def _own_run(dataset: str) -> StageRun:
    """This very run, which no lock file holds yet."""
    entry = read_yaml(HERE / "dvc.yaml")["stages"]["page"]
    reads = [path.replace("${dataset}", dataset) for path in entry["deps"]]
    program = HERE / "command.py"
    writes = dict.fromkeys(file.as_posix() for file in (PAGE, STUDIES_PAGE, PLAYER, CARD, CRATE))
    return StageRun(
        "page",
        "page",
        purpose(program),
        program.as_posix(),
        dict.fromkeys(reads, ""),
        dict.fromkeys(writes, ""),
    )


def _crate(dataset: str, runs: list[StageRun]) -> dict:
    captions = {
        (file.parent / name).as_posix(): caption
        for file in (
            FIGURES / "captions.json",
            *sorted(STUDY_PAGES.glob("*/figures/captions.json")),
        )
        for name, caption in json.loads(file.read_text(encoding="utf-8")).items()
    }
    return describe(
        citation=read_yaml(CITATION),
        about=read_yaml(RECORDINGS / dataset / "dataset.yaml")["about"],
        dataset=dataset,
        card=CARD.as_posix(),
        runs=runs,
        captions=captions,
        files=_reported(runs),
        libraries=locked_libraries(REQUIREMENTS.read_text(encoding="utf-8")),
    )


def _reported(runs: list[StageRun]) -> list[str]:
    """The files of the reports that stages read or wrote, but for the crate itself."""
    named = {path for each in runs for path in (*each.reads, *each.writes)}
    places = [Path(path) for path in named if path.startswith("reports/")]
    files = {file for place in places for file in (place, *place.rglob("*")) if file.is_file()}
    return sorted(file.as_posix() for file in files - {CRATE} if file.name[0] != ".")
