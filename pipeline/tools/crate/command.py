"""``python -m pipeline crate``: dataset card, and a Process Run Crate of how each file of the
reports was made.

RO-Crate 1.1 (https://w3id.org/ro/crate/1.1) with the profile https://w3id.org/ro/wfrun/process/0.5.
The crate's root is the folder of the reports; a path outside it is named from the project's root,
after a #. No time of day is stated: runs of the same inputs give the same bytes.
"""

import json
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import pandas as pd
from rocrate.model.contextentity import ContextEntity
from rocrate.model.entity import Entity
from rocrate.rocrate import ROCrate

from pipeline.core import config, datasheet
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
    reports = REPORTS / name
    about = read_yaml(datasheet.path_of(name))["about"]
    stages = _locked(Path("data/raw") / name / "dvc.lock")
    stored = [out for stage in stages.values() for out in stage["outs"]]
    tables = [pd.read_csv(reports / f"tables/{t}.csv") for t in ("takes", "recording_quality")]
    write_text(card(settings, about, stored, *tables), reports / "dataset_card.md")
    for lock in (Path("dvc.lock"), *sorted(Path("pipeline/studies").glob("*/dvc.lock"))):
        stages |= _locked(lock)
    files = [file for file in REPORTS.rglob("*") if file.is_file() and file != CRATE]
    files = sorted(file.as_posix() for file in files if not file.name.startswith("."))
    recordings = {"path": f"data/raw/{name}"} | dict(about)
    crate = describe(read_yaml(Path("CITATION.cff")), recordings, stages, files)
    write_text(json.dumps(crate, indent=1, ensure_ascii=False, sort_keys=True) + "\n", CRATE)
    print(f"crate: wrote {reports / 'dataset_card.md'} and {CRATE}")


def _locked(file: Path) -> dict[str, dict]:
    """Stages of a lock file by name, without those that are gone: DVC keeps their entries."""
    entries = read_yaml(file).get("stages", {}) if file.is_file() else {}
    there = {n: all(Path(out["path"]).exists() for out in e["outs"]) for n, e in entries.items()}
    return {name: entry for name, entry in entries.items() if there[name]}


def card(
    settings: Any,
    about: Mapping[str, str],
    stored: list[dict],
    takes: pd.DataFrame,
    quality: pd.DataFrame,
) -> str:
    """Return the dataset card as Markdown: answers of card.yaml, and the composition in numbers.

    ``settings`` holds seed and dataset, ``about`` is the datasheet's section, ``stored`` the locked
    outputs of the recording, ``takes`` and ``quality`` are tables of the reports.
    """
    dataset, motion = settings.dataset, settings.dataset.motion
    answers = read_yaml(HERE / "card.yaml")["synthetic" if dataset.laboratory else "recorded"]
    filled = {"name": dataset.name, "seed": settings.seed, **about}
    parts_of = [[part, str(count)] for part, count in takes["part"].value_counts().items()]
    files = [[f"`{o['path']}`", str(o.get("nfiles", 1)), number(o["size"])] for o in stored]
    cells = quality[QUALITY].map(lambda v: number(v) if isinstance(v, float) else str(v))
    left_out = takes.loc[takes["left_out"].astype(bool), "take"]
    composition = [
        "## Composition",
        f"{about['subject']}. A take is one motion of {motion.steps} steps at "
        f"{number(motion.rate)} per second.",
        table(["part", "takes"], parts_of),
        *([table(["folder or file", "files", "bytes"], files)] if files else []),
        "Missing, wrong or noisy, as counted over the takes or records of an instrument:",
        table(QUALITY, cells.to_numpy().tolist()),
        "Takes beyond the dataset's limits, which the analysis leaves out: "
        f"{', '.join(left_out) or 'none'}. Each take: [takes](tables/takes.csv).",
    ]
    parts = [f"# Dataset card: {dataset.name}"]
    for heading, text in answers.items():
        parts += [f"## {heading}", text.format(**filled)]
        parts += composition if heading == "Motivation" else []
    return "\n\n".join(parts) + "\n"


def describe(citation: Mapping, recordings: Mapping, stages: Mapping, files: list[str]) -> dict:
    """Return the crate as JSON-LD.

    ``citation`` is CITATION.cff, ``recordings`` holds path, subject, source and licence of the
    dataset, ``stages`` the entries of DVC's lock files by name, ``files`` all paths below reports.
    """
    crate = ROCrate(version="1.1")

    def add(identifier: str, kind: str, **properties: object) -> Entity:
        entity = ContextEntity(crate, identifier, properties={"@type": kind, **properties})
        return crate.get(entity.id) or crate.add(entity)

    def at(path: str, md5: str | None = None) -> Entity:
        """Entity of a path from the project's root, with the MD5 that DVC has of it."""
        inside = path.removeprefix("reports/") if path.startswith("reports/") else f"#{path}"
        kind = "CreativeWork" if PurePosixPath(path).suffix else "Dataset"
        entity = crate.get(inside) or crate.get(f"{inside}/") or add(f"#{path}", kind, name=path)
        if md5:
            entity["identifier"] = f"md5:{md5}"
        return entity

    root, inside = crate.root_dataset, [file.removeprefix("reports/") for file in files]
    licence = add(f"https://spdx.org/licenses/{citation['license']}", "CreativeWork")
    authors = [add("#contributors", "Organization", name=a["name"]) for a in citation["authors"]]
    own = {"name": citation["title"], "softwareVersion": citation["version"], "author": authors}
    software = add("#software", "SoftwareApplication", license=licence, **own)
    folders = {parent.as_posix() for file in files for parent in PurePosixPath(file).parents}
    for folder in sorted(name for name in folders if name.startswith("reports/")):
        crate.add_dataset(dest_path=folder.removeprefix("reports/"), properties={"name": folder})
    for file, name in zip(files, inside, strict=True):
        kind = FORMATS.get(PurePosixPath(file).suffix, "application/octet-stream")
        crate.add_file(dest_path=name, properties={"name": file, "encodingFormat": kind})
    for folder in crate.get_by_type("Dataset"):
        if folder is not root:
            folder["hasPart"] = [crate.get(n) for n in inside if n.startswith(folder.id)]
    dataset = at(recordings["path"])
    for key, word in (("name", "subject"), ("license", "licence"), ("description", "source")):
        dataset[key] = recordings[word]
    actions = []
    for name, stage in stages.items():
        ends = [
            [at(one["path"], one.get("md5")) for one in stage.get(k, [])] for k in ("deps", "outs")
        ]
        action = {"name": name, "description": stage["cmd"], "instrument": software}
        action |= dict(zip(("object", "result"), ends, strict=True))
        actions.append(add(f"#run/{name}", "CreateAction", **action))
    papers = []
    for paper in citation["references"]:
        names = [f"{one['given-names']} {one['family-names']}" for one in paper["authors"]]
        authors = [add(f"#person/{name.replace(' ', '-')}", "Person", name=name) for name in names]
        papers.append(add("#paper", "ScholarlyArticle", name=paper["title"], author=authors))
    root["name"], root["license"] = citation["title"], licence
    root["description"] = " ".join(citation["abstract"].split())
    root["datePublished"] = str(citation["date-released"])
    root["citation"], root["about"], root["mentions"] = papers, dataset, actions
    root["conformsTo"] = add(PROFILE, "CreativeWork", name="Process Run Crate")
    written = crate.metadata.generate()
    return written | {"@graph": sorted(written["@graph"], key=lambda entity: entity["@id"])}
