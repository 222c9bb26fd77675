"""A draft is filled in line by line; what an answer breaks is said at once and leaves it as it
was; faults are all said.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.core.datasheet import Draft, absent, faults
from pipeline.core.errors import ConfigError

SHEET, OPTION = Path("dataset.yaml"), Path("lab.yaml")
TEXTS = {
    SHEET: "# ??? is asked\nabout:\n  subject: ??? # what\njoint_log:\n  time_unit: ??? # unit\n",
    OPTION: "name: lab\nmotion:\n  rate: ??? # 1/s\n  steps: ??? # M\n",
}


@pytest.fixture
def draft():
    return Draft(dict(TEXTS))


def said_by_types(values: dict) -> list:
    return faults(values)


def test_open_values_are_asked_with_their_comments(draft):
    assert [(question.key, question.hint) for question in draft.questions()] == [
        ("about.subject", "what"),
        ("joint_log.time_unit", "unit"),
        ("motion.rate", "1/s"),
        ("motion.steps", "M"),
    ]


def test_an_answer_takes_the_place_of_its_mark_and_comments_stay(draft):
    draft.note("about.subject", "suggested is an arm")
    for key, value in (
        ("about.subject", "an arm: # 1"),
        ("motion.steps", "20"),
        ("motion.rate", "1e2"),
    ):
        draft.answer(key, value, said_by_types)
    assert '  subject: "an arm: # 1" # what\n' in draft.texts[SHEET]
    assert draft.texts[OPTION].endswith("  rate: 1e2 # 1/s\n  steps: 20 # M\n")
    assert draft.values()["motion"] == {"rate": 100.0, "steps": 20}
    assert [question.key for question in draft.questions()] == ["joint_log.time_unit"]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("joint_log.time_unit", "minutes", "input should be"),
        ("motion.steps", "many", "many"),
        ("motion.steps", "", "a value has to stand here"),
        ("motion.pace", "1", "still to be filled in; there are about.subject"),
    ],
)
def test_a_wrong_answer_is_refused_and_leaves_the_draft(draft, key, value, words):
    with pytest.raises(ConfigError, match=words):
        draft.answer(key, value, said_by_types)
    assert draft.texts == TEXTS


def test_all_faults_are_said_and_all_keys_that_are_absent():
    values = {
        "name": "lab",
        "robot": {"urdf": "arm.urdf", "joint": ["a"], "length": -1.0},
        "motion": {"rate": "fast", "steps": 3, "pose_noise": 0.0},
        "measurement": "taste",
    }
    keys = [fault.evidence["key"] for fault in faults(values)]
    assert keys == [
        "dataset.robot.length",
        "dataset.robot.joint",
        "dataset.motion.rate",
        "dataset.motion.pose_noise",
        "dataset.measurement",
    ]
    assert absent({"name": "lab", "motion": {"rate": 1.0}}) == [
        "motion.steps",
        "recordings",
        "robot",
    ]
