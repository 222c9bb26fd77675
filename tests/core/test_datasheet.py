"""A dataset's datasheet and its option file: put together, held against each other, and named where
they are wrong.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml
from made_options import parameters

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


def test_values_of_both_files_stand_in_the_configuration(sheet, tmp_path):
    edit(sheet, "depth.clock_offset", 0.125)
    composed = config.compose_config(parameters(tmp_path)).dataset
    assert (composed.depth.clock_offset, composed.depth.search) == (0.125, 0.4)
    assert composed.depth.takes == "kinect/test_*" and not hasattr(composed, "about")


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        *(
            (key, value, f"dataset.{key} stands in youbot.yaml too: keep one of them")
            for key, value in (("mocap.gate", 0.1), ("name", "a"), ("depth.workspace", None))
        ),
        ("mocap.base.position", ["???", 0.0, 0.0], "fill in mocap.base.position[0]: there is ???"),
        ("mocap.markers.link2.link2_a", "???", "fill in mocap.markers.link2.link2_a: there is ???"),
        ("about.licence", "???", "fill in about.licence: "),
        ("about", None, "needs about"),
        ("about.page", "1", "'page'"),
        ("depth.clock_offset", "early", "clock_offset"),
        ("mocap.markrs", {}, "did you mean markers"),
    ],
)
def test_a_wrong_value_or_key_is_named_with_the_datasheet(sheet, tmp_path, key, value, words):
    edit(sheet, key, value)
    refused = refusal(tmp_path)
    assert words in refused.message
    assert refused.evidence["file"] == sheet and key.split(".")[0] in refused.evidence["key"]


def test_every_dataset_has_a_datasheet_with_nothing_to_fill_in():
    for dataset in config.option_names("dataset"):
        assert not datasheet.is_open(config.read_yaml(datasheet.path_of(dataset)))
