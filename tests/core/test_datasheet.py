"""A dataset's datasheet and its option file: put together, held against each other, and named where
they are wrong.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml
from params_file import parameters

from pipeline.core import config, datasheet
from pipeline.core.errors import ConfigError


@pytest.fixture
def sheet(tmp_path, monkeypatch) -> Path:
    """The datasheet of youbot, to edit."""
    original = datasheet.path_of("youbot")
    monkeypatch.setattr(datasheet, "DATASHEETS", tmp_path / "raw")
    file = datasheet.path_of("youbot")
    file.parent.mkdir(parents=True)
    shutil.copy(original, file)
    return file


def edit(file: Path, key: str, value: object) -> None:
    values = yaml.safe_load(file.read_text())
    *above, last = key.split(".")
    node = values
    for part in above:
        node = node.setdefault(part, {})
    node[last] = value
    file.write_text(yaml.safe_dump(values))


def refusal(tmp_path: Path, **choices: str) -> ConfigError:
    with pytest.raises(ConfigError) as refused:
        config.compose_config(parameters(tmp_path, **choices))
    assert "\n" not in str(refused.value)
    return refused.value


def test_what_either_says_stands_in_the_configuration(sheet, tmp_path):
    edit(sheet, "depth.clock_offset", 0.125)
    composed = config.compose_config(parameters(tmp_path)).dataset
    assert (composed.depth.clock_offset, composed.depth.takes, composed.depth.search) == (
        0.125,
        "kinect/test_*",
        0.4,
    )
    assert not hasattr(composed, "about")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("mocap.gate", 0.1),
        ("name", "youbot"),
        ("depth.workspace.floor", 0.0),
        ("depth.workspace", None),
    ],
)
def test_a_key_in_both_places_is_refused(sheet, tmp_path, key, value):
    edit(sheet, key, value)
    refused = refusal(tmp_path)
    assert refused.message == f"dataset.{key} stands in youbot.yaml too: keep one of them"
    assert refused.evidence == {"key": f"dataset.{key}", "file": sheet}


def test_every_key_that_is_left_to_fill_in_is_named_with_its_file(sheet, tmp_path):
    edit(sheet, "mocap.markers.link2.link2_a", "???")
    edit(sheet, "mocap.base.position", ["???", 0.0, 0.0])
    refused = refusal(tmp_path)
    assert (
        refused.message
        == "fill in mocap.base.position[0], mocap.markers.link2.link2_a: there is ??? for a value"
    )
    assert refused.evidence["file"] == sheet


def test_a_value_to_fill_in_of_the_option_file_is_named_with_that(sheet, tmp_path, monkeypatch):
    shutil.copytree(config.CONF, tmp_path / "conf")
    monkeypatch.setattr(config, "CONF", tmp_path / "conf")
    edit(config.CONF / "dataset/youbot.yaml", "mocap.gate", "???")
    refused = refusal(tmp_path)
    assert (refused.evidence["key"], refused.evidence["file"]) == (
        "mocap.gate",
        config.CONF / "dataset/youbot.yaml",
    )


def test_an_override_fills_in_what_is_left_open(sheet, tmp_path):
    edit(sheet, "force.tare", "???")
    assert (
        config.compose_config(
            parameters(tmp_path, overrides="{dataset: {force: {tare: 4.0}}}")
        ).dataset.force.tare
        == 4.0
    )


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("depth.width", "wide"),
        ("mocap.unit", "yd"),
        ("depth.clock_offset", "early"),
        ("force.log.max_faulty", "few"),
        ("mocap.markrs", {}),
    ],
)
def test_a_wrong_value_or_key_is_named_with_the_datasheet(sheet, tmp_path, key, value):
    edit(sheet, key, value)
    refused = refusal(tmp_path)
    assert refused.evidence["file"] == sheet
    assert refused.evidence["key"].startswith("dataset.") and key.rpartition(".")[2].split("_")[
        0
    ] in str(refused)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("about", None, "needs about"),
        ("about.licence", "???", "fill in about.licence: "),
        ("about.page", "1", "'page'"),
    ],
)
def test_a_datasheet_says_what_whence_and_on_which_terms(sheet, tmp_path, key, value, said):
    edit(sheet, key, value)
    refused = refusal(tmp_path)
    assert said in refused.message and refused.evidence["file"] == sheet


def test_a_dataset_without_a_datasheet_is_refused(sheet, tmp_path):
    sheet.unlink()
    assert refusal(tmp_path).evidence["file"] == sheet


@pytest.mark.parametrize("text", ["- a\n", "a: [\n", "a: 1\na: 2\n"])
def test_a_datasheet_that_is_not_keys_and_values_is_refused(sheet, tmp_path, text):
    sheet.write_text(text)
    assert refusal(tmp_path).evidence["file"] == sheet


def test_every_dataset_has_a_datasheet_with_nothing_to_fill_in():
    for dataset in config.option_names("dataset"):
        assert datasheet.unfilled(datasheet.path_of(dataset)) == []


def test_the_example_explains_every_key():
    lines = datasheet.path_of("youbot").read_text().splitlines()
    bare = [line for line in lines if ":" in line and "#" not in line]
    # what stands without a word of its own is explained by the line of its section
    assert [line.strip().partition(":")[0] for line in bare] == [
        "subject",
        "source",
        "licence",
        "link1",
        "link2",
        "link3",
        "C1",
        "C2",
        "C3",
    ]
