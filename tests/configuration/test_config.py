"""The configuration: every option composes, every mistake is refused by key with what is allowed,
all mistakes at once; a stage gets the sections that it declares, as typed objects, and no more.
"""

import shutil
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import yaml
from sample_options import parameters

from pipeline.configuration import config, datasheet
from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Compute, Filter
from pipeline.core.options.dataset import Robot
from pipeline.core.validation import options, validated
from pipeline.laboratory.causes import dynamics_type
from pipeline.laboratory.options import SECTIONS
from pipeline.models.kinds import kinds, options_type

PARTS = "robot motion trajectory mocap depth force laboratory".split()
NOTHING = "{" + ", ".join(f"{part}: null" for part in PARTS) + "}"


@pytest.fixture
def compose(tmp_path, monkeypatch):
    """Composes params.yaml with some of its lines changed."""
    monkeypatch.chdir(tmp_path)
    return lambda **choices: config.compose_config(parameters(tmp_path, **choices))


@pytest.mark.parametrize(
    "number",
    range(max(len(config.option_names(group)) for group in config.GROUPS)),
)
def test_every_option_composes(compose, number):
    # as many at a time as there are groups: the first of each, the second of each, …
    names = {group: config.option_names(group) for group in config.GROUPS}
    models = config.option_names("model")
    chosen = {group: options[number % len(options)] for group, options in names.items()}
    composed = compose(**chosen, models=f"[{models[number % len(models)]}]")
    assert (
        composed.dataset.name == chosen["dataset"]
        and composed.scale.name == chosen["scale"]
    )
    assert list(composed.models) == [models[number % len(models)]]


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"filter": "nonsense"}, ", ".join(config.option_names("filter"))),
        ({"models": "[]"}, "models: list should have at least 1 item"),
        ({"models": "[additive, additive]"}, "additive occurs twice"),
        ({"models": "[additive, laplace]"}, "no option 'laplace'; there are additive"),
        ({"seed": "abc"}, "seed: input should be a valid integer.*got 'abc'"),
        ({"seed": None}, "no value for seed"),
        ({"seed": "???"}, "seed"),
        ({"sede": "1"}, "unknown key 'sede'; there are dataset, .*; did you mean seed"),
        ({"overrides": "3"}, "overrides: must contain keys and values"),
    ],
)
def test_a_wrong_line_of_params_yaml_is_refused_in_one_line(compose, choices, words):
    with pytest.raises(ConfigError, match=words) as refused:
        compose(**choices)
    assert "\n" not in str(refused.value) and "params.yaml" in str(refused.value)
    assert refused.value.evidence["key"] == next(iter(choices))


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("filter.partcles", "5", "unknown key 'partcles'; .*; did you mean particles"),
        ("filter.particles", "0", "greater than or equal to 1, got 0"),
        ("filter.particles", "1000000000000", "less than or equal to 10000000"),
        (
            "dataset.recordings",
            "../../../etc",
            "in the project, beside it .* or an absolute path",
        ),
        ("dataset.recordings", "data/../../etc", "in the project, beside it"),
        ("filter.scheme", "systemtic", "'systematic', .* did you mean systematic"),
        ("dataset.motion", "null", "requires a robot and its motion"),
        ("dataset", NOTHING, "a dataset needs a robot or a force transducer"),
        ("dataset.robot.task", "[x, phi]", "by commanded x and z; keep both rows"),
        ("dataset.mocap.markers", "{link1: {a: [x, 0, 0]}}", "valid number.*got 'x'"),
        (
            "dataset.force.configurations.C9",
            "{file: C9.csv}",
            "no value for dataset.force",
        ),
        (
            "dataset.laboratory.nonsense",
            "3",
            "unknown key 'nonsense'; there are cause, trajectory",
        ),
        ("dataset.laboratory.cause", "swai", "'sway'.*did you mean sway"),
        (
            "dataset.laboratory.mocap",
            "{noise_std: -1.0}",
            "noise_std.*greater than or equal to 0",
        ),
        ("models.wishart", "{kind: laplace}", "no kind 'laplace'; there are additive"),
        ("models.wishart.left", "[[1.0]]", "unknown key 'left'"),
        ("models.gaussian_2", "{kind: gaussian}", "no model gaussian_2 is chosen"),
    ],
)
def test_a_wrong_value_is_refused_with_its_key(compose, path, value, words):
    nested = value
    for part in reversed(path.split(".")):
        nested = f"{{{part}: {nested}}}"
    with pytest.raises(ConfigError, match=words) as refused:
        compose(overrides=nested)
    key = str(refused.value.evidence["key"])
    assert (
        key.startswith(path.rpartition(".")[0].partition(".")[0])
        or key == "overrides.models"
    )
    # a part that the null leaves alone is named in the file that states it
    names = ("params.yaml", "dataset.yaml", "youbot.yaml")
    assert refused.value.evidence["file"].name in names


@pytest.mark.parametrize(
    ("file", "old", "new", "key"),
    [
        (
            "filter/systematic.yaml",
            "threshold: 0.5",
            "threshold: 5",
            "filter.threshold",
        ),
        ("dataset/youbot.yaml", "gate: 0.012", "gate: far", "dataset.mocap.gate"),
        ("model/wishart.yaml", "kind: wishart", "kind: wishrat", "models.wishart.kind"),
        ("scale/paper.yaml", "test_takes: 50", "test_takes: 0", "scale.test_takes"),
    ],
)
def test_a_wrong_value_of_an_option_file_is_refused_with_the_file(
    compose,
    tmp_path,
    monkeypatch,
    file,
    old,
    new,
    key,
):
    shutil.copytree(config.CONF, tmp_path / "conf")
    monkeypatch.setattr(config, "CONF", tmp_path / "conf")
    text = (tmp_path / "conf" / file).read_text()
    assert old in text
    (tmp_path / "conf" / file).write_text(text.replace(old, new))
    with pytest.raises(ConfigError) as refused:
        compose()
    assert refused.value.evidence["file"] == tmp_path / "conf" / file
    assert refused.value.evidence["key"] == key


def test_all_faults_are_in_one_message(compose):
    with pytest.raises(ConfigError, match="2 faults") as refused:
        compose(overrides="{filter: {particles: 0}, wrench: {grd: 3}}")
    assert "filter.particles: " in str(refused.value) and "did you mean grid" in str(
        refused.value,
    )
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
    file, texts = tmp_path / "config.yaml", []
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
        config.write_config(
            parameters(Path(folder), **choices),
            Path(folder) / "config.yaml",
        )
        return (Path(folder) / "config.yaml").read_bytes()


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
    names = ", ".join(config.option_names("model"))
    models = sections("models", models=f"[{names}]").models
    for model in models.values():
        assert type(model) is options_type(model.kind)
    assert {model.kind for model in models.values()} == {*kinds()}
    alone = sections("models.${item.model}", item="wishart").models
    assert vars(alone) == {"wishart": models["wishart"]}
    laboratory = sections("dataset.laboratory").dataset.laboratory
    # the youBot's controller logs nothing
    types = {part: type(value) for part, value in laboratory.items()}
    cause, dynamics = laboratory["cause"], types.pop("dynamics")
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
    file = tmp_path / "params.yaml"
    text = (
        "paper: {takes: 20, estimators: [a, b]}\nsmoke: {takes: 3, estimators: [a]}\n"
    )
    for scale, expected in (("paper", (20, ["a", "b"])), ("smoke", (3, ["a"]))):
        sections("seed", scale=scale)
        file.write_text(text)
        assert config.study_options(tmp_path, StudyOptions) == StudyOptions(*expected)
    for old, new, words in (
        ("smoke: {takes: 3", "smoke: {takes: few", "takes"),
        ("smoke: {takes: 3", "smoke: {taken: 3", "taken"),
        ("smoke: {takes: 3, ", "smoke: {", "takes"),
        ("smoke:", "tiny:", "no section for the scale smoke"),
    ):
        file.write_text(text.replace(old, new))
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


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        *(
            (key, value, f"also in youbot.yaml: dataset.{key}; keep each in one file")
            for key, value in (
                ("mocap.gate", 0.1),
                ("name", "a"),
                ("depth.workspace", None),
            )
        ),
        (
            "mocap.base.position",
            ["???", 0.0, 0.0],
            "fill in mocap.base.position[0]: the value",
        ),
        (
            "mocap.markers.link2.link2_a",
            "???",
            "fill in mocap.markers.link2.link2_a: the value",
        ),
        ("about.licence", "???", "fill in about.licence: "),
        ("about", None, "needs about"),
        ("about.page", "1", "'page'"),
        ("depth.clock_offset", "early", "clock_offset"),
        ("mocap.markrs", {}, "did you mean markers"),
        ("depth.takes", "${oc.env:HOME}/kinect", "variable of the environment"),
        ("force.log.rate", "${oc.decode:${ oc.env:RATE}}", "variable of the environ"),
    ],
)
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
