"""The results as a Process Run Crate: the files of the reports, and every stage as an action from
its inputs to its outputs.

RO-Crate 1.1 (https://w3id.org/ro/crate/1.1) with the profile https://w3id.org/ro/wfrun/process/0.5.
The crate's root is the folder of the reports; a path outside it is named from the project's root,
after a #. No time of day is stated: runs of the same inputs give the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath

from rocrate.model.contextentity import ContextEntity
from rocrate.model.entity import Entity
from rocrate.rocrate import ROCrate

PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
REPORTS = "reports/"
FORMATS = {".csv": "text/csv", ".html": "text/html", ".json": "application/json"}
FORMATS |= {".md": "text/markdown", ".png": "image/png", ".svg": "image/svg+xml"}
FORMATS |= {".yaml": "application/yaml"}


def describe(
    citation: Mapping, recordings: Mapping[str, str], stages: Mapping[str, Mapping], files: list
) -> dict:
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
        inside = path.removeprefix(REPORTS) if path.startswith(REPORTS) else f"#{path}"
        entity = crate.get(inside) or crate.get(f"{inside}/")
        kind = "CreativeWork" if PurePosixPath(path).suffix else "Dataset"
        entity = entity or add(f"#{path}", kind, name=path)
        if md5:
            entity["identifier"] = f"md5:{md5}"
        return entity

    licence = add(f"https://spdx.org/licenses/{citation['license']}", "CreativeWork")
    software = add(
        "#software",
        "SoftwareApplication",
        name=citation["title"],
        softwareVersion=citation["version"],
        license=licence,
        author=[add("#contributors", "Organization", name=a["name"]) for a in citation["authors"]],
    )
    folders = {parent.as_posix() for file in files for parent in PurePosixPath(file).parents}
    for folder in sorted(name for name in folders if name.startswith(REPORTS)):
        crate.add_dataset(dest_path=folder.removeprefix(REPORTS), properties={"name": folder})
    inside = [file.removeprefix(REPORTS) for file in files]
    for file, name in zip(files, inside, strict=True):
        kind = FORMATS.get(PurePosixPath(file).suffix, "application/octet-stream")
        crate.add_file(dest_path=name, properties={"name": file, "encodingFormat": kind})
    for folder in crate.get_by_type("Dataset"):
        if folder is not crate.root_dataset:
            folder["hasPart"] = [crate.get(n) for n in inside if n.startswith(folder.id)]
    dataset = at(recordings["path"])
    dataset["name"], dataset["license"] = recordings["subject"], recordings["licence"]
    dataset["description"] = recordings["source"]
    actions = [
        add(
            f"#run/{name}",
            "CreateAction",
            name=name,
            description=stage["cmd"],
            instrument=software,
            object=[at(dep["path"], dep.get("md5")) for dep in stage.get("deps", [])],
            result=[at(out["path"], out.get("md5")) for out in stage["outs"]],
        )
        for name, stage in stages.items()
    ]
    papers = []
    for paper in citation["references"]:
        names = [f"{one['given-names']} {one['family-names']}" for one in paper["authors"]]
        authors = [add(f"#person/{name.replace(' ', '-')}", "Person", name=name) for name in names]
        papers.append(add("#paper", "ScholarlyArticle", name=paper["title"], author=authors))
    properties = {
        "name": citation["title"],
        "description": " ".join(citation["abstract"].split()),
        "datePublished": str(citation["date-released"]),
        "license": licence,
        "citation": papers,
        "about": dataset,
        "mentions": actions,
        "conformsTo": add(PROFILE, "CreativeWork", name="Process Run Crate"),
    }
    for key, value in properties.items():
        crate.root_dataset[key] = value
    written = crate.metadata.generate()
    return written | {"@graph": sorted(written["@graph"], key=lambda entity: entity["@id"])}
