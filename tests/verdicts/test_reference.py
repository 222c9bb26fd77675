"""A reference finds the one number it addresses, says when there is none, and refuses to choose
among several.
"""

from __future__ import annotations

import pandas as pd
import pytest

from pipeline.core.errors import ConfigError
from pipeline.core.validation import validated
from pipeline.verdicts.reference import ArmNames, Reference

JOINTS = ("arm_joint_2", "arm_joint_3", "arm_joint_4")
ARM = ArmNames(JOINTS, ("x", "z", "phi"))

EVIDENCE = {
    "metrics/motion": {"wishart_std": 0.5, "std_arm_joint_3_rad": 0.25, "gap": float("nan")},
    "tables/sigma_s": pd.DataFrame(
        {
            "name": ["C1", "C1", "C2"],
            "form": ["diagonal", "full", "diagonal"],
            "agents": [3, 3, 5],
            "e": [1.0, 2.0, 3.0],
        }
    ),
}


def test_a_key_and_a_row_are_found():
    assert Reference("metrics/motion", "wishart_std").look_up(EVIDENCE, ARM) == 0.5
    assert (
        Reference("tables/sigma_s", rows={"name": "C1", "form": "full"}, column="e").look_up(
            EVIDENCE, ARM
        )
        == 2.0
    )
    assert Reference("tables/sigma_s", rows={"agents": 5}, column="e").look_up(EVIDENCE, ARM) == 3.0


@pytest.mark.parametrize(
    "reference",
    [
        Reference("metrics/motion", "no_such"),
        Reference("metrics/motion", "gap"),
        Reference("metrics/none", "wishart_std"),
        Reference("tables/sigma_s", "e"),
        Reference("metrics/motion", rows={"name": "C1"}, column="e"),
        Reference("tables/sigma_s", rows={"name": "C3"}, column="e"),
        Reference("tables/sigma_s", rows={"colour": "red"}, column="e"),
        Reference("tables/sigma_s", rows={"name": "C2"}, column="f"),
    ],
)
def test_what_a_run_lacks_is_none(reference):
    assert reference.look_up(EVIDENCE, ARM) is None


def test_several_rows_are_refused():
    with pytest.raises(ConfigError, match="2 rows fit"):
        Reference("tables/sigma_s", rows={"name": "C1"}, column="e").look_up(EVIDENCE, ARM)


def test_placeholders_take_the_values_of_a_case():
    template = Reference(
        "tables/sigma_s", rows={"name": "{c}", "form": "diagonal", "agents": 3}, column="{column}"
    )
    assert template.in_case({"c": "C1", "column": "e"}).look_up(EVIDENCE, ARM) == 1.0
    assert (
        template.in_case({"c": "C1", "column": "e"}).address
        == "tables/sigma_s.csv: e where name = C1, form = diagonal, agents = 3"
    )
    assert (
        Reference("metrics/motion", "{m}_std").in_case({"m": "wishart"}).address
        == "metrics/motion.json: wishart_std"
    )
    with pytest.raises(ConfigError, match="placeholder"):
        template.in_case({"c": "C1"})


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"key": "a", "column": "b"},
        {"key": "a", "rows": {"b": 1}},
        {"column": "e", "rows": ["b"]},
        {"key": 3},
    ],
)
def test_what_is_neither_a_key_nor_a_cell_is_refused(parts):
    with pytest.raises(ConfigError):
        validated(Reference, {"file": "metrics/motion"} | parts)


def test_a_joint_by_its_number_has_the_name_that_the_run_gives_it():
    in_case = Reference("metrics/motion", "std_{joint}_rad").in_case({"joint": "{joint 2}"})
    fixed = Reference("metrics/motion", "std_{joint 2}_rad")
    assert in_case == fixed == fixed.in_case({"model": "wishart"})
    assert fixed.look_up(EVIDENCE, ARM) == 0.25
    assert fixed.look_up(EVIDENCE, ARM._replace(joints=JOINTS[::-1])) == 0.25
    assert fixed.look_up(EVIDENCE, ARM._replace(joints=("a", "b", "arm_joint_3"))) is None
    assert fixed.address == "metrics/motion.json: std_{joint 2}_rad"
    table = {"tables/t": pd.DataFrame({"score": ["rms_arm_joint_2"], "mean": [1.5]})}
    row = Reference("tables/t", rows={"score": "rms_{joint 1}"}, column="mean")
    assert row.look_up(table, ARM) == 1.5


@pytest.mark.parametrize(
    "arm",
    [
        ARM._replace(joints=(*JOINTS, "arm_joint_5")),
        ARM._replace(joints=JOINTS[:2], task=("x", "z")),
        ARM._replace(task=("x", "z")),
        ARM._replace(task=("x", "y", "z")),
    ],
)
def test_the_joints_of_another_arm_or_task_than_the_papers_have_no_numbers(arm):
    assert arm.numbered == () and ARM.numbered == JOINTS
    assert Reference("metrics/motion", "std_{joint 2}_rad").look_up(EVIDENCE, arm) is None
    named = Reference("metrics/motion", "std_{joint}_rad").in_case({"joint": "arm_joint_3"})
    assert named.look_up(EVIDENCE, arm) == 0.25
