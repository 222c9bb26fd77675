"""Scores against closed forms, quadrature and simulation, each with a law that it must tell from
the true one; and tables of the filters beside the training mean.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal, norm

from pipeline.core.errors import ModelDomainError
from pipeline.core.filters import MEMORY, NONE, closed, models_of
from pipeline.statistics.filters import (
    Filtered,
    bound_scores,
    filter_metrics,
    filter_scores,
    filter_tables,
    no_filter,
    sensor_scores,
)
from pipeline.statistics.scores import (
    compared,
    energy_score,
    log_determinant,
    nees,
    nees_band,
    normal_energy_score,
    normal_log_score,
    posterior_scores,
)
from pipeline.statistics.takes import paired_difference

COVARIANCE = np.array([[2.0, -0.9, 0.1], [-0.9, 1.5, 0.4], [0.1, 0.4, 0.8]])
ROOT = np.linalg.cholesky(COVARIANCE)
JOINTS = ("hip", "knee")
TAKES, STEPS = 30, 200


def crps(y: np.ndarray, sigma: float) -> np.ndarray:
    """Energy score of N(0, σ²) in one dimension (Gneiting & Raftery 2007, Eq. 21)."""
    z = y / sigma
    return sigma * (z * (2 * norm.cdf(z) - 1) + 2 * norm.pdf(z) - 1 / np.sqrt(np.pi))


@pytest.mark.parametrize("count", [2, 50])
def test_the_energy_score_of_few_samples_of_a_normal_law_is_the_closed_form_on_average(count):
    rng, repeats, sigma = np.random.default_rng(count), min(8000, 200_000 // count), 0.7
    outcome = np.array([-1.5, 0.0, 0.4, 3.0])
    samples = sigma * rng.standard_normal((count, repeats, 4, 1))
    scores = energy_score(samples, outcome[:, None])
    off = (scores.mean(axis=0) - crps(outcome, sigma)) / (scores.std(axis=0) / np.sqrt(repeats))
    assert np.abs(off).max() < 4
    # control: pairs of a sample with itself bias the score by E‖X − X′‖/2S
    assert (sigma / np.sqrt(np.pi) / count) / (scores.std(axis=0).max() / np.sqrt(repeats)) > 4


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_both_proper_scores_prefer_the_true_law(scale):
    rng, cases = np.random.default_rng(5), 2000
    outcome = rng.standard_normal((cases, 3)) @ ROOT.T
    samples = rng.standard_normal((50, cases, 3)) @ ROOT.T
    energy = paired_difference(*(energy_score(s * samples, outcome) for s in (scale, 1)))
    log = (normal_log_score(outcome, s**2 * COVARIANCE) for s in (scale, 1))
    logarithmic = paired_difference(*log)
    assert energy.low > 0 > logarithmic.high
    # control: the density itself is no proper score, and prefers a law too sure of itself
    density = [np.exp(normal_log_score(outcome, s**2 * COVARIANCE)) for s in (0.5, 1.0)]
    assert paired_difference(*density).low > 0


def test_the_normal_log_score_is_the_log_density_and_sharpness_its_log_determinant():
    errors = np.random.default_rng(6).standard_normal((20, 3))
    stacked = COVARIANCE * np.arange(1.0, 21)[:, None, None]
    pairs = zip(errors, stacked, strict=True)
    expected = [multivariate_normal(np.zeros(3), c).logpdf(e) for e, c in pairs]
    np.testing.assert_allclose(normal_log_score(errors, stacked), expected, rtol=1e-12)
    logarithm = np.log(np.linalg.eigvalsh(COVARIANCE)).sum()
    assert log_determinant(COVARIANCE) == pytest.approx(logarithm)


@pytest.mark.parametrize(
    "singular", [np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0]), np.diag([1.0, 1.0, -1.0])]
)
def test_what_is_no_covariance_has_no_score(singular):
    for score in (nees, normal_energy_score, normal_log_score):
        with pytest.raises(ModelDomainError, match="positive definite"):
            score(np.ones(3), singular)
    with pytest.raises(ModelDomainError, match="not positive"):
        log_determinant(singular)
    with pytest.raises(ModelDomainError, match="two samples"):
        energy_score(np.zeros((1, 4, 3)), np.zeros((4, 3)))


@pytest.mark.parametrize(("scale", "calibrated"), [(1.0, True), (1.15, False), (1 / 1.15, False)])
def test_the_nees_is_as_often_inside_as_stated_where_the_covariance_is_right(scale, calibrated):
    rng, repeats, cases = np.random.default_rng(7), 4000, 50
    error = rng.standard_normal((repeats, cases, 3)) @ ROOT.T
    low, high = nees_band(cases, 3)
    squared = nees(error, scale**2 * COVARIANCE)
    mean, bound = squared.mean(axis=1), 4 * np.sqrt(0.95 * 0.05 / repeats)
    assert (abs(np.mean((low <= mean) & (mean <= high)) - 0.95) < bound) == calibrated
    assert nees_band(1, 3) == pytest.approx(chi2.ppf([0.025, 0.975], 3))


@pytest.mark.parametrize("spread", [1.0, 1e-3, 30.0])
def test_the_energy_score_of_a_normal_law_is_that_of_its_draws(spread):
    rng = np.random.default_rng(31)
    root = rng.normal(size=(4, 3, 3)) * [1.0, 0.1, 0.5]
    covariance, error = root @ np.swapaxes(root, -1, -2), spread * rng.normal(size=(4, 3))
    draws = np.squeeze(root @ rng.standard_normal((20_000, 4, 3, 1)), -1)
    # the first mean from 20 000 draws, the second from pairs of them
    first = np.linalg.norm(draws - error, axis=-1)
    second = np.linalg.norm(draws[::2] - draws[1::2], axis=-1)
    errors = first.std(axis=0) / np.sqrt(20_000), second.std(axis=0) / np.sqrt(10_000) / 2
    standard_error = np.hypot(*errors)
    drawn = first.mean(axis=0) - second.mean(axis=0) / 2
    assert np.all(np.abs(normal_energy_score(error, covariance) - drawn) < 4 * standard_error)
    # control: of a law twice as wide
    wide = normal_energy_score(error, 4 * covariance)
    assert spread == 30.0 or np.all(np.abs(wide - drawn) > 4 * standard_error)


def test_the_energy_score_of_a_normal_law_in_one_direction_is_the_closed_form():
    sigma, x = 0.7, np.linspace(-3, 3, 7)
    scores = normal_energy_score(x[:, None], np.full((7, 1, 1), sigma**2))
    np.testing.assert_allclose(scores, crps(x, sigma), rtol=1e-9)


def test_an_honest_posterior_covers_as_it_says_in_every_joint_and_a_narrow_one_does_not():
    std = np.array([0.01, 0.03])
    error = std * np.random.default_rng(1).normal(size=(TAKES, STEPS, 2))
    covariance = np.tile(np.diag(std**2), (TAKES, STEPS, 1, 1))
    (honest, one), (narrow, two) = (
        posterior_scores(error, c * covariance, JOINTS) for c in (1, 0.25)
    )
    assert one is two is None
    for joint, rms in zip(JOINTS, std, strict=True):
        assert honest[f"rms_error_{joint}_rad"].mean() == pytest.approx(rms, rel=0.02)
        assert honest[f"coverage_of_one_sigma_{joint}"].mean() == pytest.approx(0.683, abs=0.02)
        assert narrow[f"coverage_of_one_sigma_{joint}"].mean() < 0.42
    assert honest["coverage_of_the_95_percent_region"].mean() == pytest.approx(0.95, abs=0.01)
    assert honest["nees"].mean() == pytest.approx(len(JOINTS), rel=0.05)
    table = compared({"honest": honest, "narrow": narrow}, "honest").set_index(["model", "score"])
    assert table.loc[("narrow", "log_score"), "high"] < 0


FRAMES = 100
STEADY = np.ones(FRAMES - 1, dtype=bool)


def filtered(error: np.ndarray, bound: np.ndarray) -> Filtered:
    covariance = bound[..., None] ** 2 * np.eye(bound.shape[-1])
    return Filtered(error, covariance, np.zeros(covariance.shape[-2:]))


@pytest.fixture
def takes() -> tuple[np.ndarray, np.ndarray]:
    """Training and test takes (takes, FRAMES, 2) of one law, whose spread grows over the steps."""
    rng = np.random.default_rng(1)
    std = np.linspace(0.01, 0.03, FRAMES)[:, None] * [1.0, 2.0]
    middle = np.sin(np.arange(FRAMES))[:, None]
    return tuple(middle + std * rng.standard_normal((count, FRAMES, 2)) for count in (200, 60))


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


def test_a_bias_that_is_nothing_is_about_one_standard_error_and_a_real_one_is_many():
    rng = np.random.default_rng(8)
    takes, frames = 50, 400
    variance = np.full((frames, 2), 0.02**2)
    bias = rng.normal(0.0, 0.02 / np.sqrt(takes), (frames, 2)) + np.array([0.0, 0.03])
    scores = sensor_scores(bias, variance, takes, JOINTS)
    assert scores["kinect_bias_hip_over_standard_error"] == pytest.approx(1, abs=0.1)
    many = 0.03 / 0.02 * np.sqrt(takes)
    assert scores["kinect_bias_knee_over_standard_error"] == pytest.approx(many, rel=0.05)
    assert scores["kinect_bias_knee_variation_over_standard_error"] == pytest.approx(1, abs=0.1)
    assert scores["kinect_std_knee_rms_rad"] == pytest.approx(0.02)
    assert scores["kinect_std_knee_variation"] == 0


def test_a_bound_that_follows_the_error_is_told_from_one_that_does_not():
    rng, shape = np.random.default_rng(1), (40, FRAMES, 2)
    width = np.linspace(0.5, 2.0, FRAMES)[:, None] * np.ones(2)
    error = {model: width * rng.normal(size=shape) for model in ("constant", "following")}
    bound = {"constant": 1.3 + 0.01 * rng.random(shape), "following": np.tile(width, (40, 1, 1))}
    filters = {name: filtered(error[name], bound[name]) for name in error}
    filters[NONE] = filters["constant"]
    tables, _ = filter_tables(filters, JOINTS, STEADY, rng)
    rows = tables["bound_comparison"].set_index(["model", "quantity"])
    assert rows.loc[("following", "correlation_of_bound_with_error_knee"), "low"] > 0.5
    assert rows.loc[("following", "relative_error_of_bound_knee"), "high"] < 0
    # a bound that collapses to one particle varies infinitely
    one = np.ones((2, 5, 1))
    collapsed = bound_scores(one, one * np.minimum(np.arange(5), 1)[:, None], ["a"])
    assert np.isinf(collapsed["a"]["bound_greatest_over_least"])
    # every filter and joint has the scores of its own errors and bounds
    expected = bound_scores(error["following"], filters["following"].bound, JOINTS)
    metrics = filter_metrics(tables["filter_scores"])
    for joint, own in expected.items():
        assert {name: metrics[f"following_{joint}_{name}"] for name in own} == own
    assert expected["hip"] != expected["knee"]


def test_a_bound_that_follows_the_ramps_alone_does_not_follow_at_constant_speed():
    steps = np.arange(61)
    ramp, steady = np.minimum(steps, 20.0), steps[1:] > 20
    error, bound = ((1 + ramp + sign * np.sin(steps))[None, :, None] for sign in (1, -1))
    (row,) = filter_scores({"m": filtered(error, bound)}, ["hip"], steady).to_dict("records")
    assert row["correlation_of_bound_with_error"] > 0.9
    assert row["correlation_of_bound_with_error_at_constant_speed"] < -0.9
