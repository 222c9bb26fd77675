"""The configuration: every option composes, and every mistake is refused by name."""

from __future__ import annotations

from pathlib import Path

import pytest
from omegaconf import OmegaConf
from params_file import CHOICES, parameters

from pipeline.core import config
from pipeline.core.errors import ConfigError


def nested(values: dict, path: str = ""):
    """Every section of nested values: its path and the section."""
    yield path, values
    for key, value in values.items():
        if isinstance(value, dict):
            yield from nested(value, f"{path}.{key}" if path else key)


def inside(path: str, value: str) -> str:
    """``{a: {b: value}}`` for the path a.b."""
    for key in reversed(path.split(".")):
        value = f"{{{key}: {value}}}"
    return value


@pytest.mark.parametrize(
    "number", range(max(len(config.options(group)) for group in config.GROUPS))
)
def test_every_option_composes(compose, number):
    # as many at a time as there are groups: the first of each, the second of each, …
    chosen = {
        group: config.options(group)[number % len(config.options(group))] for group in config.GROUPS
    }
    composed = OmegaConf.to_container(compose(**chosen), throw_on_missing=True)
    for group, option in chosen.items():
        said = OmegaConf.to_container(OmegaConf.load(config.CONF / group / f"{option}.yaml"))
        said.pop("defaults", None)
        # what the option says stands in the configuration, whatever else it holds by default
        for path, section in nested(said):
            node = composed[group]
            for key in filter(None, path.split(".")):
                node = node[key]
            for key, value in section.items():
                assert isinstance(value, dict) or "${" in str(value) or node[key] == value


@pytest.mark.parametrize("model", config.options("model"))
def test_every_model_composes_alone(compose, model):
    assert list(compose(models=f"[{model}]").models) == [model]


def test_models_keep_their_order(compose):
    assert list(compose(models="[wishart, additive]").models) == ["wishart", "additive"]


def test_every_group_of_options_is_one_that_params_yaml_chooses_from():
    groups = {folder.name for folder in config.CONF.iterdir() if folder.is_dir()}
    assert groups == {*config.GROUPS, "model"}


def test_the_projects_own_parameters_compose():
    chosen = OmegaConf.load("params.yaml")
    assert set(chosen) == set(CHOICES)
    assert config.compose_config(Path("params.yaml")).seed == chosen.seed


@pytest.mark.parametrize("group", config.GROUPS)
@pytest.mark.parametrize("option", ["nonsense", "null", "[paper]"])
def test_an_unknown_option_lists_those_there_are(compose, group, option):
    with pytest.raises(ConfigError) as refused:
        compose(**{group: option})
    assert ", ".join(config.options(group)) in str(refused.value)
    assert refused.value.evidence["key"] == group


@pytest.mark.parametrize(
    "models", ["[]", "additive", "{additive: 1}", "null", "[additive, additive]"]
)
def test_models_that_are_no_list_of_different_options_are_refused(compose, models):
    with pytest.raises(ConfigError, match="model"):
        compose(models=models)


def test_an_unknown_model_lists_those_there_are(compose):
    with pytest.raises(ConfigError, match=f"there are {', '.join(config.options('model'))}"):
        compose(models="[additive, laplace]")


@pytest.mark.parametrize("key", sorted(set(CHOICES) - {"overrides"}))
def test_a_missing_parameter_is_named(compose, key):
    with pytest.raises(ConfigError, match=f"no value for {key}"):
        compose(**{key: None})


def test_an_unknown_parameter_lists_those_there_are(compose):
    with pytest.raises(
        ConfigError, match=r"unknown key\(s\) sede; known are articulation, .*, wrench"
    ):
        compose(sede="1")


SECTIONS = [
    "",
    "dataset",
    "dataset.mocap.base",
    "dataset.force.configurations.C1",
    "dataset.laboratory",
    "dataset.laboratory.kinect.scene",
    "models.wishart",
    "filter",
]


@pytest.mark.parametrize("section", SECTIONS)
def test_an_unknown_key_is_refused_at_every_depth_with_those_there_are(compose, section):
    path = f"{section}.nonsense".strip(".")
    with pytest.raises(ConfigError, match=r"'nonsense'.*; there are \w+") as refused:
        compose(overrides=inside(path, "1"))
    assert refused.value.evidence["key"] == path


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("filter.particles", "many"),
        ("filter.particles", "1.5"),
        ("filter.scheme", "null"),
        ("filter", "3"),
        ("dataset.motion", "null"),
        ("dataset.robot.joints", "3"),
        ("dataset.mocap.markers", "{link1: {a: [x]}}"),
        ("dataset.laboratory", "3"),
        ("dataset.laboratory.dynamics", "3"),
        ("dataset.laboratory.dynamics.clearance", "wide"),
        ("dataset.laboratory.mocap", "{noise_std: -1.0}"),
        ("models", "null"),
        ("models.wishart", "null"),
        ("models.wishart.kind", "laplace"),
        ("models.wishart.floor", "low"),
        ("seed", "-1"),
        ("models.wishart.estimator", "bayes"),
        ("models.wishart.floor", "null"),
        ("models.gaussian.beta", "null"),
        ("models.wishart.left", "[[1.0]]"),
        ("models.wishart.decomposition", "given"),
    ],
)
def test_a_value_of_the_wrong_type_or_range_is_refused(compose, path, value):
    with pytest.raises(ConfigError) as refused:
        compose(overrides=inside(path, value))
    assert "\n" not in str(refused.value)
    assert path.split(".")[-1] in str(refused.value).lower()


def test_an_unknown_structure_of_the_scaled_noise_lists_those_there_are(compose):
    with pytest.raises(ConfigError, match="there are diagonal, full"):
        compose(models="[scaled]", overrides="{models: {scaled: {structure: banded}}}")


@pytest.mark.parametrize(
    "text",
    ["- a\n", "seed: [\n", "seed: 1\nseed: 2\n", "\xff", "seed: ${nowhere}\n", "seed: ???\n"],
)
def test_a_file_that_is_not_keys_and_values_is_refused_in_one_line(tmp_path, text):
    file = tmp_path / "params.yaml"
    file.write_bytes(text.encode("latin-1"))
    with pytest.raises(ConfigError) as refused:
        config.compose_config(file)
    assert refused.value.evidence["file"] == file
    assert "\n" not in str(refused.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="project's root"):
        config.compose_config(tmp_path / "params.yaml")


def test_comments_leave_the_composed_configuration_as_it_is_and_a_value_does_not(tmp_path):
    texts = []
    for comment, seed in (("", "2017"), ("# why", "2017"), ("# why", "2018")):
        config.write_config(parameters(tmp_path, comment, seed=seed), tmp_path / "config.yaml")
        texts.append((tmp_path / "config.yaml").read_bytes())
    assert texts[0] == texts[1]
    assert texts[1] != texts[2]
    assert not list(tmp_path.glob("*.partial"))


def test_a_refusal_leaves_the_written_configuration_as_it_was(tmp_path):
    config.write_config(parameters(tmp_path), tmp_path / "config.yaml")
    before = (tmp_path / "config.yaml").read_bytes()
    with pytest.raises(ConfigError):
        config.write_config(parameters(tmp_path, filter="nonsense"), tmp_path / "config.yaml")
    assert (tmp_path / "config.yaml").read_bytes() == before


@pytest.mark.parametrize("dataset", ["youbot", "ur5", "lwr4"])
def test_a_decomposition_named_by_a_dataset_is_refused_with_its_replacement(compose, dataset):
    with pytest.raises(ConfigError, match=r"pipeline/conf/model/wishart\.yaml") as refused:
        compose(
            dataset=dataset, overrides="{dataset: {elimination: {decomposition: qr_transposed}}}"
        )
    assert refused.value.evidence["key"] == "dataset.elimination"
    # control: the model's file has it
    override = "{models: {wishart: {decomposition: qr_transposed}}}"
    assert compose(overrides=override).models.wishart.decomposition == "qr_transposed"
