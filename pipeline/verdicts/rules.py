"""Rules that decide claims: a closed set, each a function of a table with a row a case."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd

LEAST_POWER = 0.8  # of a test that is evidence, pipeline.statistics.curves.POWER
Judge = Callable[[pd.DataFrame], pd.Series]
ENDS = {"low", "high"}


class Rule(NamedTuple):
    """A rule in ``words``, the keys of a claim that it ``needs``, the cases in which it ``holds``
    and those that it ``decides``: an order whose interval covers zero is not decided.

    Columns of the judged table are NaN where a claim has none: ``value`` is ours, ``than`` the
    other value of an order, ``low`` and ``high`` an interval of the value, or of the difference
    ``value − than`` of an order; ``threshold`` and ``power`` belong to a test of the run's own;
    ``published``, ``tolerance`` and ``limit`` are the claim's, ``yardstick`` is the published value
    or the limit, ``distance`` is (published − value)/``standard_error``.
    """

    words: str
    needs: set[str]
    holds: Judge
    decides: Judge = lambda r: pd.Series(True, r.index)


def _without_zero(r: pd.DataFrame) -> pd.Series:
    return (r.low > 0) | (r.high < 0)


def _equivalent(r: pd.DataFrame) -> pd.Series:
    margin = r.tolerance * r.than.abs()
    return (r.low > -margin) & (r.high < margin)


COVERS = "no verdict if the 95 % interval of the difference covers zero"
RULES = {
    "within_relative": Rule(
        "within a share {tolerance} of the published value",
        {"published", "tolerance"},
        lambda r: (r.value - r.published).abs() <= r.tolerance * r.published.abs(),
    ),
    "within_absolute": Rule(
        "within ±{tolerance} of the published value",
        {"published", "tolerance"},
        lambda r: (r.value - r.published).abs() <= r.tolerance,
    ),
    "below": Rule("below {yardstick}", {"yardstick"}, lambda r: r.value < r.yardstick),
    "above": Rule("above {yardstick}", {"yardstick"}, lambda r: r.value > r.yardstick),
    "varies": Rule(
        "above {limit} and above the 95 % quantile of constant noise in as many takes",
        {"limit", "threshold"},
        lambda r: r.value > r.limit,
        lambda r: (r.value <= r.limit) | (r.value > r.threshold),
    ),
    "follows": Rule(
        f"at least the limit that a true model reaches, at a power of {LEAST_POWER:g} or more "
        "against constant noise",
        {"threshold", "power"},
        lambda r: r.value >= r.threshold,
        lambda r: r.power >= LEAST_POWER,
    ),
    "less": Rule(
        f"less than the value it is compared with; {COVERS}",
        {"than"},
        lambda r: r.high < 0,
        _without_zero,
    ),
    "greater": Rule(
        f"greater than the value it is compared with; {COVERS}",
        {"than"},
        lambda r: r.low > 0,
        _without_zero,
    ),
    "decreasing": Rule(
        "less from case to case",
        set(),
        lambda r: pd.Series(np.diff(r.value, prepend=np.inf) < 0, r.index),
    ),
    "equivalent": Rule(
        "the 95 % interval of the difference within ± a share {tolerance} of the value compared "
        "with",
        {"than", "tolerance"} | ENDS,
        _equivalent,
    ),
    "interval_contains": Rule(
        "the 95 % interval, widened by {tolerance}, contains the published value",
        {"published", "tolerance"} | ENDS,
        lambda r: (r.low - r.tolerance <= r.published) & (r.published <= r.high + r.tolerance),
    ),
    "standard_errors": Rule(
        "less than {limit} standard errors from the published value",
        {"published", "standard_error", "limit"},
        lambda r: r.distance.abs() < r.limit,
    ),
}
ORDERS = ("less", "greater")  # rules that need an interval of the difference
