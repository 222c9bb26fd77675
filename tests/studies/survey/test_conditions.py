"""The grid: each level alone or every combination, always with every seed."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from pipeline.laboratory.options import DynamicsOptions
from pipeline.studies.survey.conditions import (
    BASE,
    FACTORS,
    SIZES,
    Factors,
    motion_conditions,
    physics,
    wrench_conditions,
)

LEVELS = {"clearance": [0.0, 1.0, 2.0], "jitter_std": [4.0]}


def off_base(condition) -> dict[str, object]:
    values = asdict(condition.factors) | {
        "trajectory": condition.trajectory,
        "particles": condition.particles,
    }
    base = dict.fromkeys(FACTORS, 1.0) | {"trajectory": "a", "particles": 10}
    return {name: value for name, value in values.items() if value != base[name]}


def test_each_level_alone_is_the_base_condition_and_then_one_change_at_a_time():
    result = motion_conditions([7, 8], ["a", "b"], [10, 20], LEVELS, "one_at_a_time")
    assert [condition.seed for condition in result] == [7, 8] * 6
    changes = [off_base(condition) for condition in result[::2]]
    assert changes == [
        {},
        {"trajectory": "b"},
        {"particles": 20},
        {"clearance": 0.0},
        {"clearance": 2.0},
        {"jitter_std": 4.0},
    ]


def test_every_combination_is_there_once():
    result = motion_conditions([7, 8], ["a", "b"], [10, 20], LEVELS, "factorial")
    assert len(result) == len(set(result)) == 2 * 2 * 2 * 3 * 1
    assert all(
        condition.factors.jitter_std == 4.0 and condition.factors.sway_std == 1.0
        for condition in result
    )


@pytest.mark.parametrize(
    ("design", "count"), [("one_at_a_time", 1 + 1 + 2 + 1), ("factorial", 2 * 2 * 1)]
)
def test_the_wrench_has_a_grid_of_its_own(design, count):
    result = wrench_conditions([3], [[3, 5], [2, 3]], [0.5, 4.0], [2.0], design)
    assert len(result) == len(set(result)) == count
    assert result[0].agents == (3, 5)


def test_every_factor_on_a_size_is_a_disturbance_of_the_laboratory():
    assert set(SIZES) < set(vars(DynamicsOptions())) and set(FACTORS) == set(asdict(Factors()))


def test_the_physics_of_a_survey_are_its_factors_on_the_arm_one_at_a_time():
    named = physics(LEVELS | {"motion_capture": [4.0], "depth_camera": [0.25]})
    assert list(named) == [BASE, "clearance 0", "clearance 2", "jitter_std 4"]
    assert named[BASE] == Factors() and named["clearance 2"] == Factors(clearance=2.0)
    # the control: an instrument is no physics of the arm, and a factor on two levels is none twice
    assert physics({"motion_capture": [4.0]}) == {BASE: Factors()}
