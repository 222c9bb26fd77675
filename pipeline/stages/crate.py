"""crate: the files of the reports, and how each came about, as an RO-Crate for archives and programs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from pipeline import config
from pipeline.report.crate import describe, steps
from pipeline.report.graph import Stage, read_stages, reads_configuration
from pipeline.report.provenance import locked_libraries, locked_outputs
from pipeline.typed_yaml import read_yaml

CITATION, REQUIREMENTS, LOCK = Path("CITATION.cff"), Path("requirements.lock"), Path("dvc.lock")
# a link to dvc.yaml, by which this stage depends on it: DVC takes no file of that name as a dependency
EXPERIMENT = Path("pipeline/report/experiment.yaml")
RECORDINGS, CAPTIONS, DATASHEET = Path("data/raw"), Path("reports/figures/captions.json"), Path("reports/datasheet.md")
OUT = Path("reports/ro-crate-metadata.json")
LATER = ("crate", "page")  # what they write is not there yet, or is that of an earlier run


def run() -> None:
    """Describe what the other stages wrote, and the page that is to come."""
    settings = config.sections("crate")
    dataset, models = settings.dataset.name, list(settings.models)
    recordings = RECORDINGS / dataset
    sheet = read_yaml(recordings / "dataset.yaml")
    stages, configured = [], set()
    for file in (recordings / "dvc.yaml", EXPERIMENT):
        if file.is_file():
            definitions = read_yaml(file)["stages"]
            for stage in read_stages(file.read_text(encoding="utf-8"), definitions, dataset):
                reads = [path.replace("${recordings}", sheet["recordings"]) for path in stage.reads]
                stages.append(replace(stage, reads=reads))
            configured |= {name for name, stage in definitions.items() if reads_configuration(stage)}
    done = [stage for stage in stages if stage.name not in LATER]
    locks = [read_yaml(file)["stages"] for file in (recordings / LOCK, LOCK) if file.is_file()]
    crate = describe(
        citation=read_yaml(CITATION),
        about=sheet["about"],
        dataset=dataset,
        datasheet=DATASHEET.as_posix(),
        steps=steps(stages, configured, models),
        captions=json.loads(CAPTIONS.read_text(encoding="utf-8")),
        files=_reported(stages),
        outputs=[output for lock in locks for output in locked_outputs(lock, [stage.name for stage in done], models)],
        libraries=locked_libraries(REQUIREMENTS.read_text(encoding="utf-8")),
    )
    partial = OUT.with_name(f".{OUT.name}.partial")
    partial.write_text(json.dumps(crate, indent=1, ensure_ascii=False, sort_keys=True) + "\n", encoding="utf-8")
    partial.replace(OUT)


def _reported(stages: list[Stage]) -> list[str]:
    """The files of the reports that stages read or write, the page among them before it is written."""
    named = [path for stage in stages for path in (*stage.reads, *stage.writes) if path.startswith("reports/")]
    found = {file for path in named for place in Path().glob(path) for file in (place, *place.rglob("*")) if file.is_file()}
    later = {Path(path) for stage in stages if stage.name in LATER for path in stage.writes}
    return sorted(file.as_posix() for file in (found | later) - {OUT})
