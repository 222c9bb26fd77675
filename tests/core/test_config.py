"""The configuration: every option composes, every mistake is refused by key with what is allowed,
all mistakes at once.
"""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from params_file import CHOICES, parameters

from pipeline.core import config
from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Compute
from pipeline.core.options.dataset import Robot


def inside(path: str, value: str) -> str:
    """``{a: {b: value}}`` for the path a.b."""
    for key in reversed(path.split(".")):
        value = f"{{{key}: {value}}}"
    return value


@pytest.mark.parametrize(
    "number", range(max(len(config.option_names(group)) for group in config.GROUPS))
)
def test_every_option_composes(compose, number):
    # as many at a time as there are groups: the first of each, the second of each, …
    names = {group: config.option_names(group) for group in config.GROUPS}
    chosen = {group: options[number % len(options)] for group, options in names.items()}
    composed = compose(**chosen)
    assert composed.dataset.name == chosen["dataset"] and composed.scale.name == chosen["scale"]


@pytest.mark.parametrize("model", config.option_names("model"))
def test_every_model_composes_alone(compose, model):
    assert list(compose(models=f"[{model}]").models) == [model]


def test_models_keep_their_order_and_groups_are_those_of_params_yaml(compose):
    assert list(compose(models="[wishart, additive]").models) == ["wishart", "additive"]
    groups = {folder.name for folder in config.CONF.iterdir() if folder.is_dir()}
    assert groups == {*config.GROUPS, "model"}
    chosen = yaml.safe_load(Path(__file__).parents[2].joinpath("params.yaml").read_text())
    assert set(chosen) == set(CHOICES)


@pytest.mark.parametrize("group", config.GROUPS)
def test_an_unknown_option_lists_those_there_are(compose, group):
    with pytest.raises(ConfigError) as refused:
        compose(**{group: "nonsense"})
    assert ", ".join(config.option_names(group)) in str(refused.value)
    assert refused.value.evidence["key"] == group
    assert refused.value.evidence["file"].name == "params.yaml"


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"models": "[]"}, "models: list should have at least 1 item"),
        ({"models": "additive"}, "models: input should be a valid list, got 'additive'"),
        ({"models": "[additive, additive]"}, "additive stands twice"),
        ({"models": "[additive, laplace]"}, "no option 'laplace'; there are additive"),
        ({"seed": "abc"}, "seed: input should be a valid integer.*got 'abc'"),
        ({"seed": "-1"}, "seed: .*greater than or equal to 0, got -1"),
        ({"seed": None}, "no value for seed"),
        ({"sede": "1"}, "unknown key 'sede'; there are dataset, .*; did you mean seed"),
        ({"overrides": "3"}, "overrides: must hold keys and values"),
    ],
)
def test_a_wrong_line_of_params_yaml_is_refused_in_one_line(compose, choices, words):
    with pytest.raises(ConfigError, match=words) as refused:
        compose(**choices)
    assert "\n" not in str(refused.value) and "params.yaml" in str(refused.value)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("filter.partcles", "5", "unknown key 'partcles'; .*; did you mean particles"),
        ("filter.particles", "0", "greater than or equal to 1, got 0"),
        ("filter.particles", "1.5", "valid integer"),
        ("filter.scheme", "systemtic", "'systematic', .* did you mean systematic"),
        ("filter", "3", "must hold keys and values"),
        ("dataset.motion", "null", "without a robot and its motion"),
        ("dataset.robot.joints", "3", "valid list"),
        ("dataset.robot.task", "[x, phi]", "by commanded x and z; keep both rows"),
        ("dataset.mocap.markers", "{link1: {a: [x, 0, 0]}}", "valid number.*got 'x'"),
        ("dataset.mocap.nonsense", "1", "unknown key 'nonsense'; there are training, test"),
        ("dataset.force.configurations.C9", "{file: C9.csv}", "no value for dataset.force"),
        ("dataset.laboratory", "3", "must hold keys and values"),
        ("dataset.laboratory.nonsense", "3", "unknown key 'nonsense'; there are trajectory"),
        ("dataset.laboratory.dynamics.clearance", "wide", "valid number"),
        ("dataset.laboratory.mocap", "{noise_std: -1.0}", "noise_std.*greater than or equal to 0"),
        ("models.wishart", "{kind: laplace}", "no kind 'laplace'; there are additive"),
        ("models.wishart.estimator", "bayes", "should be"),
        ("models.wishart.left", "[[1.0]]", "given"),
        ("models.scaled", "{kind: scaled, structure: full}", "no model scaled is chosen"),
    ],
)
def test_a_wrong_value_is_refused_with_its_key(compose, path, value, words):
    with pytest.raises(ConfigError, match=words) as refused:
        compose(overrides=inside(path, value))
    key = str(refused.value.evidence["key"])
    assert key.startswith(path.rpartition(".")[0].partition(".")[0]) or key == "overrides.models"
    assert refused.value.evidence["file"].name in ("params.yaml", "dataset.yaml")


def test_all_faults_are_said_at_once(compose):
    with pytest.raises(ConfigError, match="2 faults") as refused:
        compose(overrides="{filter: {particles: 0}, wrench: {grd: 3}}")
    assert "filter.particles: " in str(refused.value) and "did you mean grid" in str(refused.value)


def test_an_override_changes_its_value_and_nothing_else(compose):
    laboratory = "{laboratory: {kinect: {scene: {tool_width: 0.07}}}, mocap: {gate: 1e-3}}"
    before = compose()
    after = compose(overrides=f"{{dataset: {laboratory}, filter: {{particles: 7}}}}")
    assert after.dataset.laboratory["kinect"].scene.tool_width == 0.07
    assert (after.dataset.mocap.gate, after.filter.particles) == (0.001, 7)
    assert (after.models, after.wrench) == (before.models, before.wrench)
    assert compose(overrides=None) == before


def test_a_scale_reaches_the_options_that_refer_to_it(compose):
    composed = compose(overrides="{scale: {particles: 77, realizations: 33}}")
    assert (composed.filter.particles, composed.simulation.realizations) == (77, 33)


@pytest.mark.parametrize(
    "text",
    ["- a\n", "seed: [\n", "seed: 1\nseed: 2\n", "\xff", "seed: ???\n"],
)
def test_a_file_that_is_not_keys_and_values_is_refused_with_its_name(tmp_path, text):
    file = tmp_path / "params.yaml"
    file.write_bytes(text.encode("latin-1"))
    with pytest.raises(ConfigError) as refused:
        config.compose_config(file)
    assert refused.value.evidence["file"] == file


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="project's root"):
        config.compose_config(tmp_path / "params.yaml")


def test_comments_leave_the_written_configuration_as_it_is_and_a_refusal_too(tmp_path):
    file, texts = tmp_path / "config.yaml", []
    for comment, seed in (("", "2017"), ("# why", "2017"), ("# why", "2018")):
        config.write_config(parameters(tmp_path, comment, seed=seed), file)
        texts.append(file.read_bytes())
    assert texts[0] == texts[1] != texts[2]
    with pytest.raises(ConfigError):
        config.write_config(parameters(tmp_path, filter="nonsense"), file)
    assert file.read_bytes() == texts[2] and not list(tmp_path.glob("*.partial"))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Robot("a.urdf", ["a", "a"], task=["x"]), "each joint once"),
        (lambda: Robot("a.urdf", ["a"], task=["x", "z"]), "2 rows are more than 1 joints"),
        (lambda: Robot("a.urdf", ["a"], task=["x"], lenght=2.0), "did you mean length"),
        (lambda: Compute(-1), "workers"),
        (lambda: Compute(dask={"timeout": float("nan")}), "timeout"),
    ],
)
def test_an_object_made_in_code_is_checked_like_a_file(make, words):
    with pytest.raises(ConfigError, match=words):
        make()


@pytest.mark.parametrize("dataset", ["youbot", "ur5", "lwr4"])
def test_a_decomposition_named_by_a_dataset_is_refused_with_its_replacement(compose, dataset):
    with pytest.raises(ConfigError, match=r"pipeline/conf/model/wishart\.yaml") as refused:
        compose(
            dataset=dataset, overrides="{dataset: {elimination: {decomposition: qr_transposed}}}"
        )
    assert refused.value.evidence["key"] == "dataset.elimination"
    # control: the model's file has it
    override = "{models: {wishart: {decomposition: qr_transposed}}}"
    assert compose(overrides=override).models["wishart"].decomposition == "qr_transposed"
