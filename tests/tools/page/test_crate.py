"""The crate of the results: what the library reads back of it is every file there is, and every
stage with what it read and wrote.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Iterator

import pytest
from omegaconf import OmegaConf
from project_copy import run
from rocrate.rocrate import ROCrate

from pipeline.tools.page.crate import PROFILE, describe
from pipeline.tools.page.stages import StageRun

CITATION = {
    "title": "an experiment",
    "version": "1.2",
    "license": "MIT",
    "abstract": "What it\nis.",
    "date-released": "2001-02-03",
    "authors": [{"name": "The contributors"}],
    "references": [
        {"title": "A paper", "authors": [{"given-names": "A.", "family-names": "Author"}]}
    ],
}
RUNS = [
    StageRun(
        "configure",
        "configure",
        "options",
        "pipeline/stages/configure.py",
        {"params.yaml": "", "pipeline/stages/configure.py": ""},
        {"data/config.yaml": "00"},
    ),
    *(
        StageRun(
            f"fit@{model}",
            "fit",
            "parameters",
            "pipeline/stages/fit.py",
            {"data/raw/lab": "", "pipeline/models": "", "data/config.yaml": ""},
            {f"data/fit/{model}": md5, f"reports/metrics/fit_{model}.json": ""},
        )
        for model, md5 in (("a", "0f.dir"), ("b", ""))
    ),
    StageRun(
        "figures",
        "figures",
        "pictures",
        "pipeline/stages/figures.py",
        {"data/fit": ""},
        {"reports/figures": "1e.dir"},
    ),
    StageRun(
        "page",
        "page",
        "",
        "pipeline/tools/page/command.py",
        {"reports/figures": ""},
        {"reports/index.html": ""},
    ),
]
CAPTIONS = {
    "reports/figures/ridge": {
        "title": "A ridge",
        "caption": "It is long.",
        "script": "pipeline/figures/ridge.py",
        "sources": ["data/fit/a/r.parquet"],
    }
}
FILES = [
    "reports/figures/captions.json",
    "reports/figures/ridge.png",
    "reports/index.html",
    "reports/metrics/fit_a.json",
    "reports/sheet.md",
]


@pytest.fixture
def described() -> dict:
    return describe(
        CITATION,
        {"subject": "an arm", "source": "a lab", "licence": "CC0"},
        "lab",
        "reports/sheet.md",
        RUNS,
        CAPTIONS,
        FILES,
        {"numpy": "2.4"},
    )


def entities(crate: dict) -> dict[str, dict]:
    return {entity["@id"]: entity for entity in crate["@graph"]}


def references(value: object) -> Iterator[str]:
    if isinstance(value, dict):
        yield from (
            [value["@id"]]
            if set(value) == {"@id"}
            else (name for each in value.values() for name in references(each))
        )
    elif isinstance(value, list):
        yield from (name for each in value for name in references(each))


def ids(entity: dict, key: str) -> list[str]:
    return list(references(entity[key]))


def require_whole(crate: dict) -> None:
    """What RO-Crate 1.1 and the profile ask for: whatever is referred to is described, the root
    says what it is, actions are whole.
    """
    result = entities(crate)
    assert {name for entity in result.values() for name in references(entity)} - set(result) == {
        "https://w3id.org/ro/crate/1.1"
    }
    root = result["./"]
    assert all(
        root.get(key) for key in ("name", "description", "datePublished", "license")
    ) and ids(root, "conformsTo") == [PROFILE]
    actions = {name for name, entity in result.items() if entity["@type"] == "CreateAction"}
    assert set(ids(root, "mentions")) == actions
    for name in actions:
        (program,) = ids(result[name], "instrument")
        assert (
            result[program]["@type"] == "SoftwareApplication"
            and result[name]["result"]
            and result[name]["name"]
        )
    parts = {name for name, entity in result.items() if entity["@type"] == "File"}
    assert parts <= set(ids(root, "hasPart")) and all(
        result[name]["encodingFormat"] for name in parts
    )


def test_it_is_what_the_specification_asks_for(described):
    require_whole(described)
    broken = {"@graph": [entity for entity in described["@graph"] if entity["@id"] != "#paper"]}
    with pytest.raises(AssertionError):
        require_whole(broken)


def test_a_stage_is_an_action_once_a_model_from_its_inputs_to_its_results(described):
    result = entities(described)
    assert [name for name in result if name.startswith("#run/")] == [
        "#run/configure",
        "#run/figures",
        "#run/figures/ridge",
        "#run/fit@a",
        "#run/fit@b",
        "#run/page",
    ]
    fit = result["#run/fit@a"]
    assert ids(fit, "object") == ["#data/raw/lab", "#data/config.yaml"]
    assert ids(fit, "result") == ["#data/fit/a", "metrics/fit_a.json"]
    assert ids(result["#pipeline/stages/fit.py"], "softwareRequirements") == [
        "#software",
        "#pipeline/models",
    ]
    assert (
        result["#data/fit/a"]["identifier"] == "md5:0f.dir"
        and result["figures/"]["identifier"] == "md5:1e.dir"
    )
    assert "identifier" not in result["#data/fit/b"]


def test_a_figure_is_drawn_by_its_script_from_its_tables(described):
    result = entities(described)
    drawn = result["#run/figures/ridge"]
    assert ids(drawn, "instrument") == ["#pipeline/figures/ridge.py"] and ids(drawn, "object") == [
        "#data/fit/a/r.parquet"
    ]
    assert (
        ids(drawn, "result") == ["figures/ridge.png"]
        and result["figures/ridge.png"]["description"] == "It is long."
    )
    assert ids(result["figures/"], "hasPart") == ["figures/captions.json", "figures/ridge.png"]


def test_software_dataset_and_paper_are_named_as_they_name_themselves(described):
    result = entities(described)
    assert (
        result["#software"]["softwareVersion"],
        result["#library/numpy"]["softwareVersion"],
    ) == (
        "1.2",
        "2.4",
    )
    assert result["#data/raw/lab"]["license"] == "CC0" and "sheet.md" in ids(
        result["#data/raw/lab"], "subjectOf"
    )
    assert result["#person/Author"]["name"] == "A. Author" and ids(result["./"], "citation") == [
        "#paper"
    ]


@pytest.mark.slow
def test_the_library_reads_back_every_file_and_every_stage_of_a_run(results):
    reports = results / "reports"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        crate = ROCrate(reports)
    read = {entity.id for entity in crate.data_entities if entity.type == "File"}
    there = {file.relative_to(reports).as_posix() for file in reports.rglob("*") if file.is_file()}
    assert read == there - {"ro-crate-metadata.json"}
    locked = {}
    for file in ("dvc.lock", "data/raw/youbot/dvc.lock"):
        locked |= OmegaConf.to_container(OmegaConf.load(results / file))["stages"]
    actions = {entity["name"]: entity for entity in crate.get_by_type("CreateAction")}
    assert set(locked) | {"page"} <= set(actions)
    for name, stage in locked.items():
        inside = {entity.id for entity in actions[name]["result"]}
        outs = [out["path"] for out in stage["outs"]]
        reported = {p.removeprefix("reports/") for p in outs if p.startswith("reports/")}
        assert {path.rstrip("/") for path in inside if not path.startswith("#")} == reported
        assert (results / actions[name]["instrument"]["name"]).is_file()
    for name in json.loads((reports / "figures/captions.json").read_text()):
        assert (results / actions[f"figures/{name}"]["instrument"]["name"]).is_file()
    require_whole(json.loads((reports / "ro-crate-metadata.json").read_text()))
    beside = re.findall(r'<a href="([\w.-]+)">', (reports / "index.html").read_text())
    assert {"ro-crate-metadata.json", "dataset_card.md"} <= set(beside) <= there


@pytest.mark.slow
def test_what_is_written_anew_is_the_same_to_the_byte(results):
    """The page is among what the second run finds there, and the crate's own text."""
    files = [
        results / f"reports/{name}"
        for name in ("index.html", "studies.html", "player.js", "ro-crate-metadata.json")
    ]
    before = [file.read_bytes() for file in files]
    done = run("python", "-m", "pipeline", "page", cwd=results)
    assert done.returncode == 0, done.stderr
    assert [file.read_bytes() for file in files] == before
