"""Rules that decide the cases of a claim, with the probability of an error stated.

A rule returns two probabilities for each case: of evidence at least as strong *for* the claim if
the claim is just wrong, and *against* it if the claim is just true. A number without an interval
has 0 or 1. A claim is refuted if one of its n cases is refuted after Holm's correction over the n
cases (Holm 1979), and holds if every case holds (an intersection-union test, Berger 1982, which
needs no correction). Any other claim has no evidence.

"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy import nan, ndarray
from scipy.special import stdtr

from pipeline.core.typed_yaml import read_yaml
from pipeline.statistics.curves import POWER
from pipeline.statistics.takes import NORMAL_QUANTILE

# probability of a false verdict on one side, as of a two-sided 95 % interval
LEVEL = 0.025
MOST_DEGREES = 1e6  # Student's law with as many is normal


class Cases(NamedTuple):
    """Numbers (cases,) of a claim; a number that the claim lacks is NaN.

    ``value`` is the run's number, ``than`` the number compared with. ``low`` and ``high`` are the
    95 % interval of the value, or for an order and an equivalence of the ``difference`` value −
    than; ``standard_error`` and ``degrees`` of freedom belong to it, else the interval is taken as
    normal. ``threshold``, ``power`` and ``speed_power`` (against the speed law) belong to a test of
    the run. ``control`` is the value of a control without the claimed effect. The claim states
    ``published``, ``tolerance``, ``limit`` and ``margin``; ``yardstick`` is the published value or
    the limit, ``distance`` is (published − value) in standard errors.
    """

    value: ndarray
    than: ndarray = nan
    difference: ndarray = nan
    low: ndarray = nan
    high: ndarray = nan
    threshold: ndarray = nan
    power: ndarray = nan
    speed_power: ndarray = nan
    control: ndarray = nan
    standard_error: ndarray = nan
    degrees: ndarray = nan
    published: ndarray = nan
    tolerance: ndarray = nan
    limit: ndarray = nan
    margin: ndarray = nan
    yardstick: ndarray = nan
    distance: ndarray = nan


Judge = Callable[[Cases], tuple[ndarray, ndarray]]  # probabilities for and against


def standard_errors(r: Cases, side: int = 0) -> ndarray:
    """Return the standard error of the estimate of each case; 0 for an estimate without one and
    without an interval. An interval without a standard error may be skew: ``side`` 1 is its part
    above the value, −1 the part below.
    """
    half = (r.high - r.low) / 2
    if side > 0:
        half = r.high - r.value
    elif side < 0:
        half = r.value - r.low
    error = np.where(
        np.isnan(r.standard_error),
        half / NORMAL_QUANTILE,
        r.standard_error,
    )
    return np.nan_to_num(error)


def beyond(distance: ndarray, r: Cases, side: int = 0) -> tuple[ndarray, ndarray]:
    """Return the probabilities for and against ``distance`` > 0, an estimate with the standard
    error of the case on ``side``; 0 or 1 where it has none.
    """
    error = standard_errors(r, side)
    exact = error == 0
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(error > 0, distance / error, np.copysign(np.inf, distance))
    t = np.clip(t, -1e9, 1e9)
    t[np.isnan(distance)] = np.nan

    degrees = np.where(np.isnan(r.degrees), MOST_DEGREES, r.degrees)
    supports = stdtr(degrees, -t)
    supports[exact] = distance[exact] <= 0
    refutes = stdtr(degrees, t)
    refutes[exact] = distance[exact] > 0
    return supports, refutes


def _order(sign: float) -> Judge:
    """Return the rule that the difference has the ``sign`` by more than the margin."""

    def judge(r: Cases) -> tuple[ndarray, ndarray]:
        margin = np.nan_to_num(r.margin)
        supports, _ = beyond(sign * r.difference - margin, r)
        refutes, _ = beyond(-sign * r.difference - margin, r)
        return _with_interval(r, supports), _with_interval(r, refutes)

    return judge


def _sure(holds: ndarray, fails: ndarray) -> tuple[ndarray, ndarray]:
    return np.where(holds, 0.0, 1.0), np.where(fails, 0.0, 1.0)


def _within(r: Cases, tolerance: ndarray, distance: ndarray) -> tuple[ndarray, ndarray]:
    return beyond(tolerance - abs(distance), r)


def _close(r: Cases) -> tuple[ndarray, ndarray]:
    """Return the rule that the difference is within ± the margin, by its interval."""
    supports, refutes = _within(r, r.margin, r.difference)
    return _with_interval(r, supports), _with_interval(r, refutes)


def _with_interval(r: Cases, probabilities: ndarray) -> ndarray:
    """Return ``probabilities``, 1 for a difference without an interval, which decides nothing."""
    return np.where(np.isnan(r.low + r.high), 1.0, probabilities)


def _detected(r: Cases) -> tuple[ndarray, ndarray]:
    """Return the p-values of the tests of no effect; an effect that is not detected may exist."""
    return r.value, np.ones(len(r.value))


def _varies(r: Cases) -> tuple[ndarray, ndarray]:
    """Return the rule that a standard deviation varies over time: over the takes at each step, or
    in the takes between slow and fast steps, of which ``difference`` is the logarithm of the ratio.
    A single run has no ``threshold`` over takes. Its standard deviation is constant only if also
    the interval of the ``difference`` is within the margin.
    """
    by_speed, _ = beyond(np.abs(r.difference) - r.margin, r)
    by_speed[np.isnan(r.difference + r.low + r.high)] = 1.0
    over_takes = r.value > r.threshold
    supports = np.where(over_takes, 0.0, by_speed)

    single_run = np.isnan(r.threshold)
    within_margin = (-r.low < r.margin) & (r.high < r.margin)
    constant = (r.value < r.than) & (by_speed > LEVEL)
    constant &= within_margin | ~single_run
    return supports, np.where(constant, 0.0, 1.0)


def _follows(r: Cases) -> tuple[ndarray, ndarray]:
    powerful = r.power >= POWER
    above = r.value >= r.threshold
    return _sure(powerful & above, powerful & ~above)


def _decreasing(r: Cases) -> tuple[ndarray, ndarray]:
    falls = np.diff(r.value, prepend=np.inf) < 0
    return _sure(falls, ~falls)


def _interval_contains(r: Cases) -> tuple[ndarray, ndarray]:
    above_low = r.low - r.tolerance <= r.published
    contains = above_low & (r.published <= r.high + r.tolerance)
    return _sure(contains, ~contains)


JUDGES: dict[str, Judge] = {
    "within_relative": lambda r: _within(
        r,
        r.tolerance * abs(r.published),
        r.value - r.published,
    ),
    "within_absolute": lambda r: _within(r, r.tolerance, r.value - r.published),
    "below": lambda r: beyond(r.yardstick - r.value, r, 1),
    "above": lambda r: beyond(r.value - r.yardstick, r, -1),
    "detected": _detected,
    "varies": _varies,
    "follows": _follows,
    "less": _order(-1.0),
    "greater": _order(1.0),
    "close": _close,
    "decreasing": _decreasing,
    "equivalent": lambda r: _within(r, r.tolerance * abs(r.than), r.difference),
    "interval_contains": _interval_contains,
    "standard_errors": lambda r: _sure(
        abs(r.distance) < r.limit,
        abs(r.distance) >= r.limit,
    ),
}


class Rule(NamedTuple):
    """Keys of a claim that a rule ``needs``, its judge, and keys that it takes as ``options``."""

    needs: set[str]
    judge: Judge
    options: set[str] = frozenset()


WORDED = read_yaml(Path(__file__).with_name("rules.yaml"))
RULES = {
    name: Rule({*WORDED[name]["needs"]}, judge, {*WORDED[name].get("options", ())})
    for name, judge in JUDGES.items()
}


def decide_cases(rule: Rule, r: Cases, evident: ndarray) -> list[bool | None]:
    """Return for each case of ``r`` whether it holds, None if the rule does not decide it or the
    case is not ``evident``. A case that the control passes too does not hold: the rule has no power
    to confirm it. It fails all the same.
    """
    with np.errstate(invalid="ignore"):
        supports, refutes = rule.judge(r)
        holds = evident & (np.nan_to_num(supports, nan=1.0) <= LEVEL)
        controlled = ~np.isnan(r.control)
        if controlled.any():
            exact = {"low": nan, "high": nan, "standard_error": nan, "degrees": nan}
            of_control, _ = rule.judge(r._replace(value=r.control, **exact))
            holds &= ~(controlled & (of_control <= LEVEL))
    refutes = np.where(evident, np.nan_to_num(refutes, nan=1.0), 1.0)
    fails = holm(refutes) & evident
    verdicts = np.where(holds, True, None)
    verdicts[fails] = False
    return list(verdicts)


def holm(probabilities: ndarray) -> ndarray:
    """Return which of the hypotheses of a claim are rejected (Holm 1979)."""
    order = np.argsort(probabilities)
    count = len(probabilities)
    hypotheses_left = count - np.arange(count)
    small = probabilities[order] * hypotheses_left <= LEVEL
    rejected = np.zeros(count, dtype=bool)
    rejected[order] = np.logical_and.accumulate(small)
    return rejected
