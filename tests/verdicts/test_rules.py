"""Every rule holds where it should and nowhere else, and none holds for want of a number; a
reference finds the one number it addresses; a run is read again as it was.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core.errors import ConfigError, ContractError
from pipeline.core.validation import validated
from pipeline.statistics.curves import POWER
from pipeline.verdicts.reference import ArmNames, Reference
from pipeline.verdicts.rules import LEAST_POWER, RULES
from pipeline.verdicts.run import Run, read_run, read_runs

COLUMNS = ["value", "than", "low", "high", "threshold", "power", "standard_error"]
COLUMNS += ["published", "tolerance", "limit", "yardstick", "distance"]
JOINTS = ("arm_joint_2", "arm_joint_3", "arm_joint_4")
ARM = ArmNames(JOINTS, ("x", "z", "phi"))
ROWS = [("C1", "diagonal", 3, 1.0), ("C1", "full", 3, 2.0), ("C2", "diagonal", 5, 3.0)]
EVIDENCE = {
    "metrics/motion": {"wishart_std": 0.5, "std_arm_joint_3_rad": 0.25, "gap": float("nan")},
    "tables/sigma_s": pd.DataFrame(ROWS, columns=["name", "form", "agents", "e"]),
    "tables/t": pd.DataFrame({"score": ["rms_arm_joint_2"], "mean": [1.5]}),
}


def cases(value, **others) -> pd.DataFrame:
    table = pd.DataFrame({"value": value} | others, dtype=float).reindex(columns=COLUMNS)
    return table.assign(yardstick=table.published.fillna(table.limit))


@pytest.mark.parametrize(
    ("rule", "value", "others", "expected"),
    [
        ("within_relative", [11.9, 12.1, -10], {"published": 10, "tolerance": 0.2}, [1, 0, 0]),
        ("within_relative", [-11.9, -12.1], {"published": -10, "tolerance": 0.2}, [1, 0]),
        ("within_absolute", [0.044, 0.046], {"published": 0.04, "tolerance": 0.005}, [1, 0]),
        ("below", [0.9, 1.0], {"limit": 1.0}, [1, 0]),
        ("below", [0.9, 1.9], {"published": [1.0, 2.0]}, [1, 1]),
        ("above", [1.1, 1.0], {"limit": 1.0}, [1, 0]),
        ("less", [1.0, 2.0], {"than": 1.5, "low": [-1, 0.1], "high": [-0.1, 1]}, [1, 0]),
        ("greater", [1.0, 2.0], {"than": 1.5, "low": [-1, 0.1], "high": [-0.1, 1]}, [0, 1]),
        ("follows", [0.5, 0.5], {"threshold": [0.4, 0.6], "power": 1.0}, [1, 0]),
        ("varies", [0.3, 0.2], {"threshold": 0.1, "limit": 0.25}, [1, 0]),
        ("decreasing", [3, 2, 2, 1], {}, [1, 1, 0, 1]),
        # an interval about zero that is too wide shows no equivalence
        (
            "equivalent",
            [0, 0, 0, 0],
            {"low": [-1, -3, -1, -5], "high": [1, 1, 3, 5], "than": 10, "tolerance": 0.2},
            [1, 0, 0, 0],
        ),
        (
            "interval_contains",
            [0, 0, 0, 0],
            {"low": [5, 8, 5, 7.4], "high": [6, 9, 6.6, 9], "published": 7, "tolerance": 0.5},
            [0, 0, 1, 1],
        ),
        ("standard_errors", [1, 1, 1], {"distance": [1.9, -2.1, np.inf], "limit": 2}, [1, 0, 0]),
    ],
)
def test_a_rule_holds_on_its_side_of_the_yardstick_alone(rule, value, others, expected):
    assert RULES[rule].holds(cases(value, **others)).tolist() == expected


@pytest.mark.parametrize("rule", sorted(set(RULES) - {"decreasing"}))
def test_no_rule_holds_without_its_numbers(rule):
    assert RULES[rule].holds(cases([np.nan, 1.0], tolerance=0.1)).tolist() == [False, False]


@pytest.mark.parametrize(
    ("rule", "value", "others", "expected"),
    [
        ("less", [1, 1, 1], {"low": [-2, 1, -1], "high": [-1, 2, 1]}, [1, 1, 0]),
        ("less", [1.0], {}, [0]),
        ("follows", [0.5, 0.5], {"threshold": 0.4, "power": [0.79, 0.8]}, [0, 1]),
        ("varies", [0.2, 0.3, 0.5], {"limit": 0.25, "threshold": 0.4}, [1, 0, 1]),
        ("below", [0.2], {"limit": 0.25}, [1]),
    ],
)
def test_a_rule_decides_nothing_that_chance_alone_would_make(rule, value, others, expected):
    assert RULES[rule].decides(cases(value, **others)).tolist() == expected
    assert LEAST_POWER == POWER


@pytest.mark.parametrize(
    ("file", "key", "rows", "column", "expected"),
    [
        ("metrics/motion", "wishart_std", {}, "", 0.5),
        ("tables/sigma_s", "", {"name": "C1", "form": "full"}, "e", 2.0),
        ("tables/sigma_s", "", {"agents": 5}, "e", 3.0),
        # a joint by its number has the name that the run gives it
        ("metrics/motion", "std_{joint 2}_rad", {}, "", 0.25),
        ("tables/t", "", {"score": "rms_{joint 1}"}, "mean", 1.5),
        ("metrics/motion", "no_such", {}, "", None),
        ("metrics/motion", "gap", {}, "", None),
        ("metrics/none", "wishart_std", {}, "", None),
        ("tables/sigma_s", "e", {}, "", None),
        ("metrics/motion", "", {"name": "C1"}, "e", None),
        ("tables/sigma_s", "", {"name": "C3"}, "e", None),
        ("tables/sigma_s", "", {"colour": "red"}, "e", None),
        ("tables/sigma_s", "", {"name": "C2"}, "f", None),
    ],
)
def test_a_number_is_found_and_one_that_a_run_lacks_is_none(file, key, rows, column, expected):
    assert Reference(file, key, rows, column).look_up(EVIDENCE, ARM) == expected


def test_placeholders_take_the_values_of_a_case_and_several_rows_are_refused():
    with pytest.raises(ConfigError, match="2 rows fit"):
        Reference("tables/sigma_s", rows={"name": "C1"}, column="e").look_up(EVIDENCE, ARM)
    rows = {"name": "{c}", "form": "diagonal", "agents": 3}
    template = Reference("tables/sigma_s", rows=rows, column="{column}")
    case = template.in_case({"c": "C1", "column": "e"})
    assert case.look_up(EVIDENCE, ARM) == 1.0
    assert case.address == "tables/sigma_s.csv: e where name = C1, form = diagonal, agents = 3"
    in_case = Reference("metrics/motion", "std_{joint}_rad").in_case({"joint": "{joint 2}"})
    assert in_case.address == "metrics/motion.json: std_{joint 2}_rad"
    with pytest.raises(ConfigError, match="placeholder"):
        template.in_case({"c": "C1"})


@pytest.mark.parametrize(
    "parts",
    [{}, {"key": "a", "column": "b"}, {"key": "a", "rows": {"b": 1}}, {"rows": ["b"]}, {"key": 3}],
)
def test_what_is_neither_a_key_nor_a_cell_is_refused(parts):
    with pytest.raises(ConfigError):
        validated(Reference, {"file": "metrics/motion"} | parts)


@pytest.mark.parametrize(
    ("joints", "task"),
    [
        ((*JOINTS, "arm_joint_5"), ARM.task),
        (JOINTS[:2], ("x", "z")),
        (JOINTS, ("x", "z")),
        (JOINTS, ("x", "y", "z")),
    ],
)
def test_the_joints_of_another_arm_or_task_than_the_papers_have_no_numbers(joints, task):
    arm = ArmNames(joints, task)
    assert arm.numbered == () and ARM.numbered == JOINTS
    assert Reference("metrics/motion", "std_{joint 2}_rad").look_up(EVIDENCE, arm) is None
    named = Reference("metrics/motion", "std_{joint}_rad").in_case({"joint": "arm_joint_3"})
    assert named.look_up(EVIDENCE, arm) == 0.25


STEPS = ["all", "moving, ‖J⁻¹‖: 1, 2"]
TABLE = pd.DataFrame({"steps": STEPS, "mean": [0.1 + 0.2, -np.inf], "low": [np.nan, 1e-300]})
MODELS = {"a": "additive", "g": "gaussian", "gf": "gaussian"}
METRICS, TABLES = {"motion": {"x": 1 / 3}}, {"scores": TABLE}
RUN = Run("lab", "paper", False, ["base", "elbow"], ["x", "z"], MODELS, METRICS, TABLES)


def test_a_run_comes_back_from_its_file_with_every_digit_gap_and_infinity(tmp_path):
    file = tmp_path / "lab.json"
    file.write_text(RUN.to_json(), encoding="utf-8")
    again = read_run(file)
    assert again.metrics == METRICS and again.models == MODELS
    assert again.arm == (("base", "elbow"), ("x", "z"))
    pd.testing.assert_frame_equal(again.tables["scores"], TABLE, check_exact=True)
    assert again.evidence.keys() == {"metrics/motion", "tables/scores"}
    assert again.to_json() == RUN.to_json()
    # a row of a table is a line of the file
    lines = RUN.to_json().splitlines()
    assert sum("0.30000000000000004" in line for line in lines) == 1


def test_the_run_at_hand_comes_first_and_the_others_by_name(tmp_path):
    for name in ("b", "a", "c"):
        text = RUN.to_json().replace('"lab"', f'"{name}"')
        (tmp_path / f"{name}.json").write_text(text, encoding="utf-8")
    assert [run.dataset for run in read_runs(tmp_path, first="c")] == ["c", "a", "b"]
    with pytest.raises(ContractError, match="no evidence of the dataset d"):
        read_runs(tmp_path, first="d")


@pytest.mark.parametrize(
    "text", ["", "[]", '{"tables": 3}', '{"tables": {}}', RUN.to_json().replace("scale", "size")]
)
def test_a_file_that_is_no_run_is_refused_by_name(tmp_path, text):
    (tmp_path / "lab.json").write_text(text, encoding="utf-8")
    with pytest.raises(ContractError, match=r"lab\.json"):
        read_run(tmp_path / "lab.json")
