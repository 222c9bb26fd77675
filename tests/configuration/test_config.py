"""The configuration: every option composes, every mistake is refused by key with what is allowed,
all mistakes at once; a stage gets the sections that it declares, as typed objects, and no more.
"""

import shutil
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import yaml
from case_tables import cases_beside
from sample_options import parameters

from pipeline.configuration import config, datasheet
from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Compute, Filter
from pipeline.core.options.dataset import Robot
from pipeline.core.validation import options, validated
from pipeline.laboratory.causes import dynamics_type
from pipeline.laboratory.options import SECTIONS
from pipeline.models.kinds import kinds, options_type

cases = cases_beside(__file__)
NAMES = {group: config.option_names(group) for group in config.GROUPS}
MODELS = config.option_names("model")


@pytest.fixture
def compose(tmp_path, monkeypatch):
    """Composes params.yaml with some of its lines changed."""
    monkeypatch.chdir(tmp_path)
    return lambda **choices: config.compose_config(parameters(tmp_path, **choices))


@pytest.mark.parametrize("number", range(max(map(len, NAMES.values()))))
def test_every_option_composes(compose, number):
    # as many at a time as there are groups: the first of each, the second of each, …
    chosen = {}
    for group, names in NAMES.items():
        chosen[group] = names[number % len(names)]
    model = MODELS[number % len(MODELS)]

    composed = compose(**chosen, models=f"[{model}]")

    assert composed.dataset.name == chosen["dataset"]
    assert composed.scale.name == chosen["scale"]
    assert list(composed.models) == [model]


@cases("wrong lines")
def test_a_wrong_line_of_params_yaml_is_refused_in_one_line(compose, choices, words):
    with pytest.raises(ConfigError, match=words) as refused:
        compose(**choices)
    assert "\n" not in str(refused.value) and "params.yaml" in str(refused.value)
    assert refused.value.evidence["key"] == next(iter(choices))


@cases("wrong overrides")
def test_a_wrong_value_is_refused_with_its_key(compose, path, value, words):
    nested = value
    for part in reversed(path.split(".")):
        nested = f"{{{part}: {nested}}}"
    with pytest.raises(ConfigError, match=words) as refused:
        compose(overrides=nested)

    key = str(refused.value.evidence["key"])
    section = path.split(".")[0]
    assert key.startswith(section) or key == "overrides.models"
    # a part that the null leaves alone is named in the file that states it
    names = ("params.yaml", "dataset.yaml", "youbot.yaml")
    assert refused.value.evidence["file"].name in names


@cases("wrong option files")
def test_a_wrong_value_of_an_option_file_is_refused_with_the_file(
    compose,
    tmp_path,
    monkeypatch,
    file,
    old,
    new,
    key,
):
    folder = shutil.copytree(config.CONF, tmp_path / "conf")
    monkeypatch.setattr(config, "CONF", folder)
    text = (folder / file).read_text()
    assert old in text

    (folder / file).write_text(text.replace(old, new))
    with pytest.raises(ConfigError) as refused:
        compose()
    assert refused.value.evidence == {"file": folder / file, "key": key}


def test_all_faults_are_in_one_message(compose):
    with pytest.raises(ConfigError, match="2 faults") as refused:
        compose(overrides="{filter: {particles: 0}, wrench: {grd: 3}}")

    message = str(refused.value)
    assert "filter.particles: " in message and "did you mean grid" in message
    with pytest.raises(ConfigError, match=r"filter\.9: keys should be strings, got 9"):
        validated(Filter, {9: 4}, "filter")


def test_an_override_changes_its_value_and_nothing_else(compose):
    laboratory = (
        "{laboratory: {kinect: {scene: {tool_width: 0.07}}}, mocap: {gate: 1e-3}}"
    )
    before = compose()
    after = compose(overrides=f"{{dataset: {laboratory}, filter: {{particles: 7}}}}")
    assert after.dataset.laboratory["kinect"].scene.tool_width == 0.07
    assert (after.dataset.mocap.gate, after.filter.particles) == (0.001, 7)
    assert (after.models, after.wrench) == (before.models, before.wrench)
    assert compose(overrides=None) == before

    two = compose(models="[wishart, additive]").models  # in the order of params.yaml
    assert list(two) == ["wishart", "additive"]
    # a scale reaches the options that refer to it
    assert compose(overrides="{scale: {particles: 77}}").filter.particles == 77


def test_comments_leave_the_written_configuration_as_it_is_and_a_refusal_too(tmp_path):
    file = tmp_path / "config.yaml"
    texts = []
    for comment, seed in (("", "2017"), ("# why", "2017"), ("# why", "2018")):
        config.write_config(parameters(tmp_path, comment, seed=seed), file)
        texts.append(file.read_bytes())

    assert texts[0] == texts[1] != texts[2]
    with pytest.raises(ConfigError):
        config.write_config(parameters(tmp_path, filter="nonsense"), file)
    assert file.read_bytes() == texts[2] and not list(tmp_path.glob("*.partial"))


@cache
def written(**choices: str) -> bytes:
    """The composed configuration as the stage configure writes it."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "config.yaml"
        config.write_config(parameters(Path(folder), **choices), file)
        return file.read_bytes()


@pytest.fixture
def sections(tmp_path, monkeypatch):
    """Sections of the composed configuration that a stage gets which declares those given."""
    monkeypatch.chdir(tmp_path)
    config.COMPOSED.parent.mkdir()

    def declared(*names: str, item: str | None = None, **choices: str):
        config.COMPOSED.write_bytes(written(**choices))
        stage = {"cmd": "true", "params": [{str(config.COMPOSED): list(names)}]}
        Path("dvc.yaml").write_text(yaml.safe_dump({"stages": {"stage": stage}}))
        return config.sections("stage", item=item)

    return declared


def test_a_stage_gets_the_sections_that_it_declares_and_no_others(sections):
    settings = sections("seed", "dataset.robot", "filter", "scale.particles")
    assert settings.seed == 2017 and settings.scale.particles > 0

    typed = (settings.dataset.robot, settings.filter, settings.compute)
    assert [type(value) for value in typed] == [Robot, Filter, Compute]
    assert vars(settings).keys() == {"compute", "seed", "dataset", "filter", "scale"}
    assert vars(settings.dataset).keys() == {"robot"}
    assert vars(settings.scale).keys() == {"particles"}

    # an instrument that the dataset lacks is None
    names = [
        "mocap",
        "depth",
        "force",
        "joint_log",
        "encoders",
        "laboratory",
        "trajectory",
    ]
    lacking = ", ".join(f"{name}: null" for name in names)
    declared = (f"dataset.{name}" for name in names)
    dataset = sections(*declared, overrides=f"{{dataset: {{{lacking}}}}}").dataset
    assert vars(dataset) == dict.fromkeys(names)


def test_a_null_in_the_option_file_leaves_a_section_of_the_datasheet_out(sections):
    shared = sections("dataset.force", "dataset.mocap").dataset
    alone = sections("dataset.force", "dataset.mocap", dataset="youbot_sway").dataset

    assert shared.force is not None and alone.force is None
    assert alone.mocap == shared.mocap


def test_a_study_of_motion_is_refused_without_a_robot_and_the_papers_stage_is_not(
    sections,
    monkeypatch,
    tmp_path,
):
    assert sections("dataset.robot", dataset="towing").dataset.robot is None

    study = tmp_path / "pipeline/study/dvc.yaml"
    study.parent.mkdir(parents=True)
    study.write_bytes(Path("dvc.yaml").read_bytes())
    assert config.sections("stage", study).dataset.robot is None
    monkeypatch.setattr(config, "CONF", tmp_path / "pipeline/conf")
    with pytest.raises(ConfigError, match="needs a robot, and the dataset has none"):
        config.sections("stage", study)


def test_models_and_the_laboratory_have_their_own_types(sections):
    models = sections("models", models=f"[{', '.join(MODELS)}]").models
    for model in models.values():
        assert type(model) is options_type(model.kind)
    assert {model.kind for model in models.values()} == {*kinds()}
    alone = sections("models.${item.model}", item="wishart").models
    assert vars(alone) == {"wishart": models["wishart"]}

    laboratory = sections("dataset.laboratory").dataset.laboratory
    # the youBot's controller logs nothing
    types = {part: type(value) for part, value in laboratory.items()}
    cause = laboratory["cause"]
    dynamics = types.pop("dynamics")

    assert types.pop("cause") is str and dynamics is dynamics_type(cause)
    assert types | {"encoders": SECTIONS["encoders"]} == SECTIONS
    for item in ("student", None):
        with pytest.raises(ConfigError, match=f"there is no models.{item}"):
            sections("models.${item.model}", item=item)
    assert vars(sections("dataset.${item.part}", item="depth").dataset).keys() == {
        "depth",
    }


def test_a_stage_that_there_is_not_and_a_stale_configuration_are_refused(sections):
    sections("seed")
    with pytest.raises(ConfigError, match="no stage 'nonsense'; there are stage"):
        config.sections("nonsense")

    config.COMPOSED.write_text(
        config.COMPOSED.read_text().replace("particles:", "swarm:"),
    )
    with pytest.raises(ConfigError, match="'swarm'"):
        config.sections("stage")


@options()
class StudyOptions:
    """Options of a study of these tests."""

    takes: int
    estimators: list[str]


def test_a_study_gets_its_options_for_the_scale_of_the_run(sections, tmp_path):
    (tmp_path / "params.yaml").write_text(STUDY)
    for scale, expected in (("paper", (20, ["a", "b"])), ("smoke", (3, ["a"]))):
        sections("seed", scale=scale)
        assert config.study_options(tmp_path, StudyOptions) == StudyOptions(*expected)


STUDY = "paper: {takes: 20, estimators: [a, b]}\nsmoke: {takes: 3, estimators: [a]}\n"


@cases("wrong study options")
def test_wrong_options_of_a_study_are_refused(sections, tmp_path, old, new, words):
    sections("seed", scale="smoke")
    file = tmp_path / "params.yaml"
    file.write_text(STUDY.replace(old, new))

    with pytest.raises(ConfigError, match=words) as refused:
        config.study_options(tmp_path, StudyOptions)
    assert refused.value.evidence["file"] == file


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


def test_values_of_both_files_are_in_the_configuration(sheet, compose):
    edit(sheet, "depth.clock_offset", 0.125)
    composed = compose().dataset

    assert (composed.depth.clock_offset, composed.depth.search) == (0.125, 0.4)
    assert composed.depth.takes == "kinect/test_*" and not hasattr(composed, "about")


@cases("wrong datasheets")
def test_a_wrong_value_or_key_is_named_with_the_datasheet(
    sheet,
    compose,
    key,
    value,
    words,
):
    edit(sheet, key, value)
    with pytest.raises(ConfigError) as refused:
        compose()

    error = refused.value
    assert words in error.message and "\n" not in str(error)
    assert error.evidence["file"] == sheet
    assert key.split(".")[0] in error.evidence["key"]


def test_a_variable_of_the_environment_in_an_override_is_refused_with_its_key(compose):
    with pytest.raises(ConfigError, match="variable of the environment") as refused:
        compose(overrides='{filter: {particles: "${oc.env:HOME}"}}')
    assert refused.value.evidence["key"] == "filter.particles"

    # an interpolation of another option stays possible
    composed = compose(overrides='{filter: {particles: "${seed}"}}')
    assert composed.filter.particles == composed.seed


def test_every_dataset_has_a_datasheet_with_nothing_to_fill_in():
    for dataset in config.option_names("dataset"):
        assert not datasheet.is_open(config.read_yaml(datasheet.path_of(dataset)))
