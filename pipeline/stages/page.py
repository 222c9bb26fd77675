"""page: everything that the run found as one HTML page that needs no other file."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from pipeline import config, contracts
from pipeline.audit.claims import Stated, parse_claims
from pipeline.audit.comparison import compare_models
from pipeline.audit.errata import correct, parse_errata
from pipeline.audit.run import read_runs
from pipeline.audit.strict import build
from pipeline.audit.verdicts import decide_each
from pipeline.report.graph import draw, read_stages
from pipeline.report.illustrations import download, illustrations
from pipeline.report.page import Content, readable, render
from pipeline.report.player import player
from pipeline.report.provenance import locked_libraries, locked_outputs, measured_costs, options_of, sha256_of
from pipeline.report.sensitive import changes
from pipeline.typed_yaml import read_yaml

DATASETS, FIGURES, TABLES = Path("reports/datasets"), Path("reports/figures"), Path("reports/tables")
PLAY, OUT = Path("data/play"), Path("reports/index.html")
CLAIMS, ERRATA = Path("reports/claims.yaml"), Path("pipeline/audit/errata.yaml")
LOCK, REQUIREMENTS = Path("dvc.lock"), Path("requirements.lock")
# measured apart, on one machine: what this run takes would make the page another every time
COSTS = Path("reports/benchmarks/experiment.json")
# a link to dvc.yaml, by which this stage depends on it: DVC takes no file of that name as a dependency
EXPERIMENT = Path("pipeline/report/experiment.yaml")
SECTIONS = ("dataset", "models", "filter", "articulation", "simulation", "wrench", "scale", "recovery", "seed")
DRAWN = 3  # models in the figures of single takes


def run() -> None:
    """Gather what the other stages wrote, and write the page."""
    settings = config.sections("page")
    runs = read_runs(DATASETS, first=settings.dataset.name)
    here = runs[0]
    stated = build(Stated, read_yaml(CLAIMS), file=CLAIMS)
    decided = decide_each(parse_claims(stated.claims), runs, stated.recordings_of_the_paper)
    errata = correct(parse_errata(read_yaml(ERRATA).get("errata")), here.evidence, decided[0].verdicts)
    stages = read_stages(EXPERIMENT.read_text(encoding="utf-8"), read_yaml(EXPERIMENT)["stages"], here.dataset)
    tables = {file: pd.read_csv(file) for file in sorted(TABLES.glob("*.csv"))}
    captions = json.loads((FIGURES / "captions.json").read_text(encoding="utf-8"))
    # this stage's own entry is written after it, and would be that of an earlier page
    others = [stage.name for stage in stages if "page" != stage.name]
    raw = Path("data/raw") / here.dataset / LOCK
    content = Content(
        dataset=here.dataset,
        scale=here.scale,
        decided=decided,
        comparisons=[compare_models(of) for of in runs],
        player=_player(),
        illustrations=illustrations(captions, FIGURES, TABLES, stages, list(here.models)[:DRAWN]),
        changes=next((changes(rows) for file, rows in tables.items() if file.stem == "sensitivity"), None),
        errata=errata,
        stages=stages,
        drawing=draw(stages),
        tables=[readable(download(file), rows) for file, rows in tables.items()],
        options={name: value for section in SECTIONS for name, value in options_of(getattr(settings, section), section).items()},
        outputs=locked_outputs(_lock(LOCK), others, list(here.models)),
        recordings=locked_outputs(_lock(raw), list(_lock(raw)), []),
        libraries=locked_libraries(REQUIREMENTS.read_text(encoding="utf-8")),
        requirements=sha256_of(REQUIREMENTS),
        costs=measured_costs(COSTS),
    )
    partial = OUT.with_name(f".{OUT.name}.partial")
    partial.write_text(render(content), encoding="utf-8")
    partial.replace(OUT)


def _player() -> dict | None:
    """The take to be played; None where the dataset has none."""
    if not contracts.exists("played_frames", PLAY):
        return None
    frames = contracts.read("played_frames", PLAY)
    images = [(PLAY / f"{number:04d}.png").read_bytes() for number in frames["frame"]]
    return player(frames, contracts.read("played_posteriors", PLAY), images)


def _lock(file: Path) -> dict:
    """The stages in a lock file of DVC; none where no stage has run yet."""
    return read_yaml(file).get("stages", {}) if file.is_file() else {}
