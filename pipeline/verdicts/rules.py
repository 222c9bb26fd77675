"""Rules that decide claims: a closed set, each a function of a table with a row a case.

Columns of the table are NaN where a claim has none: ``value`` is ours, ``than`` the other value of
an order, ``low`` and ``high`` an interval of the value, or of the difference ``value − than`` of an
order; ``threshold`` and ``power`` belong to a test of the run's own; ``published``, ``tolerance``
and ``limit`` are the claim's, ``yardstick`` is the published value or the limit, ``distance`` is
(published − value)/``standard_error``.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core.typed_yaml import read_yaml

LEAST_POWER = 0.8  # of a test that is evidence, pipeline.statistics.curves.POWER
ENDS = {"low", "high"}
ORDERS = ("less", "greater")  # rules that need an interval of the difference
Judge = Callable[[pd.DataFrame], pd.Series]


class Rule(NamedTuple):
    """A rule in ``words``, the keys of a claim that it ``needs``, the cases in which it ``holds``
    and those that it ``decides``: an order whose interval covers zero is not decided.
    """

    words: str
    needs: set[str]
    holds: Judge
    decides: Judge


HOLDS: dict[str, Judge] = {
    "within_relative": lambda r: (r.value - r.published).abs() <= r.tolerance * r.published.abs(),
    "within_absolute": lambda r: (r.value - r.published).abs() <= r.tolerance,
    "below": lambda r: r.value < r.yardstick,
    "above": lambda r: r.value > r.yardstick,
    "varies": lambda r: r.value > r.limit,
    "follows": lambda r: r.value >= r.threshold,
    "less": lambda r: r.high < 0,
    "greater": lambda r: r.low > 0,
    "decreasing": lambda r: pd.Series(np.diff(r.value, prepend=np.inf) < 0, r.index),
    "equivalent": lambda r: np.maximum(-r.low, r.high) < r.tolerance * r.than.abs(),
    "interval_contains": lambda r: (
        (r.low - r.tolerance <= r.published) & (r.published <= r.high + r.tolerance)
    ),
    "standard_errors": lambda r: r.distance.abs() < r.limit,
}
DECIDES: dict[str, Judge] = dict.fromkeys(HOLDS, lambda r: r.value.notna()) | {
    **dict.fromkeys(ORDERS, lambda r: (r.low > 0) | (r.high < 0)),
    "varies": lambda r: (r.value <= r.limit) | (r.value > r.threshold),
    "follows": lambda r: r.power >= LEAST_POWER,
}
RULES = {
    name: Rule(rule["words"], {*rule["needs"]}, HOLDS[name], DECIDES[name])
    for name, rule in read_yaml(Path(__file__).with_name("rules.yaml")).items()
}
