"""The results as a Process Run Crate: every file of the reports, and every stage as an action from its inputs to its results.

RO-Crate 1.1 (https://w3id.org/ro/crate/1.1) with the profile https://w3id.org/ro/wfrun/process/0.5. The crate's root is the folder of
the reports. What lies outside it (code, recordings, tables between stages) is described by its path from the project's root, after a #.
It states no time of day, by which runs of the same inputs would differ.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

from rocrate.model.contextentity import ContextEntity
from rocrate.model.entity import Entity
from rocrate.rocrate import ROCrate

from pipeline.report.graph import Stage
from pipeline.report.provenance import CONFIGURATION, Output

VERSION = "1.1"
PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
REPORTS, CODE = "reports/", "pipeline"
FORMATS = {
    ".csv": "text/csv", ".html": "text/html", ".json": "application/json", ".md": "text/markdown", ".png": "image/png",
    ".svg": "image/svg+xml", ".yaml": "application/yaml",
}  # fmt: skip


@dataclass(frozen=True)
class Step:
    """One run of a stage, or the drawing of a figure: its name, what it does, its program, and the paths that it reads and writes."""

    name: str
    what: str
    program: str
    reads: Sequence[str]
    writes: Sequence[str]


def steps(stages: Sequence[Stage], configured: Collection[str], models: Sequence[str]) -> list[Step]:
    """The stages, those that run once a model once for each of ``models``; those in ``configured`` read the configuration."""
    found = []
    for stage in stages:
        program = f"{CODE}/stages/{stage.name}.py"
        reads = [*stage.reads, *([CONFIGURATION] if stage.name in configured else [])]
        of_models = any("*" in path for path in stage.writes)
        for name, model in [(f"{stage.name}@{model}", model) for model in models] if of_models else [(stage.name, "*")]:
            of_one = ([path.replace("*", model) for path in paths] for paths in (reads, stage.writes))
            found.append(Step(name, stage.what, program, *of_one))
    return found


def describe(
    citation: Mapping,
    about: Mapping[str, str],
    dataset: str,
    datasheet: str,
    steps: Sequence[Step],
    captions: Mapping[str, Mapping],
    files: Sequence[str],
    outputs: Sequence[Output],
    libraries: Mapping[str, str],
) -> dict:
    """The crate as JSON-LD.

    ``citation`` is what CITATION.cff holds, ``about`` what is said of the recordings of ``dataset``, ``datasheet`` the file of the
    reports that says more; ``captions`` are those of the figures, ``files`` all files below reports.
    """
    crate = ROCrate(version=VERSION)
    things = _Things(crate, {output.path: output.md5 for output in outputs})
    licence = things.add(f"https://spdx.org/licenses/{citation['license']}", "CreativeWork", name=f"{citation['license']} licence")
    papers = [_paper(things, reference) for reference in citation["references"]]
    software = things.add(
        "#software", "SoftwareApplication", name=citation["title"], softwareVersion=citation["version"], license=licence,
        author=[things.add("#contributors", "Organization", name=author["name"]) for author in citation["authors"]],
        softwareRequirements=[
            things.add(f"#library/{name}", "SoftwareApplication", name=name, softwareVersion=version) for name, version in libraries.items()
        ],
    )  # fmt: skip
    for folder in sorted({str(PurePosixPath(file).parent) for file in files} - {REPORTS.rstrip("/")}):
        crate.add_dataset(dest_path=_inside(folder), properties={"name": folder})
    figures = {f"{REPORTS}figures/{name}": caption for name, caption in captions.items()}
    for file in files:
        caption = figures.get(str(PurePosixPath(file).with_suffix("")))
        said = {"name": caption["title"], "description": caption["caption"]} if caption else {"name": file}
        kind = PurePosixPath(file).suffix
        crate.add_file(dest_path=_inside(file), properties=said | {"encodingFormat": FORMATS[kind]})
    for folder in crate.get_by_type("Dataset"):
        if folder is not crate.root_dataset:
            folder["hasPart"] = [things.of(file) for file in files if _inside(file).startswith(folder.id)]
    recordings = things.of(f"data/raw/{dataset}")
    for key, value in {"name": about["subject"], "description": about["source"], "license": about["licence"]}.items():
        recordings[key] = value
    recordings["subjectOf"] = [things.of(f"data/raw/{dataset}/dataset.yaml"), things.of(datasheet)]
    drawn = []
    for name, of in captions.items():
        pictures = [file for file in files if file.startswith(f"{REPORTS}figures/{name}.")]
        drawn.append(Step(f"figures/{name}", of["title"], of["script"], of["sources"], pictures))
    actions = [_action(things, step, software) for step in (*steps, *drawn)]
    root = crate.root_dataset
    for key, value in {
        "name": citation["title"], "description": " ".join(citation["abstract"].split()), "datePublished": citation["date-released"],
        "license": licence, "citation": papers, "about": recordings, "mentions": actions,
        "conformsTo": things.add(PROFILE, "CreativeWork", name="Process Run Crate", version=PROFILE.rpartition("/")[2]),
    }.items():  # fmt: skip
        root[key] = value
    written = crate.metadata.generate()
    return written | {"@graph": sorted(written["@graph"], key=lambda entity: entity["@id"])}


class _Things:
    """The entities of a crate, each made where it is first named."""

    def __init__(self, crate: ROCrate, hashes: Mapping[str, str]) -> None:
        self._crate, self._hashes = crate, hashes

    def add(self, identifier: str, kind: str, **properties: object) -> Entity:
        return self._crate.add(ContextEntity(self._crate, identifier, properties={"@type": kind, **properties}))

    def of(self, path: str) -> Entity:
        """What lies at a path from the project's root, with the hash that DVC holds of it where a stage wrote it."""
        inside = path.startswith(REPORTS)
        found = self._crate.get(_inside(path)) or self._crate.get(f"{_inside(path)}/") if inside else self._crate.get(f"#{path}")
        if found is None:
            kind = "SoftwareSourceCode" if path.startswith(CODE) else "CreativeWork" if PurePosixPath(path).suffix else "Dataset"
            found = self.add(f"#{path}", kind, name=path)
        if path in self._hashes:
            found["identifier"] = f"md5:{self._hashes[path]}"
        return found


def _inside(path: str) -> str:
    """A path of the reports from the crate's root."""
    return path.removeprefix(REPORTS)


def _action(things: _Things, step: Step, software: Entity) -> Entity:
    """From what is read to what is written; code is no input but what the program runs on."""
    code = [things.of(path) for path in step.reads if path.startswith(CODE) and path != step.program]
    program = things.add(
        f"#{step.program}", "SoftwareApplication", name=step.program, softwareVersion=software["softwareVersion"],
        softwareRequirements=[software, *code],
    )  # fmt: skip
    inputs, results = [things.of(path) for path in step.reads if not path.startswith(CODE)], [things.of(path) for path in step.writes]
    said = {"description": step.what} if step.what else {}
    return things.add(f"#run/{step.name}", "CreateAction", name=step.name, instrument=program, object=inputs, result=results, **said)


def _paper(things: _Things, reference: Mapping) -> Entity:
    persons = [(author["given-names"], author["family-names"]) for author in reference["authors"]]
    authors = [
        things.add(f"#person/{family}", "Person", name=f"{given} {family}", givenName=given, familyName=family) for given, family in persons
    ]
    return things.add("#paper", "ScholarlyArticle", name=reference["title"], author=authors)
