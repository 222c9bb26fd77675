"""A stage is handed the sections of the configuration that it declares, as typed objects, and no
more.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import yaml
from params_file import parameters

from pipeline.core import config
from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Compute, Filter
from pipeline.core.options.dataset import Robot
from pipeline.core.validation import options
from pipeline.laboratory import options as twin_options
from pipeline.models.kinds import kinds, options_type


@cache
def written(**choices: str) -> bytes:
    """The composed configuration as the stage configure writes it."""
    with TemporaryDirectory() as folder:
        config.write_config(parameters(Path(folder), **choices), Path(folder) / "config.yaml")
        return (Path(folder) / "config.yaml").read_bytes()


@pytest.fixture
def handed(tmp_path, monkeypatch):
    """What a stage that declares the given sections is handed of the composed configuration."""
    monkeypatch.chdir(tmp_path)
    config.COMPOSED.parent.mkdir()

    def sections(*declared: str, item: str | None = None, **choices: str):
        config.COMPOSED.write_bytes(written(**choices))
        stage = {"cmd": "true", "params": [{str(config.COMPOSED): list(declared)}]}
        Path("dvc.yaml").write_text(yaml.safe_dump({"stages": {"stage": stage}}))
        return config.sections("stage", item=item)

    return sections


def test_a_stage_is_handed_the_sections_it_declares_as_typed_objects(handed):
    settings = handed("seed", "dataset.robot", "filter", "scale.convex_checks")
    assert settings.seed == 2017
    assert isinstance(settings.dataset.robot, Robot)
    assert isinstance(settings.filter, Filter)
    assert settings.scale.convex_checks > 0
    assert isinstance(settings.compute, Compute)


def test_a_study_of_motion_is_refused_without_a_robot_and_the_papers_stage_is_not(
    handed, monkeypatch, tmp_path
):
    assert handed("dataset.robot", dataset="towing").dataset.robot is None
    study = tmp_path / "pipeline/study/dvc.yaml"
    study.parent.mkdir(parents=True)
    study.write_bytes(Path("dvc.yaml").read_bytes())
    assert config.sections("stage", study).dataset.robot is None
    monkeypatch.setattr(config, "CONF", tmp_path / "pipeline/conf")
    with pytest.raises(ConfigError, match="about a robot's motion, and the dataset has no robot"):
        config.sections("stage", study)
    handed("dataset.robot")
    assert config.sections("stage", study).dataset.robot is not None


@pytest.mark.parametrize(
    "access", ["wrench", "models", "dataset.motion", "dataset.laboratory", "scale.particles"]
)
def test_what_a_stage_does_not_declare_it_does_not_get(handed, access):
    settings = handed("seed", "dataset.robot", "scale.convex_checks")
    with pytest.raises(AttributeError):
        for key in access.split("."):
            settings = getattr(settings, key)


def test_models_are_handed_over_as_their_own_types(handed):
    models = handed("models", models="[additive, wishart, gaussian, scaled]").models
    assert {name: type(model) for name, model in models.items()} == {
        kind: options_type(kind) for kind in kinds()
    }
    assert not hasattr(handed("models.${item.model}", item="wishart").models, "additive")
    assert handed("models.${item.model}", item="wishart").models.wishart == models["wishart"]


def test_a_model_that_is_not_in_the_configuration_is_refused(handed):
    for item in ("student", None):
        with pytest.raises(ConfigError, match=f"there is no models.{item}"):
            handed("models.${item.model}", item=item)


def test_the_laboratorys_options_are_handed_over_as_their_own_types(handed):
    laboratory = handed(
        "dataset.laboratory", overrides="{dataset: {laboratory: {mocap: {noise_std: 1e-5}}}}"
    ).dataset.laboratory
    kinds = {part: type(value).__name__ for part, value in laboratory.items()}
    # the youBot's controller logs nothing
    assert kinds | {"encoders": "EncoderOptions"} == config.LABORATORY
    assert laboratory["mocap"] == twin_options.MocapOptions(
        noise_std=1e-5, placement_std=laboratory["mocap"].placement_std
    )


def test_an_instrument_that_a_dataset_lacks_is_none(handed):
    instruments = ["mocap", "depth", "force", "joint_log", "laboratory", "trajectory"]
    lacking = ", ".join(f"{instrument}: null" for instrument in instruments)
    dataset = handed(
        *(f"dataset.{instrument}" for instrument in instruments),
        overrides=f"{{dataset: {{{lacking}}}}}",
    ).dataset
    assert vars(dataset) == dict.fromkeys(instruments)


def test_a_stage_that_dvc_yaml_does_not_have_is_refused(handed):
    handed("seed")
    with pytest.raises(ConfigError, match="no stage 'nonsense'; there are stage"):
        config.sections("nonsense")


def test_a_composed_configuration_of_another_version_is_refused(handed):
    handed("seed")
    config.COMPOSED.write_text(config.COMPOSED.read_text().replace("particles:", "swarm:"))
    with pytest.raises(ConfigError, match="'swarm'"):
        config.sections("stage")


@pytest.mark.slow
@pytest.mark.parametrize(
    "dvc_file", [Path("dvc.yaml"), *Path("data/raw").glob("*/dvc.yaml")], ids=str
)
def test_every_section_that_a_stage_declares_exists(dvc_file, handed, request):
    root = request.config.rootpath
    stages = yaml.safe_load((root / dvc_file).read_text())["stages"]
    handed("seed")
    for stage in stages:
        config.sections(stage, root / dvc_file, item="wishart")


@options()
class StudyOptions:
    """Options of a study of these tests."""

    takes: int
    estimators: list[str]


@pytest.fixture
def study(handed, tmp_path) -> Path:
    """A study's folder, its options for two scales; the experiment runs at scale ``smoke``."""
    handed("seed", scale="smoke")
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "params.yaml").write_text(
        "paper: {takes: 20, estimators: [a, b]}\nsmoke: {takes: 3, estimators: [a]}\n"
    )
    return folder


def test_a_study_is_handed_its_options_for_the_scale_of_the_run(study, handed):
    assert config.study_options(study, StudyOptions) == StudyOptions(3, ["a"])
    handed("seed", scale="paper")
    assert config.study_options(study, StudyOptions) == StudyOptions(20, ["a", "b"])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("smoke: {takes: 3", "smoke: {takes: few", "takes"),
        ("smoke: {takes: 3", "smoke: {taken: 3", "taken"),
        ("smoke: {takes: 3, ", "smoke: {", "takes"),
        ("smoke:", "tiny:", "no section for the scale smoke"),
        ("smoke:", "- smoke:", ""),
    ],
)
def test_options_of_a_study_that_are_wrong_are_refused_with_its_file(study, old, new, said):
    file = study / "params.yaml"
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(ConfigError) as refused:
        config.study_options(study, StudyOptions)
    assert said in str(refused.value) and refused.value.evidence["file"] == file


def test_options_of_models_that_the_run_has_not_chosen_are_typed_by_their_kinds(handed):
    chosen = handed("models", models="[additive]").models
    names = config.option_names("model")
    models = config.model_options(names)
    assert list(models) == names and models["additive"] == chosen["additive"]
    assert {type(model) for model in models.values()} == {options_type(kind) for kind in kinds()}


def test_a_model_without_an_option_file_is_refused_with_those_there_are():
    known = ", ".join(config.option_names("model"))
    with pytest.raises(ConfigError, match=f"no model 'laplace'; there are {known}"):
        config.model_options(["additive", "laplace"])
