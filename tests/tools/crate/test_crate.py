"""The crate of the results names every file, and every stage with its inputs and outputs; the card
answers its questions.
"""

from __future__ import annotations

import json
import re
import shutil
import warnings
from collections.abc import Iterator
from dataclasses import replace
from math import nan

import pandas as pd
import pytest
from omegaconf import OmegaConf
from project_copy import run
from rocrate.rocrate import ROCrate
from source_code import MODULES, ROOT, covers, needed, package

from pipeline.tools.crate.card import CardFacts, card
from pipeline.tools.crate.crate import PROFILE, describe

CITATION = {
    "title": "an experiment",
    "version": "1.2",
    "license": "MIT",
    "abstract": "About\nit.",
    "date-released": "2001-02-03",
    "authors": [{"name": "The contributors"}],
    "references": [
        {"title": "A paper", "authors": [{"given-names": "A. B.", "family-names": "Author"}]}
    ],
}
RECORDINGS = {"path": "data/raw/lab", "subject": "an arm", "source": "a lab", "licence": "CC0"}
STAGES = {
    "fit@a": {
        "cmd": "python -m pipeline fit a",
        "deps": [{"path": "data/raw/lab", "md5": "01"}, {"path": "pipeline/models"}],
        "outs": [{"path": "data/fit/a", "md5": "0f.dir"}, {"path": "reports/metrics/fit_a.json"}],
    },
    "figures": {
        "cmd": "python -m pipeline figures",
        "deps": [{"path": "data/fit/a", "md5": "0f.dir"}],
        "outs": [{"path": "reports/figures", "md5": "1e.dir"}],
    },
}
FILES = ["reports/figures/ridge.png", "reports/index.html", "reports/metrics/fit_a.json"]


def entities(crate: dict) -> dict[str, dict]:
    return {entity["@id"]: entity for entity in crate["@graph"]}


def references(value: object) -> Iterator[str]:
    if isinstance(value, dict) and set(value) == {"@id"}:
        yield value["@id"]
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from references(each)


def require_whole(crate: dict) -> None:
    """RO-Crate 1.1 and the profile: every reference is described, the root is, actions are."""
    result = entities(crate)
    named = {name for entity in result.values() for name in references(entity)}
    assert named - {*result} == {"https://w3id.org/ro/crate/1.1"}
    root = result["./"]
    assert all(root.get(key) for key in ("name", "description", "datePublished", "license"))
    assert [*references(root["conformsTo"])] == [PROFILE]
    actions = {name for name, entity in result.items() if entity["@type"] == "CreateAction"}
    assert {*references(root["mentions"])} == actions
    assert all(result[name]["result"] and result[name]["instrument"] for name in actions)
    files = {name for name, entity in result.items() if entity["@type"] == "File"}
    assert files <= {*references(root["hasPart"])}


def test_a_stage_is_an_action_from_its_inputs_to_its_outputs():
    crate = describe(CITATION, RECORDINGS, STAGES, FILES)
    require_whole(crate)
    result = entities(crate)
    fit = result["#run/fit@a"]
    assert [*references(fit["object"])] == ["#data/raw/lab", "#pipeline/models"]
    assert [*references(fit["result"])] == ["#data/fit/a", "metrics/fit_a.json"]
    assert result["#data/fit/a"]["identifier"] == "md5:0f.dir"
    assert result["figures/"]["identifier"] == "md5:1e.dir"
    assert [*references(result["figures/"]["hasPart"])] == ["figures/ridge.png"]
    assert result["figures/ridge.png"]["encodingFormat"] == "image/png"
    assert result["#data/raw/lab"]["license"] == "CC0"
    assert result["#person/A.-B.-Author"]["name"] == "A. B. Author"
    assert json.dumps(crate) == json.dumps(describe(CITATION, RECORDINGS, STAGES, FILES))
    broken = {"@graph": [entity for entity in crate["@graph"] if entity["@id"] != "#paper"]}
    with pytest.raises(AssertionError):
        require_whole(broken)


FACTS = CardFacts(
    name="lab",
    synthetic=True,
    seed=7,
    about={"subject": "An arm", "source": "a laboratory", "licence": "CC0"},
    stored={"data/raw/lab/x": (8, 1234567)},
    takes=pd.DataFrame(
        {
            "take": ["a", "b", "c"],
            "part": ["training", "training", "test"],
            "left_out": [False, True, False],
        }
    ),
    quality=pd.DataFrame(
        [["a tracker", "gaps", "count", 9.0, nan, 2.0, 4.0]],
        columns=["instrument", "quantity", "unit", "total", "mean", "least", "greatest"],
    ),
    rate=125.0,
    steps=64,
)


def test_the_card_states_the_numbers_of_its_dataset():
    text = card(FACTS)
    for part in (
        "| training | 2 |",
        "| test | 1 |",
        "64 steps at 125 per second",
        "| `data/raw/lab/x` | 8 | 1,234,567 |",
        "| a tracker | gaps | count | 9 | – | 2 | 4 |",
        "leaves out: b.",
        "from the seed 7;",
        "Licence: CC0.",
    ):
        assert part in text, part


def test_the_card_of_a_recording_says_nothing_of_the_laboratory():
    recorded = card(replace(FACTS, synthetic=False, stored={}))
    assert re.findall("^## .*", recorded, re.M) == re.findall("^## .*", card(FACTS), re.M)
    for word in ("seed", "Simulated", "truth", "pipeline/laboratory", "dvc.lock"):
        assert word not in recorded, word
    assert "a laboratory" in recorded and "data/raw/lab/dataset.yaml" in recorded


@pytest.mark.slow
def test_a_run_is_described_file_by_file_and_stage_by_stage(reproduced, tmp_path):
    folder = tmp_path / "project"
    shutil.copytree(reproduced, folder, symlinks=True)
    written = []
    for _ in range(2):
        done = run("python", "-m", "pipeline", "crate", cwd=folder)
        assert done.returncode == 0, done.stderr
        written.append((folder / "reports/ro-crate-metadata.json").read_bytes())
    assert written[0] == written[1]
    reports = folder / "reports"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        crate = ROCrate(reports)
    read = {entity.id for entity in crate.data_entities if entity.type == "File"}
    there = {file.relative_to(reports).as_posix() for file in reports.rglob("*") if file.is_file()}
    assert read == there - {"ro-crate-metadata.json"}
    locked = OmegaConf.to_container(OmegaConf.load(folder / "dvc.lock"))["stages"]
    assert {*locked, "page"} <= {entity["name"] for entity in crate.get_by_type("CreateAction")}
    require_whole(json.loads(written[0]))


@pytest.mark.parametrize(
    ("stage", "module"),
    [("studies_page", "tools.page.command"), ("crate", "tools.crate.command")],
)
def test_a_stage_depends_on_the_code_that_it_runs(stage, module):
    file = ROOT / "pipeline/tools/crate/dvc.yaml"
    deps = OmegaConf.to_container(OmegaConf.load(file))["stages"][stage]["deps"]
    core = {name for name in MODULES if package(name) == "core"}
    modules = [MODULES[name] for name in needed(f"pipeline.{module}", core)]
    files = [file.relative_to(ROOT).as_posix() for file in modules if file.stat().st_size]
    files.remove("pipeline/__init__.py")
    assert [file for file in files if not any(covers(dep, file) for dep in deps)] == []
