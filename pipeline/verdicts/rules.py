"""Rules that decide claims: a closed set, each a function of a claim's readings that says in which
of its cases it holds and in which it decides at all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

LEAST_POWER = 0.8  # of a test that is evidence, pipeline.statistics.curves.POWER


@dataclass(frozen=True)
class Readings:
    """Values that a rule compares, each (cases,) and NaN where a claim has none.

    ``value`` is ours, ``than`` the other value of an order, ``low`` and ``high`` an interval of the
    value, or of the difference ``value − than`` of an order; ``threshold`` and ``power`` belong to
    a test of the run's own, ``standard_error`` to the distance from the published value.
    ``tolerance`` and ``limit`` are the claim's own.
    """

    value: np.ndarray
    than: np.ndarray
    low: np.ndarray
    high: np.ndarray
    threshold: np.ndarray
    power: np.ndarray
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


def _always(readings: Readings) -> np.ndarray:
    return np.ones(len(readings.value), dtype=bool)


def _without_zero(readings: Readings) -> np.ndarray:
    return (readings.low > 0) | (readings.high < 0)


@dataclass(frozen=True)
class Rule:
    """A rule in ``words``, the keys of a claim that it ``needs``, the cases in which it ``holds``,
    and those that it ``decides``: an order whose interval covers zero is not decided.
    """

    words: str
    needs: frozenset[str]
    holds: Callable[[Readings], np.ndarray]
    decides: Callable[[Readings], np.ndarray] = _always


def _within_relative(r: Readings) -> np.ndarray:
    return np.abs(r.value - r.published) <= r.tolerance * np.abs(r.published)


def _equivalent(r: Readings) -> np.ndarray:
    margin = r.tolerance * np.abs(r.than)
    return (r.low > -margin) & (r.high < margin)


def _interval_contains(r: Readings) -> np.ndarray:
    return (r.low - r.tolerance <= r.published) & (r.published <= r.high + r.tolerance)


RULES = {
    "within_relative": Rule(
        "within a share {tolerance} of the published value",
        frozenset({"published", "tolerance"}),
        _within_relative,
    ),
    "within_absolute": Rule(
        "within ±{tolerance} of the published value",
        frozenset({"published", "tolerance"}),
        lambda r: np.abs(r.value - r.published) <= r.tolerance,
    ),
    "below": Rule("below {yardstick}", frozenset({"yardstick"}), lambda r: r.value < r.yardstick),
    "above": Rule("above {yardstick}", frozenset({"yardstick"}), lambda r: r.value > r.yardstick),
    "varies": Rule(
        "above {limit} and above the 95 % quantile of constant noise in as many takes",
        frozenset({"limit", "threshold"}),
        lambda r: r.value > r.limit,
        lambda r: (r.value <= r.limit) | (r.value > r.threshold),
    ),
    "follows": Rule(
        f"at least the limit that a true model reaches, at a power of {LEAST_POWER:g} or more "
        "against constant noise",
        frozenset({"threshold", "power"}),
        lambda r: r.value >= r.threshold,
        lambda r: r.power >= LEAST_POWER,
    ),
    "less": Rule(
        "less than the value it is compared with; no verdict if the 95 % interval of the "
        "difference covers zero",
        frozenset({"than"}),
        lambda r: r.high < 0,
        _without_zero,
    ),
    "greater": Rule(
        "greater than the value it is compared with; no verdict if the 95 % interval of the "
        "difference covers zero",
        frozenset({"than"}),
        lambda r: r.low > 0,
        _without_zero,
    ),
    "decreasing": Rule(
        "less from case to case",
        frozenset(),
        lambda r: np.diff(r.value, prepend=np.inf) < 0,
    ),
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
        lambda r: np.abs(r.distance) < r.limit,
    ),
}
ORDERS = ("less", "greater")  # rules that need an interval of the difference
