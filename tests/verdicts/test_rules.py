"""Every rule holds where it should and nowhere else, and none holds for want of a number."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.statistics.curves import POWER
from pipeline.verdicts.rules import LEAST_POWER, RULES, Readings


def readings(value, **others) -> Readings:
    gap = np.full(len(value), np.nan)
    stated = {
        key: np.broadcast_to(np.array(others.pop(key), dtype=float), len(value))
        for key in list(others)
        if key not in ("tolerance", "limit")
    }
    names = ("than", "low", "high", "threshold", "power", "standard_error", "published")
    blank = dict.fromkeys(names, gap)
    return Readings(
        np.array(value, dtype=float),
        **blank | stated,
        tolerance=others.get("tolerance", np.nan),
        limit=others.get("limit", np.nan),
    )


def holds(rule: str, value, **others) -> list[bool]:
    return RULES[rule].holds(readings(value, **others)).tolist()


@pytest.mark.parametrize(
    ("rule", "value", "others", "expected"),
    [
        (
            "within_relative",
            [11.9, 12.1, -10],
            {"published": 10, "tolerance": 0.2},
            [True, False, False],
        ),
        ("within_relative", [-11.9, -12.1], {"published": -10, "tolerance": 0.2}, [True, False]),
        ("within_absolute", [0.044, 0.046], {"published": 0.04, "tolerance": 0.005}, [True, False]),
        ("below", [0.9, 1.0], {"limit": 1.0}, [True, False]),
        ("below", [0.9, 1.9], {"published": [1.0, 2.0]}, [True, True]),
        ("above", [1.1, 1.0], {"limit": 1.0}, [True, False]),
        ("less", [1.0, 2.0], {"than": 1.5, "low": [-1, 0.1], "high": [-0.1, 1]}, [True, False]),
        ("greater", [1.0, 2.0], {"than": 1.5, "low": [-1, 0.1], "high": [-0.1, 1]}, [False, True]),
        ("follows", [0.5, 0.5], {"threshold": [0.4, 0.6], "power": 1.0}, [True, False]),
        ("varies", [0.3, 0.2], {"threshold": 0.1, "limit": 0.25}, [True, False]),
        ("decreasing", [3, 2, 2, 1], {}, [True, True, False, True]),
        (
            "equivalent",
            [0, 0, 0],
            {"low": [-1, -3, -1], "high": [1, 1, 3], "than": 10, "tolerance": 0.2},
            [True, False, False],
        ),
        (
            "interval_contains",
            [0, 0],
            {"low": [5, 8], "high": [6, 9], "published": 7, "tolerance": 0.5},
            [False, False],
        ),
        (
            "interval_contains",
            [0, 0],
            {"low": [5, 7.4], "high": [6.6, 9], "published": 7, "tolerance": 0.5},
            [True, True],
        ),
        (
            "standard_errors",
            [1, 1],
            {"published": [2.9, 3.1], "standard_error": 1.0, "limit": 2.0},
            [True, False],
        ),
    ],
)
def test_a_rule_holds_on_its_side_of_the_yardstick_alone(rule, value, others, expected):
    assert holds(rule, value, **others) == expected


@pytest.mark.parametrize("rule", sorted(set(RULES) - {"decreasing"}))
def test_no_rule_holds_without_its_numbers(rule):
    assert holds(rule, [np.nan, 1.0], tolerance=0.1) == [False, False]


@pytest.mark.parametrize(
    ("rule", "value", "others", "expected"),
    [
        ("less", [1, 1, 1], {"low": [-2, 1, -1], "high": [-1, 2, 1]}, [True, True, False]),
        ("less", [1.0], {}, [False]),
        ("follows", [0.5, 0.5], {"threshold": 0.4, "power": [0.79, 0.8]}, [False, True]),
        ("varies", [0.2, 0.3, 0.5], {"limit": 0.25, "threshold": 0.4}, [True, False, True]),
        ("below", [0.2], {"limit": 0.25}, [True]),
    ],
)
def test_a_rule_decides_nothing_that_chance_alone_would_make(rule, value, others, expected):
    assert RULES[rule].decides(readings(value, **others)).tolist() == expected


def test_the_power_of_a_rule_is_that_of_the_test():
    assert LEAST_POWER == POWER


def test_an_interval_about_zero_that_is_too_wide_shows_no_equivalence():
    """Not being told apart is not being equal."""
    assert holds("equivalent", [0.0], low=-5, high=5, than=10, tolerance=0.2) == [False]
    assert holds("equivalent", [0.0], low=-1, high=1, than=10, tolerance=0.2) == [True]


def test_the_distance_is_published_minus_ours_in_standard_errors():
    np.testing.assert_allclose(
        readings([1.0, 5.0], published=2.0, standard_error=0.5).distance, [2.0, -6.0]
    )
    assert holds("standard_errors", [1.0], published=2.0, standard_error=0.0, limit=3.0) == [False]
