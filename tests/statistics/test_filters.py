"""No filter among the filters: what it says of the test takes, and the tables that all are held
against it by.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.filters import MEMORY, NONE, closed, models_of
from pipeline.statistics.filters import Filtered, filter_tables, no_filter

JOINTS = ("hip", "knee")
STEPS = 100
STEADY = np.ones(STEPS - 1, dtype=bool)


@pytest.fixture
def takes() -> tuple[np.ndarray, np.ndarray]:
    """Training and test takes (takes, STEPS, 2) of one law, whose spread grows over the steps."""
    rng = np.random.default_rng(1)
    std = np.linspace(0.01, 0.03, STEPS)[:, None] * [1.0, 2.0]
    middle = np.sin(np.arange(STEPS))[:, None]
    return tuple(middle + std * rng.standard_normal((count, STEPS, 2)) for count in (200, 60))


def test_without_a_filter_the_training_takes_predict_the_test_takes_as_they_say(takes):
    training, measured = takes
    none = no_filter(training, measured)
    np.testing.assert_allclose(none.error, training.mean(axis=0) - measured)
    np.testing.assert_allclose(none.covariance[7, 30], np.cov(training[:, 30].T))
    assert np.mean(np.abs(none.error) <= none.bound) == pytest.approx(0.683, abs=0.02)
    assert not none.measurement.any()


def test_filters_are_held_against_the_first_model_and_against_none(takes):
    training, measured = takes
    none, rng = no_filter(training, measured), np.random.default_rng(2)
    pose = 1e-4 * np.eye(2)
    worse = Filtered(2 * none.error, 4 * none.covariance, pose)
    better = Filtered(0.5 * none.error, 0.25 * none.covariance, 0 * pose)
    filters = {NONE: none, MEMORY: better, "lag": worse, "drift": worse, closed("lag"): better}
    tables, refusals = filter_tables(filters, JOINTS, STEADY, rng)
    assert refusals == [] and models_of(filters) == ["lag", "drift"]
    against = tables["filter_against_none"].set_index(["model", "score"])
    assert list(tables["filter_scores"]["model"])[::2] == list(filters)
    assert against.loc[("lag", "log_score"), "high"] < 0
    assert against.loc[("lag_closed", "log_score"), "low"] > 0
    assert against.loc[("lag_closed", "rms_error_knee_rad"), "high"] < 0
    assert np.isnan(against.loc[(NONE, "log_score"), "difference"])
    compared = tables["filter_comparison"].set_index(["model", "score"])
    assert compared.loc[("drift", "log_score"), "difference"] == 0
    assert compared.loc[(NONE, "log_score"), "low"] > 0
    assert set(tables["bound_comparison"]["model"]) == {"lag", "drift"}


def test_too_few_training_takes_for_a_density_are_said(takes):
    training, measured = takes
    none = no_filter(training[:2], measured)
    tables, refusals = filter_tables(
        {NONE: none, "lag": Filtered(none.error, none.covariance + np.eye(2), 0 * np.eye(2))},
        JOINTS,
        STEADY,
        np.random.default_rng(3),
    )
    assert refusals and refusals[0].startswith("the posterior of none is not scored")
    scores = tables["filter_against_none"].set_index(["model", "score"])["mean"]
    assert np.isnan(scores[(NONE, "log_score")]) and np.isfinite(scores[("lag", "log_score")])
