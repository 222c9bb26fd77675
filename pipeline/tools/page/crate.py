"""The results as a Process Run Crate: every file of the reports, and every stage as an action from
its inputs to its results.

RO-Crate 1.1 (https://w3id.org/ro/crate/1.1) with the profile https://w3id.org/ro/wfrun/process/0.5.
The crate's root is the folder of the reports. What lies outside it (code, recordings, tables
between stages) is described by its path from the project's root, after a #. It states no time of
day, by which runs of the same inputs would differ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath

from rocrate.model.contextentity import ContextEntity
from rocrate.model.entity import Entity
from rocrate.rocrate import ROCrate

from pipeline.tools.page.stages import StageRun

VERSION = "1.1"
PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
REPORTS, CODE = "reports/", "pipeline"
FORMATS = {
    ".csv": "text/csv",
    ".html": "text/html",
    ".json": "application/json",
    ".md": "text/markdown",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".yaml": "application/yaml",
}


def describe(
    citation: Mapping,
    about: Mapping[str, str],
    dataset: str,
    card: str,
    runs: Sequence[StageRun],
    captions: Mapping[str, Mapping],
    files: Sequence[str],
    libraries: Mapping[str, str],
) -> dict:
    """The crate as JSON-LD.

    Args:
        citation: what CITATION.cff holds.
        about: what is said of the recordings.
        dataset: their name.
        card: the file of the reports that says more of them.
        runs: of the stages.
        captions: of the figures, by their files' paths without the suffix.
        files: all below reports.
        libraries: name → version.
    """
    crate = ROCrate(version=VERSION)
    things = _Things(crate, {path: md5 for run in runs for path, md5 in run.writes.items()})
    licence = things.add(
        f"https://spdx.org/licenses/{citation['license']}",
        "CreativeWork",
        name=f"{citation['license']} licence",
    )
    software = _software(things, citation, licence, libraries)
    _add_files(crate, things, captions, files)
    drawn = [
        _drawing(path, caption, [file for file in files if file.startswith(f"{path}.")])
        for path, caption in captions.items()
    ]
    root = crate.root_dataset
    properties = {
        "name": citation["title"],
        "description": " ".join(citation["abstract"].split()),
        "datePublished": citation["date-released"],
        "license": licence,
        "citation": [_paper(things, reference) for reference in citation["references"]],
        "about": _recordings(things, about, dataset, card),
        "mentions": [_action(things, run, software) for run in (*runs, *drawn)],
        "conformsTo": things.add(
            PROFILE, "CreativeWork", name="Process Run Crate", version=PROFILE.rpartition("/")[2]
        ),
    }
    for key, value in properties.items():
        root[key] = value
    written = crate.metadata.generate()
    return written | {"@graph": sorted(written["@graph"], key=lambda entity: entity["@id"])}


def _drawing(path: str, caption: Mapping, pictures: Sequence[str]) -> StageRun:
    """The drawing of the figure ``path`` as a run of its script."""
    return StageRun(
        name=_inside(path),
        stage="figures",
        what=caption["title"],
        program=caption["script"],
        reads=dict.fromkeys(caption["sources"], ""),
        writes=dict.fromkeys(pictures, ""),
    )


def _software(
    things: _Things, citation: Mapping, licence: Entity, libraries: Mapping[str, str]
) -> Entity:
    authors = [
        things.add("#contributors", "Organization", name=author["name"])
        for author in citation["authors"]
    ]
    requirements = [
        things.add(f"#library/{name}", "SoftwareApplication", name=name, softwareVersion=version)
        for name, version in libraries.items()
    ]
    return things.add(
        "#software",
        "SoftwareApplication",
        name=citation["title"],
        softwareVersion=citation["version"],
        license=licence,
        author=authors,
        softwareRequirements=requirements,
    )


def _add_files(
    crate: ROCrate, things: _Things, captions: Mapping[str, Mapping], files: Sequence[str]
) -> None:
    """Every file with its format and, of a figure, what it shows; every folder with its files."""
    folders = {parent.as_posix() for file in files for parent in PurePosixPath(file).parents}
    for folder in sorted(name for name in folders if name.startswith(REPORTS)):
        crate.add_dataset(dest_path=_inside(folder), properties={"name": folder})
    for file in files:
        caption = captions.get(str(PurePosixPath(file).with_suffix("")))
        words = {"name": file}
        if caption:
            words = {"name": caption["title"], "description": caption["caption"]}
        kind = FORMATS.get(PurePosixPath(file).suffix, "application/octet-stream")
        crate.add_file(dest_path=_inside(file), properties=words | {"encodingFormat": kind})
    for folder in crate.get_by_type("Dataset"):
        if folder is not crate.root_dataset:
            inside = [file for file in files if _inside(file).startswith(folder.id)]
            folder["hasPart"] = [things.at(file) for file in inside]


def _recordings(things: _Things, about: Mapping[str, str], dataset: str, card: str) -> Entity:
    recordings = things.at(f"data/raw/{dataset}")
    recordings["name"] = about["subject"]
    recordings["description"] = about["source"]
    recordings["license"] = about["licence"]
    recordings["subjectOf"] = [things.at(f"data/raw/{dataset}/dataset.yaml"), things.at(card)]
    return recordings


class _Things:
    """The entities of a crate, each made where it is first named."""

    def __init__(self, crate: ROCrate, hashes: Mapping[str, str]) -> None:
        self._crate, self._hashes = crate, hashes

    def add(self, identifier: str, kind: str, **properties: object) -> Entity:
        return self._crate.add(
            ContextEntity(self._crate, identifier, properties={"@type": kind, **properties})
        )

    def at(self, path: str) -> Entity:
        """What lies at a path from the project's root, with the hash that DVC holds of it where a
        stage wrote it.
        """
        inside = _inside(path)
        known = (inside, f"{inside}/") if path.startswith(REPORTS) else (f"#{path}",)
        thing = next(filter(None, map(self._crate.get, known)), None)
        if thing is None:
            code = "SoftwareSourceCode" if path.startswith(CODE) else None
            kind = code or ("CreativeWork" if PurePosixPath(path).suffix else "Dataset")
            thing = self.add(f"#{path}", kind, name=path)
        if self._hashes.get(path):
            thing["identifier"] = f"md5:{self._hashes[path]}"
        return thing


def _inside(path: str) -> str:
    """A path of the reports from the crate's root."""
    return path.removeprefix(REPORTS)


def _action(things: _Things, run: StageRun, software: Entity) -> Entity:
    """From what is read to what is written; code is no input but what the program runs on."""
    code = [path for path in run.reads if path.startswith(CODE)]
    program = things.add(
        f"#{run.program}",
        "SoftwareApplication",
        name=run.program,
        softwareVersion=software["softwareVersion"],
        softwareRequirements=[software, *(things.at(p) for p in code if p != run.program)],
    )
    words = {"description": run.what} if run.what else {}
    return things.add(
        f"#run/{run.name}",
        "CreateAction",
        name=run.name,
        instrument=program,
        object=[things.at(path) for path in run.reads if path not in code],
        result=[things.at(path) for path in run.writes],
        **words,
    )


def _paper(things: _Things, reference: Mapping) -> Entity:
    persons = [(author["given-names"], author["family-names"]) for author in reference["authors"]]
    authors = [
        things.add(
            f"#person/{family}",
            "Person",
            name=f"{given} {family}",
            givenName=given,
            familyName=family,
        )
        for given, family in persons
    ]
    return things.add("#paper", "ScholarlyArticle", name=reference["title"], author=authors)
