"""A dataset's datasheet and its option file: put together, held against each other, named where
they are wrong, and filled in line by line.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml
from made_options import parameters

from pipeline.core import config, datasheet
from pipeline.core.datasheet import Draft, absent, faults
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


def test_a_value_to_fill_in_is_named_with_its_file_or_filled_by_an_override(
    sheet, tmp_path, monkeypatch
):
    edit(sheet, "force.tare", "???")
    override = "{dataset: {force: {tare: 4.0}}}"
    assert config.compose_config(parameters(tmp_path, overrides=override)).dataset.force.tare == 4.0
    shutil.copytree(config.CONF, tmp_path / "conf")
    monkeypatch.setattr(config, "CONF", tmp_path / "conf")
    option_file = config.CONF / "dataset/youbot.yaml"
    edit(option_file, "mocap.gate", "???")
    refused = refusal(tmp_path, overrides=override)
    assert refused.evidence == {"key": "mocap.gate", "file": option_file}


def test_a_datasheet_that_is_missing_is_refused(sheet, tmp_path):
    sheet.unlink()
    assert refusal(tmp_path).evidence["file"] == sheet


def test_every_dataset_has_a_datasheet_with_nothing_to_fill_in():
    for dataset in config.option_names("dataset"):
        sheet = config.read_yaml(datasheet.path_of(dataset))
        assert [*datasheet.unfilled_keys(sheet)] == []


SHEET, OPTION = Path("dataset.yaml"), Path("lab.yaml")
TEXTS = {
    SHEET: "# ??? is asked\nabout:\n  subject: ??? # what\njoint_log:\n  time_unit: ??? # unit\n",
    OPTION: "name: lab\nmotion:\n  rate: ??? # 1/s\n  steps: ??? # M\n",
}


def test_answers_take_the_places_of_open_values_and_comments_stay():
    draft = Draft(dict(TEXTS))
    questions = {question.key: question.hint for question in draft.questions()}
    keys = ("about.subject", "joint_log.time_unit", "motion.rate", "motion.steps")
    assert questions == dict(zip(keys, ("what", "unit", "1/s", "M"), strict=True))
    draft.note("about.subject", "suggested is an arm")
    for key, value in (
        ("about.subject", "an arm: # 1"),
        ("motion.steps", "20"),
        ("motion.rate", "1e2"),
    ):
        draft.answer(key, value, faults)
    assert '  subject: "an arm: # 1" # what\n' in draft.texts[SHEET]
    assert draft.texts[OPTION].endswith("  rate: 1e2 # 1/s\n  steps: 20 # M\n")
    assert draft.values()["motion"] == {"rate": 100.0, "steps": 20}
    assert [question.key for question in draft.questions()] == ["joint_log.time_unit"]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("joint_log.time_unit", "minutes", "input should be"),
        ("motion.steps", "many", "many"),
        ("motion.steps", "", "a value is required here"),
        ("motion.pace", "1", "still to be filled in; there are about.subject"),
    ],
)
def test_a_wrong_answer_is_refused_and_leaves_the_draft(key, value, words):
    draft = Draft(dict(TEXTS))
    with pytest.raises(ConfigError, match=words):
        draft.answer(key, value, faults)
    assert draft.texts == TEXTS


def test_all_faults_and_all_absent_keys_of_a_draft_are_named():
    values = {
        "name": "lab",
        "robot": {"urdf": "arm.urdf", "joint": ["a"], "length": -1.0},
        "motion": {"rate": "fast", "steps": 3, "pose_noise": 0.0},
        "measurement": "taste",
    }
    keys = ("robot.length", "robot.joint", "motion.rate", "motion.pose_noise", "measurement")
    assert [fault.evidence["key"] for fault in faults(values)] == [f"dataset.{k}" for k in keys]
    lacking = absent({"name": "lab", "motion": {"rate": 1.0}})
    assert lacking == ["motion.steps", "recordings", "robot"]
