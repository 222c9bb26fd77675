"""When a statement of the paper holds on a path, and how shares of paths are counted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest

from pipeline.studies.factors.shares import (
    ALL,
    Spreads,
    interval,
    joined,
    needed_speed,
    path_table,
    share_table,
    statements,
)
from pipeline.studies.published import Published

PUBLISHED = Published(0.25, 0.1, 18.0, np.diag([1.0, 4.0, 9.0]) * 1e-6)  # spreads 1, 2, 3 mrad
NAMES = {"factorisation": ["lu", "qr"], "rows": ["x z φ"] * 2, "joints": ["1-2-3"] * 2}
GAP = np.nan
SUBSETS = {"one": np.array([True, False]), "other": np.array([False, True])}


def spreads(*wishart, gaussian=2e-3) -> Spreads:
    """One path, a row a reading, in mrad."""
    values = np.array(wishart, dtype=float)[:, None] * 1e-3
    return Spreads(*np.array([[0.17], [15.0], [1.0], [gaussian]]), values)


@pytest.mark.parametrize(
    ("wishart", "holding"),
    [
        ((1.5, 2.5, 2.2), {"alike", "wider", "short", "size", "but_wider", "but_size", "all"}),
        ((1.5, 2.0, 2.2), {"alike", "short", "size", "but_wider"}),
        ((1.5, 2.5, 3.1), {"alike", "wider", "size"}),
        ((2.5, 2.0, 2.2), {"alike", "wider", "short", "but_size"}),
        ((0.9, 4.1, 2.9), {"wider", "short"}),
        ((GAP, GAP, GAP), set()),
    ],
)
def test_a_statement_holds_where_the_spreads_say_so(wishart, holding):
    held = statements(spreads(wishart), np.ones(1), PUBLISHED, 2.0)
    assert {name for name, holds in held.items() if holds.item()} == holding


def test_what_hangs_on_the_speed_does_and_the_ratio_does_not():
    fast, slow = (
        statements(spreads((1.5, 2.5, 2.2)), np.full(1, s), PUBLISHED, 2.0) for s in (1, 0.3)
    )
    assert [bool(slow[name].item()) for name in ("alike", "wider", "short", "size")] == [
        True,
        True,
        True,
        False,
    ]
    assert fast["size"].item()


def test_the_needed_speed_gives_the_gaussian_model_the_recorded_trace_rest_included():
    for rest in (0.0, 0.5):
        speed = needed_speed(spreads((1, 1, 1)), PUBLISHED, rest)
        trace = 3 * (1 - rest) * (speed * 2e-3) ** 2
        np.testing.assert_allclose(trace, np.trace(PUBLISHED.covariance))


@pytest.mark.parametrize(("hits", "trials"), [(0, 5), (3, 5), (5, 5), (1, 20_000)])
def test_the_interval_is_wilsons(hits, trials):
    reference = binomtest(hits, trials).proportion_ci(0.95, method="wilson")
    np.testing.assert_allclose(interval(hits, trials), reference, atol=1e-12)


def test_no_trials_say_nothing():
    assert interval(0, 0) == (0.0, 1.0)


def test_the_table_counts_paths_that_are_driven_and_those_with_a_small_pivot():
    """The first path needs a speed of 1.08; the second, with half the noise, of 2.16."""
    first = spreads((1.5, 2.5, 2.2), (9, 9, 9))
    second = spreads((GAP, GAP, GAP), (1, 1, 1), gaussian=1e-3)
    both = joined([first, second])
    rows = share_table(both, NAMES, PUBLISHED, 2.0, [0.0, 0.25], 1.1, SUBSETS)
    rows = rows.set_index(["subset", "rest", "speed", "factorisation"]).sort_index()
    lu = rows.xs("lu", level="factorisation")
    assert lu.loc[(ALL, 0.0, "limit"), ["paths", "small_pivot", "alike"]].tolist() == [2, 1, 0.5]
    assert lu.loc[(ALL, 0.0, "matched"), ["paths", "small_pivot", "alike"]].tolist() == [1, 0, 1]
    # with a quarter at rest the first needs 1.25
    assert lu.loc[(ALL, 0.25, "matched"), "paths"] == 0
    assert np.isnan(lu.loc[(ALL, 0.25, "matched"), "alike"])
    for subset, count in {"one": 0, "other": 1}.items():
        assert lu.loc[(subset, 0.0, "limit"), "small_pivot"] == count
    qr = rows.xs("qr", level="factorisation").loc[(ALL, 0.0, "limit")]
    np.testing.assert_allclose(qr[["ratio_least", "ratio_greatest"]].tolist(), [1.0, 4.5])


def test_the_paths_table_says_how_fast_they_have_to_be():
    both = joined([spreads((1, 1, 1)), spreads((1, 1, 1), gaussian=1e-3)])
    row = path_table(both, PUBLISHED, [0.0], 1.1, 10).iloc[0]
    assert row[["drawn", "paths", "within_speed"]].tolist() == [10, 2, 1]
    np.testing.assert_allclose(row["speed_median"], 1.5 * row["speed_least"])
