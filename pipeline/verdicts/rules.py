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
from scipy.special import stdtr, stdtrit

from pipeline.core.typed_yaml import read_yaml
from pipeline.statistics.curves import POWER
from pipeline.statistics.takes import NORMAL_QUANTILE, TAILS

LEVEL = (
    0.025  # probability of a false verdict on one side, as of a two-sided 95 % interval
)
MOST_DEGREES = 200  # Student's law with more is taken as normal


class Cases(NamedTuple):
    """Numbers (cases,) of a claim; a number that the claim lacks is NaN.

    ``value`` is the run's number, ``than`` the number compared with. ``low`` and ``high`` are the
    95 % interval of the value, or for an order and an equivalence of the ``difference`` value −
    than; ``standard_error`` belongs to it, else the interval is taken as normal. ``threshold`` and
    ``power`` belong to a test of the run. ``control`` is the value of a control without the claimed
    effect. The claim states ``published``, ``tolerance``, ``limit`` and ``margin``; ``yardstick``
    is the published value or the limit, ``distance`` is (published − value) in standard errors.
    """

    value: ndarray
    than: ndarray = nan
    difference: ndarray = nan
    low: ndarray = nan
    high: ndarray = nan
    threshold: ndarray = nan
    power: ndarray = nan
    control: ndarray = nan
    standard_error: ndarray = nan
    published: ndarray = nan
    tolerance: ndarray = nan
    limit: ndarray = nan
    margin: ndarray = nan
    yardstick: ndarray = nan
    distance: ndarray = nan


Judge = Callable[[Cases], tuple[ndarray, ndarray]]  # probabilities for and against


def standard_errors(r: Cases, side: int = 0) -> tuple[ndarray, ndarray]:
    """Return the standard error of the estimate of each case and its degrees of freedom, from the
    interval; 0 for an estimate without an interval. An interval without a standard error may be
    skew: ``side`` 1 is its part above the value, −1 the part below.
    """
    half = (r.high - r.low) / 2
    if side:
        part = r.high - r.value if side > 0 else r.value - r.low
        half = np.where(np.isnan(r.standard_error), part, half)
    error = np.where(
        np.isnan(r.standard_error), half / NORMAL_QUANTILE, r.standard_error
    )
    degrees = np.append(np.arange(1.0, MOST_DEGREES + 1), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(error > 0, half / error, NORMAL_QUANTILE)
    first = np.searchsorted(-stdtrit(degrees[:-1], TAILS[1]), -1.001 * ratio)
    return np.nan_to_num(error), degrees[first]


def beyond(distance: ndarray, r: Cases, side: int = 0) -> tuple[ndarray, ndarray]:
    """Return the probabilities for and against ``distance`` > 0, an estimate with the standard
    error of the case on ``side``; 0 or 1 where it has none.
    """
    error, degrees = standard_errors(r, side)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(error > 0, distance / error, np.copysign(np.inf, distance))
    t = np.where(np.isnan(distance), np.nan, np.clip(t, -1e9, 1e9))
    freedom = np.minimum(degrees, 1e6)
    exact = error == 0
    probability = np.where(exact, distance <= 0, stdtr(freedom, -t))
    return probability, np.where(exact, distance > 0, stdtr(freedom, t))


def _order(sign: float) -> Judge:
    """Return the rule that the difference has the ``sign`` by more than the margin."""

    def judge(r: Cases) -> tuple[ndarray, ndarray]:
        margin = np.nan_to_num(r.margin)
        without = np.isnan(
            r.low + r.high
        )  # a difference without an interval decides nothing
        sides = (beyond(side * r.difference - margin, r)[0] for side in (sign, -sign))
        supports, refutes = (
            np.where(without, 1.0, probability) for probability in sides
        )
        return supports, refutes

    return judge


def _sure(holds: ndarray, fails: ndarray) -> tuple[ndarray, ndarray]:
    return np.where(holds, 0.0, 1.0), np.where(fails, 0.0, 1.0)


def _within(r: Cases, tolerance: ndarray, distance: ndarray) -> tuple[ndarray, ndarray]:
    return beyond(tolerance - abs(distance), r)


def _falls(r: Cases) -> ndarray:
    return np.diff(r.value, prepend=np.inf) < 0


def _contains(r: Cases) -> ndarray:
    return (r.low - r.tolerance <= r.published) & (r.published <= r.high + r.tolerance)


def _greatest_below(r: Cases) -> tuple[ndarray, ndarray]:
    """Return P(greatest ≥ yardstick) and P(greatest < yardstick) of a repeat by Gumbel's law, from
    mean ``than`` and standard deviation ``standard_error`` of the greatest values of the repeats.
    """
    scale = r.standard_error * np.sqrt(6) / np.pi
    below = np.exp(-np.exp(-((r.yardstick - r.than) / scale + np.euler_gamma)))
    return 1 - below, below


JUDGES: dict[str, Judge] = {
    "within_relative": lambda r: _within(
        r, r.tolerance * abs(r.published), r.value - r.published
    ),
    "within_absolute": lambda r: _within(r, r.tolerance, r.value - r.published),
    "below": lambda r: beyond(r.yardstick - r.value, r, 1),
    "greatest_below": _greatest_below,
    "above": lambda r: beyond(r.value - r.yardstick, r, -1),
    "detected": lambda r: _sure(r.value > r.yardstick, np.zeros(len(r.value))),
    "varies": lambda r: _sure(r.value > r.threshold, r.value < r.than),
    "follows": lambda r: _sure(
        (r.power >= POWER) & (r.value >= r.threshold),
        (r.power >= POWER) & (r.value < r.threshold),
    ),
    "less": _order(-1.0),
    "greater": _order(1.0),
    "decreasing": lambda r: _sure(_falls(r), ~_falls(r)),
    "equivalent": lambda r: _within(r, r.tolerance * abs(r.than), r.difference),
    "interval_contains": lambda r: _sure(_contains(r), ~_contains(r)),
    "standard_errors": lambda r: _sure(
        abs(r.distance) < r.limit, abs(r.distance) >= r.limit
    ),
}


class Rule(NamedTuple):
    """The keys of a claim that a rule ``needs``, and its judge."""

    needs: set[str]
    judge: Judge


WORDED = read_yaml(Path(__file__).with_name("rules.yaml"))
RULES = {name: Rule({*WORDED[name]["needs"]}, judge) for name, judge in JUDGES.items()}


def decide_cases(rule: Rule, r: Cases, known: ndarray) -> list[bool | None]:
    """Return for each case of ``r`` whether it holds, None if the rule does not decide it or the
    case is not ``known``. A case that the control passes too does not hold: the rule has no power
    to confirm it. It fails all the same.
    """
    with np.errstate(invalid="ignore"):
        supports, refutes = rule.judge(r)
        held = known & (np.nan_to_num(supports, nan=1.0) <= LEVEL)
        if (controlled := ~np.isnan(r.control)).any():
            of_control, _ = rule.judge(
                r._replace(value=r.control, low=nan, high=nan, standard_error=nan)
            )
            held &= ~(controlled & (of_control <= LEVEL))
    refuted = holm(np.where(known, np.nan_to_num(refutes, nan=1.0), 1.0)) & known
    return [
        False if no else True if yes else None
        for yes, no in zip(held, refuted, strict=True)
    ]


def holm(probabilities: ndarray) -> ndarray:
    """Return which of the hypotheses of a claim are rejected (Holm 1979)."""
    order, count = np.argsort(probabilities), len(probabilities)
    passed = probabilities[order] * (count - np.arange(count)) <= LEVEL
    rejected = np.zeros(count, dtype=bool)
    rejected[order] = np.logical_and.accumulate(passed)
    return rejected
