"""The rules that decide claims: a closed set, each a function of a claim's readings that says in
which of its cases it holds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Readings:
    """What a rule may look at, each (cases,) and NaN where a claim has no such thing.

    ``value`` is ours, ``than`` what it is compared with, ``low`` and ``high`` its interval,
    ``standard_error`` that of its distance from the published value. ``tolerance`` and ``limit``
    are the claim's own.
    """

    value: np.ndarray
    than: np.ndarray
    low: np.ndarray
    high: np.ndarray
    standard_error: np.ndarray
    published: np.ndarray
    tolerance: float
    limit: float

    @property
    def yardstick(self) -> np.ndarray:
        """The published value, or the limit where nothing is published."""
        return np.where(np.isnan(self.published), self.limit, self.published)

    @property
    def distance(self) -> np.ndarray:
        """Published value minus ours in standard errors; infinite where there is no error."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return (self.published - self.value) / self.standard_error


@dataclass(frozen=True)
class Rule:
    """What a rule asks in words, what of a claim it needs, and in which cases it holds."""

    words: str
    needs: frozenset[str]
    holds: Callable[[Readings], np.ndarray]


def _within_relative(readings: Readings) -> np.ndarray:
    return np.abs(readings.value - readings.published) <= readings.tolerance * np.abs(
        readings.published
    )


def _within_absolute(readings: Readings) -> np.ndarray:
    return np.abs(readings.value - readings.published) <= readings.tolerance


def _below(readings: Readings) -> np.ndarray:
    return readings.value < readings.yardstick


def _above(readings: Readings) -> np.ndarray:
    return readings.value > readings.yardstick


def _less(readings: Readings) -> np.ndarray:
    return readings.value < readings.than


def _decreasing(readings: Readings) -> np.ndarray:
    return np.diff(readings.value, prepend=np.inf) < 0


def _equivalent(readings: Readings) -> np.ndarray:
    margin = readings.tolerance * np.abs(readings.than)
    return (readings.low > -margin) & (readings.high < margin)


def _interval_contains(readings: Readings) -> np.ndarray:
    return (readings.low - readings.tolerance <= readings.published) & (
        readings.published <= readings.high + readings.tolerance
    )


def _standard_errors(readings: Readings) -> np.ndarray:
    return np.abs(readings.distance) < readings.limit


RULES = {
    "within_relative": Rule(
        "within a share {tolerance} of the published value",
        frozenset({"published", "tolerance"}),
        _within_relative,
    ),
    "within_absolute": Rule(
        "within ±{tolerance} of the published value",
        frozenset({"published", "tolerance"}),
        _within_absolute,
    ),
    "below": Rule("below {yardstick}", frozenset({"yardstick"}), _below),
    "above": Rule("above {yardstick}", frozenset({"yardstick"}), _above),
    "less": Rule("less than the value it is compared with", frozenset({"than"}), _less),
    "decreasing": Rule("less from case to case", frozenset(), _decreasing),
    "equivalent": Rule(
        "the 95 % interval of the difference within ± a share {tolerance} of the value compared "
        "with",
        frozenset({"than", "low", "high", "tolerance"}),
        _equivalent,
    ),
    "interval_contains": Rule(
        "the 95 % interval, widened by {tolerance}, contains the published value",
        frozenset({"published", "low", "high", "tolerance"}),
        _interval_contains,
    ),
    "standard_errors": Rule(
        "less than {limit} standard errors from the published value",
        frozenset({"published", "standard_error", "limit"}),
        _standard_errors,
    ),
}
