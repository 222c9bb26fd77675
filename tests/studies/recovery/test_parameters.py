"""The recovery study: truths of the recorded size, biases that are known in closed form, and
coverages that tell a wrong interval.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.models.kinds import build_model, estimate, options_type, truths
from pipeline.models.steps import Recorded, Truth
from pipeline.studies.recovery.parameters import recover, recovery_table, thinned

COVARIANCE = np.array([[2.5, -3.5, 1.5], [-3.5, 8.0, -3.5], [1.5, -3.5, 17.0]]) * 1e-5
MEASUREMENT = 0.4 * COVARIANCE
ADDITIVE = options_type("additive")("additive", estimator="paper")
SHRINKAGE = options_type("additive")("additive", estimator="shrinkage")
GAUSSIAN = options_type("gaussian")("gaussian", estimator="likelihood")
SCALED = [
    options_type("scaled")("scaled", structure=structure) for structure in ("diagonal", "full")
]


@pytest.fixture(scope="module")
def recorded(chain, poses, step) -> Recorded:
    """Thirty takes of twelve steps, of which two rest."""
    v = np.linspace(0.3, 1.0, 12)[:, None] * step
    v[:2] = 0.0
    noise = np.random.default_rng(1).multivariate_normal(np.zeros(3), COVARIANCE, (30, 12))
    return Recorded(chain, np.tile(poses[:12], (30, 1, 1)), v, noise, ("a", "b", "c"), MEASUREMENT)


def table(recorded, options, datasets: int):
    (truth,) = truths(recorded, options, [0.25])
    trials = [
        recover(recorded, truth, options, np.random.default_rng([2, number]))
        for number in range(datasets)
    ]
    return recovery_table(truth, trials).set_index("parameter")


@pytest.mark.parametrize(
    "options",
    [ADDITIVE, GAUSSIAN, *SCALED],
    ids=lambda options: getattr(options, "structure", options.kind),
)
def test_the_truth_has_the_recorded_variance(recorded, options):
    (truth,) = truths(recorded, options, [])
    mean = (
        build_model(truth.parameters)
        .covariance(recorded.chain, recorded.q, np.broadcast_to(recorded.v, recorded.q.shape))
        .mean(axis=(0, 1))
    )
    covariance = truths(recorded, ADDITIVE, [])[0].parameters["noise_covariance"]
    np.testing.assert_allclose(np.trace(mean), np.trace(covariance), rtol=1e-9)
    if options.kind == "additive":
        np.testing.assert_allclose(mean, covariance, rtol=1e-9)


@pytest.mark.parametrize(
    "options",
    [ADDITIVE, GAUSSIAN, *SCALED],
    ids=lambda options: getattr(options, "structure", options.kind),
)
def test_the_truths_names_are_the_estimators(recorded, options):
    (truth,) = truths(recorded, options, [])
    assert set(truth.values) == set(estimate(recorded, options).estimates)


def test_of_the_wishart_model_every_dispersion_is_drawn(recorded):
    drawn = truths(
        recorded,
        options_type("wishart")("wishart", estimator="likelihood", decomposition="qr"),
        [0.1, 0.5],
    )
    assert [(truth.label, truth.parameters["decomposition"], truth.values) for truth in drawn] == [
        ("wishart 0.1", "qr", {"sigma_b": 0.1}),
        ("wishart 0.5", "qr", {"sigma_b": 0.5}),
    ]


def test_the_mean_covariance_is_off_by_the_measurement_noise_and_the_other_estimator_is_not(
    recorded,
):
    variances = [f"sigma_omega_{j}{j}_rad2" for j in (1, 2, 3)]
    paper, shrunk = (
        table(recorded, options, 60).loc[variances] for options in (ADDITIVE, SHRINKAGE)
    )
    share = np.diag(MEASUREMENT) / paper["truth"]
    assert np.all(
        np.abs(paper["relative_bias"] - share) < 4 * paper["relative_bias_standard_error"]
    )
    assert np.all(paper["relative_bias"] > 8 * paper["relative_bias_standard_error"])
    assert np.all(paper["coverage"] < 0.6)
    # what shrinking costs is far below that
    assert np.all(np.abs(shrunk["relative_bias"]) < 0.1) and np.all(shrunk["coverage"] > 0.8)


@pytest.mark.slow
def test_standard_errors_and_coverages_of_the_likelihoods_are_right(recorded):
    for options, name in ((SCALED[0], "std_at_rest_b_rad"), (GAUSSIAN, "noise_level")):
        result = table(recorded, options, 40)
        assert (
            abs(result.loc[name, "relative_bias"])
            < 4 * result.loc[name, "relative_bias_standard_error"]
        )
        assert (
            0.65
            < result.loc[name, "bootstrap_standard_error"] / result.loc[name, "standard_deviation"]
            < 1.5
        )
        assert result.loc[name, "coverage"] > 0.82


@pytest.mark.parametrize(("size", "low", "high"), [(1.0, 0.92, 0.98), (0.5, 0.6, 0.75)])
def test_the_coverage_is_that_of_intervals_of_the_replicates_size(size, low, high):
    """Half as wide as they should be, normal intervals hold the truth in 67 % of the cases."""
    rng = np.random.default_rng(3)
    estimates = 2 + rng.standard_normal(1000)
    trials = [({"a": value}, {"a": value + size * rng.standard_normal()}) for value in estimates]
    (row,) = recovery_table(Truth("any", {}, {"a": 2.0}), [*trials, None]).to_dict("records")
    assert low < row["coverage"] < high
    assert row["datasets"] == 1000 and row["without_an_estimate"] == 1
    assert row["bootstrap_standard_error"] == pytest.approx(size, rel=0.08) and row[
        "standard_deviation"
    ] == pytest.approx(1.0, rel=0.08)
    assert row["relative_bias"] == pytest.approx((estimates.mean() - 2) / 2)


def test_data_that_give_no_estimate_are_left_out_and_too_few_make_no_row():
    truth = Truth("any", {}, {"a": 2.0})
    assert (
        recovery_table(truth, [None, None]).empty
        and recovery_table(truth, [({"a": 1.0}, {"a": 1.0}), None]).empty
    )


def test_thinned_recordings_keep_the_measurement_noise_of_all(recorded):
    part = thinned(recorded, 5, 3)
    np.testing.assert_array_equal(part.q, recorded.q[:5, ::3])
    np.testing.assert_array_equal(part.q_next, recorded.q_next[:5, ::3])
    np.testing.assert_array_equal(part.measurement, MEASUREMENT)


def test_an_estimate_that_some_data_sets_lack_is_judged_by_the_others():
    truth = Truth("any", {}, {"spread": 2.0, "correlation": 0.5})
    trials = [({"spread": 2.0 + 0.1 * n}, {"spread": 2.0}) for n in range(-1, 2)]
    trials += [
        ({"spread": 2.0, "correlation": 0.5 + 0.1 * n}, {"spread": 2.0, "correlation": 0.5})
        for n in (-1, 1)
    ]
    rows = recovery_table(truth, [*trials, None]).set_index("parameter")
    assert rows.loc["spread", ["datasets", "without_an_estimate"]].tolist() == [5, 1]
    assert rows.loc["correlation", ["datasets", "without_an_estimate"]].tolist() == [2, 4]
    # control: one data set tells no spread
    assert "correlation" not in recovery_table(truth, trials[:4])["parameter"].to_list()
