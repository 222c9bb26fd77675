"""``python -m pipeline crate``: dataset card of params.yaml's dataset, and a Process Run Crate that
records how each file of the reports was made.

The crate, reports/ro-crate-metadata.json, is an RO-Crate 1.1 (https://w3id.org/ro/crate/1.1) with
the folder of the reports as root. Paths outside this folder are written as # and the path from the
project's root. The crate has no time stamps: equal inputs give equal bytes.
"""

import json
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import pandas as pd
from rocrate.model.contextentity import ContextEntity
from rocrate.model.entity import Entity
from rocrate.rocrate import ROCrate

from pipeline.configuration import config, datasheet
from pipeline.core.contracts import write_text
from pipeline.core.typed_yaml import read_yaml
from pipeline.verdicts.wording import number, table

ARGUMENTS: dict = {}
HERE, REPORTS = Path(__file__).parent, Path("reports")
CRATE = REPORTS / "ro-crate-metadata.json"
QUALITY = ["instrument", "quantity", "unit", "total", "mean", "least", "greatest"]
PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
FORMATS = {".csv": "text/csv", ".html": "text/html", ".json": "application/json"}
FORMATS |= {".md": "text/markdown", ".png": "image/png", ".svg": "image/svg+xml"}
FORMATS |= {".yaml": "application/yaml"}


def run() -> None:
    """Write the dataset card and the crate from the lock files and the reports."""
    settings = config.sections("crate", HERE / "dvc.yaml")
    name = settings.dataset.name
    reports, about = REPORTS / name, read_yaml(datasheet.path_of(name))["about"]
    stages = _locked_stages(Path("data/raw") / name / "dvc.lock")
    stored = [out for stage in stages.values() for out in stage["outs"]]
    tables = [pd.read_csv(reports / f"tables/{t}.csv") for t in ("takes", "recording_quality")]
    write_text(card(settings, about, stored, *tables), reports / "dataset_card.md")
    for lock in (Path("dvc.lock"), *sorted(Path("pipeline/studies").glob("*/dvc.lock"))):
        stages |= _locked_stages(lock)
    files = [file for file in REPORTS.rglob("[!.]*") if file.is_file() and file != CRATE]
    recordings = {"path": f"data/raw/{name}"} | about
    crate = _crate(read_yaml(Path("CITATION.cff")), recordings, stages, sorted(files, key=str))
    write_text(json.dumps(crate, indent=1, ensure_ascii=False, sort_keys=True) + "\n", CRATE)
    print(f"crate: wrote {reports / 'dataset_card.md'} and {CRATE}")


def _locked_stages(file: Path) -> dict[str, dict]:
    """Return name → stage of a lock file for stages whose outputs exist; DVC keeps removed ones."""
    entries = read_yaml(file).get("stages", {}) if file.is_file() else {}
    made = [name for name, e in entries.items() if all(Path(o["path"]).exists() for o in e["outs"])]
    return {name: entries[name] for name in made}


def card(
    settings: Any, about: Mapping, stored: list[dict], takes: pd.DataFrame, quality: pd.DataFrame
) -> str:
    """Return the dataset card as Markdown: card.yaml with values and tables.

    ``settings`` has seed and dataset, ``about`` is the datasheet's section, ``stored`` are the
    locked outputs of the recording, ``takes`` and ``quality`` are tables of the reports.
    """
    dataset, motion = settings.dataset, settings.dataset.motion
    answers = read_yaml(HERE / "card.yaml")["synthetic" if dataset.laboratory else "recorded"]
    parts = [[part, str(count)] for part, count in takes["part"].value_counts().items()]
    files = [[f"`{o['path']}`", str(o.get("nfiles", 1)), number(o["size"])] for o in stored]
    cells = quality[QUALITY].map(lambda v: number(v) if isinstance(v, float) else str(v))
    left_out = takes.loc[takes["left_out"].astype(bool), "take"]
    values = {"name": dataset.name, "seed": settings.seed, "steps": motion.steps}
    values |= {"rate": number(motion.rate), "parts": table(["part", "takes"], parts)}
    values["files"] = table(["folder or file", "files", "bytes"], files) if files else ""
    values["counts"] = table(QUALITY, cells.to_numpy().tolist())
    values["left_out"] = ", ".join(left_out) or "none"
    texts = [f"## {heading}\n\n{text}" for heading, text in answers.items()]
    filled = "\n\n".join([f"# Dataset card: {dataset.name}", *texts]).format(**about, **values)
    return filled.replace("\n\n\n\n", "\n\n") + "\n"


def _crate(citation: Mapping, recordings: Mapping, stages: Mapping, files: list[Path]) -> dict:
    """Return the crate as JSON-LD, from CITATION.cff, path, subject, source and licence of the
    ``recordings``, name → stage of DVC's lock files, and all ``files`` of the reports.
    """
    crate = ROCrate(version="1.1")

    def add(identifier: str, kind: str, **properties: object) -> Entity:
        entity = ContextEntity(crate, identifier, properties={"@type": kind, **properties})
        return crate.get(entity.id) or crate.add(entity)

    def at(path: str, md5: str | None = None) -> Entity:
        """Return the entity of a path from the project's root, with the MD5 in DVC's lock file."""
        inside = path.removeprefix("reports/") if path.startswith("reports/") else f"#{path}"
        kind = "CreativeWork" if PurePosixPath(path).suffix else "Dataset"
        entity = crate.get(inside) or crate.get(f"{inside}/") or add(f"#{path}", kind, name=path)
        if md5:
            entity["identifier"] = f"md5:{md5}"
        return entity

    licence = add(f"https://spdx.org/licenses/{citation['license']}", "CreativeWork")
    authors = [add("#contributors", "Organization", name=a["name"]) for a in citation["authors"]]
    own = {"name": citation["title"], "softwareVersion": citation["version"], "author": authors}
    software = add("#software", "SoftwareApplication", license=licence, **own)
    folders = {}
    for folder in sorted({folder for file in files for folder in file.parents[:-2]}, key=str):
        place = {"dest_path": str(folder.relative_to(REPORTS)), "properties": {"name": str(folder)}}
        folders[folder] = crate.add_dataset(**place)
    for file in files:
        kind = FORMATS.get(file.suffix, "application/octet-stream")
        properties = {"name": str(file), "encodingFormat": kind}
        entity = crate.add_file(dest_path=str(file.relative_to(REPORTS)), properties=properties)
        for folder in file.parents[:-2]:
            folders[folder].append_to("hasPart", entity)
    dataset = at(recordings["path"])
    for key, word in (("name", "subject"), ("license", "licence"), ("description", "source")):
        dataset[key] = recordings[word]
    actions = []
    for name, stage in stages.items():
        properties = {"name": name, "description": stage["cmd"], "instrument": software}
        for key, ends in (("object", "deps"), ("result", "outs")):
            properties[key] = [at(one["path"], one.get("md5")) for one in stage.get(ends, [])]
        actions.append(add(f"#run/{name}", "CreateAction", **properties))
    papers = []
    for paper in citation["references"]:
        names = [f"{one['given-names']} {one['family-names']}" for one in paper["authors"]]
        authors = [add(f"#person/{name.replace(' ', '-')}", "Person", name=name) for name in names]
        papers.append(add("#paper", "ScholarlyArticle", name=paper["title"], author=authors))
    root = crate.root_dataset
    root["name"], root["license"] = citation["title"], licence
    root["description"] = " ".join(citation["abstract"].split())
    root["datePublished"] = str(citation["date-released"])
    root["citation"], root["about"], root["mentions"] = papers, dataset, actions
    root["conformsTo"] = add(PROFILE, "CreativeWork", name="Process Run Crate")
    written = crate.metadata.generate()
    return written | {"@graph": sorted(written["@graph"], key=lambda entity: entity["@id"])}
