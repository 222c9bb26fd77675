"""The crate of the results: what the library reads back of it is every file there is, and every stage with what it read and wrote."""

from __future__ import annotations

import json
import re
import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import run
from omegaconf import OmegaConf
from rocrate.rocrate import ROCrate

from pipeline.report.crate import PROFILE, Step, describe, steps
from pipeline.report.graph import Stage
from pipeline.report.provenance import Output

CITATION = {
    "title": "an experiment", "version": "1.2", "license": "MIT", "abstract": "What it\nis.", "date-released": "2001-02-03",
    "authors": [{"name": "The contributors"}],
    "references": [{"title": "A paper", "authors": [{"given-names": "A.", "family-names": "Author"}]}],
}  # fmt: skip
STAGES = [
    Stage("configure", "options", ["params.yaml"], ["data/config.yaml"], []),
    Stage("fit", "parameters", ["data/raw/lab", "pipeline/motion"], ["data/fit/*", "reports/metrics/fit_*.json"], ["configure"]),
    Stage("figures", "pictures", ["data/fit"], ["reports/figures"], ["fit"]),
    Stage("page", "", ["reports/figures"], ["reports/index.html"], ["figures"]),
]
CAPTIONS = {
    "ridge": {"title": "A ridge", "caption": "It is long.", "script": "pipeline/figures/ridge.py", "sources": ["data/fit/a/r.parquet"]}
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
        CITATION, {"subject": "an arm", "source": "a lab", "licence": "CC0"}, "lab", "reports/sheet.md", steps(STAGES, {"fit"}, ["a", "b"]),
        CAPTIONS, FILES, [Output("fit@a", "data/fit/a", "0f.dir"), Output("figures", "reports/figures", "1e.dir")], {"numpy": "2.4"},
    )  # fmt: skip


def entities(crate: dict) -> dict[str, dict]:
    return {entity["@id"]: entity for entity in crate["@graph"]}


def references(value: object) -> Iterator[str]:
    if isinstance(value, dict):
        yield from [value["@id"]] if set(value) == {"@id"} else (name for of in value.values() for name in references(of))
    elif isinstance(value, list):
        yield from (name for of in value for name in references(of))


def ids(entity: dict, key: str) -> list[str]:
    return list(references(entity[key]))


def require_whole(crate: dict) -> None:
    """What RO-Crate 1.1 and the profile ask for: whatever is referred to is described, the root says what it is, actions are whole."""
    found = entities(crate)
    assert {name for entity in found.values() for name in references(entity)} - set(found) == {"https://w3id.org/ro/crate/1.1"}
    root = found["./"]
    assert all(root.get(key) for key in ("name", "description", "datePublished", "license")) and ids(root, "conformsTo") == [PROFILE]
    actions = {name for name, entity in found.items() if entity["@type"] == "CreateAction"}
    assert set(ids(root, "mentions")) == actions
    for name in actions:
        (program,) = ids(found[name], "instrument")
        assert found[program]["@type"] == "SoftwareApplication" and found[name]["result"] and found[name]["name"]
    parts = {name for name, entity in found.items() if entity["@type"] == "File"}
    assert parts <= set(ids(root, "hasPart")) and all(found[name]["encodingFormat"] for name in parts)


def test_it_is_what_the_specification_asks_for(described):
    require_whole(described)
    broken = {"@graph": [entity for entity in described["@graph"] if entity["@id"] != "#paper"]}
    with pytest.raises(AssertionError):
        require_whole(broken)


def test_a_stage_is_an_action_once_a_model_from_its_inputs_to_its_results(described):
    found = entities(described)
    assert [name for name in found if name.startswith("#run/")] == [
        "#run/configure", "#run/figures", "#run/figures/ridge", "#run/fit@a", "#run/fit@b", "#run/page",
    ]  # fmt: skip
    fit = found["#run/fit@a"]
    assert ids(fit, "object") == ["#data/raw/lab", "#data/config.yaml"]
    assert ids(fit, "result") == ["#data/fit/a", "metrics/fit_a.json"]
    assert ids(found["#pipeline/stages/fit.py"], "softwareRequirements") == ["#software", "#pipeline/motion"]
    assert found["#data/fit/a"]["identifier"] == "md5:0f.dir" and found["figures/"]["identifier"] == "md5:1e.dir"
    assert "identifier" not in found["#data/fit/b"]


def test_a_figure_is_drawn_by_its_script_from_its_tables(described):
    found = entities(described)
    drawn = found["#run/figures/ridge"]
    assert ids(drawn, "instrument") == ["#pipeline/figures/ridge.py"] and ids(drawn, "object") == ["#data/fit/a/r.parquet"]
    assert ids(drawn, "result") == ["figures/ridge.png"] and found["figures/ridge.png"]["description"] == "It is long."
    assert ids(found["figures/"], "hasPart") == ["figures/captions.json", "figures/ridge.png"]


def test_software_dataset_and_paper_are_named_as_they_name_themselves(described):
    found = entities(described)
    assert (found["#software"]["softwareVersion"], found["#library/numpy"]["softwareVersion"]) == ("1.2", "2.4")
    assert found["#data/raw/lab"]["license"] == "CC0" and "sheet.md" in ids(found["#data/raw/lab"], "subjectOf")
    assert found["#person/Author"]["name"] == "A. Author" and ids(found["./"], "citation") == ["#paper"]


def test_a_step_that_reads_no_configuration_says_so():
    first, *_ = steps(STAGES, {"fit"}, [])
    assert first == Step("configure", "options", "pipeline/stages/configure.py", ["params.yaml"], ["data/config.yaml"])


@pytest.mark.slow
def test_the_library_reads_back_every_file_and_every_stage_of_a_run(reproduced, tmp_path):
    reports = reproduced / "reports"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        crate = ROCrate(reports)
    read = {entity.id for entity in crate.data_entities if entity.type == "File"}
    there = {file.relative_to(reports).as_posix() for file in reports.rglob("*") if file.is_file()}
    assert read == there - {"ro-crate-metadata.json"}
    locked = {}
    for file in ("dvc.lock", "data/raw/youbot/dvc.lock"):
        locked |= OmegaConf.to_container(OmegaConf.load(reproduced / file))["stages"]
    actions = {entity["name"]: entity for entity in crate.get_by_type("CreateAction")}
    assert set(locked) <= set(actions)
    for name, stage in locked.items():
        results = {entity.id for entity in actions[name]["result"]}
        inside = (out["path"].removeprefix("reports/") for out in stage["outs"] if out["path"].startswith("reports/"))
        assert {path.rstrip("/") for path in results if not path.startswith("#")} == set(inside)
        assert (reproduced / actions[name]["instrument"]["name"]).is_file()
    captions = json.loads((reports / "figures/captions.json").read_text())
    assert all((reproduced / actions[f"figures/{name}"]["instrument"]["name"]).is_file() for name in captions)
    require_whole(json.loads((reports / "ro-crate-metadata.json").read_text()))
    beside = re.findall(r'<a href="([\w.-]+)">', (reports / "index.html").read_text())
    assert set(beside) == {"ro-crate-metadata.json", "datasheet.md"} <= there
    # the same bytes from what a run has left, the page among it, as from what there was before it
    again = Path(shutil.copytree(reproduced, tmp_path / "again", symlinks=True))
    written = (again / "reports/ro-crate-metadata.json").read_bytes()
    done = run("python", "-m", "pipeline", "crate", cwd=again)
    assert done.returncode == 0 and (again / "reports/ro-crate-metadata.json").read_bytes() == written, done.stderr
