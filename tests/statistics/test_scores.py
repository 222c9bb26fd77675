"""Scores against closed forms, quadrature and simulation; each has a law that it must tell from the
true one.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2, multivariate_normal, ncx2, norm, ttest_rel

from pipeline.core.errors import ModelDomainError
from pipeline.statistics.scores import (
    energy_score,
    in_region,
    log_determinant,
    nees,
    nees_band,
    normal_energy_score,
    normal_log_score,
    paired_difference,
    relative_error,
)

COVARIANCE = np.array([[2.0, -0.9, 0.1], [-0.9, 1.5, 0.4], [0.1, 0.4, 0.8]])


def crps(y: np.ndarray, sigma: float) -> np.ndarray:
    """Energy score of N(0, σ²) in one dimension (Gneiting & Raftery 2007, Eq. 21)."""
    z = y / sigma
    return sigma * (z * (2 * norm.cdf(z) - 1) + 2 * norm.pdf(z) - 1 / np.sqrt(np.pi))


@pytest.mark.parametrize("count", [2, 5, 50])
def test_the_energy_score_of_few_samples_of_a_normal_law_is_the_closed_form_on_average(count):
    rng, repeats, sigma = np.random.default_rng(count), 200_000 // count, 0.7
    outcome = np.array([-1.5, 0.0, 0.4, 3.0])
    samples = sigma * rng.standard_normal((count, repeats, 4, 1))
    scores = energy_score(samples, outcome[:, None])
    off = (scores.mean(axis=0) - crps(outcome, sigma)) / (scores.std(axis=0) / np.sqrt(repeats))
    assert np.abs(off).max() < 4
    # control: pairs of a sample with itself bias the score by E‖X − X′‖/2S, which these repeats
    # would show
    assert (sigma / np.sqrt(np.pi) / count) / (scores.std(axis=0).max() / np.sqrt(repeats)) > 4


def test_the_energy_score_in_three_dimensions_is_that_by_quadrature():
    sigma, distance, count = 0.5, 1.2, 400
    to_outcome, _ = quad(
        lambda x: sigma * np.sqrt(x) * ncx2.pdf(x, 3, (distance / sigma) ** 2), 0, np.inf
    )
    between = 2 * sigma * np.sqrt(2) * np.sqrt(2 / np.pi)
    samples = sigma * np.random.default_rng(3).standard_normal((count, 200, 3))
    scores = energy_score(samples, np.array([distance, 0.0, 0.0]))
    assert abs(scores.mean() - (to_outcome - between / 2)) < 4 * scores.std() / np.sqrt(200)
    # invariance: rotating and shifting all poses changes nothing
    turn = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))[0]
    assert np.allclose(
        energy_score(samples @ turn + 7, np.array([distance, 0.0, 0.0]) @ turn + 7), scores
    )


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_both_proper_scores_prefer_the_true_law(scale):
    rng, cases = np.random.default_rng(5), 2000
    root = np.linalg.cholesky(COVARIANCE)
    outcome = rng.standard_normal((cases, 3)) @ root.T
    samples = rng.standard_normal((50, cases, 3)) @ root.T
    energy = paired_difference(
        energy_score(scale * samples, outcome), energy_score(samples, outcome)
    )
    logarithmic = paired_difference(
        normal_log_score(outcome, scale**2 * COVARIANCE), normal_log_score(outcome, COVARIANCE)
    )
    assert energy.low > 0 > logarithmic.high
    # control: the density itself is no proper score, and prefers a law too sure of itself
    density = [np.exp(normal_log_score(outcome, s**2 * COVARIANCE)) for s in (0.5, 1.0)]
    assert paired_difference(*density).low > 0


def test_a_single_sample_has_no_energy_score():
    with pytest.raises(ModelDomainError, match="two samples"):
        energy_score(np.zeros((1, 4, 3)), np.zeros((4, 3)))


def test_the_normal_log_score_is_the_log_density():
    errors = np.random.default_rng(6).standard_normal((20, 3))
    expected = multivariate_normal(np.zeros(3), COVARIANCE).logpdf(errors)
    assert np.allclose(normal_log_score(errors, COVARIANCE), expected, rtol=1e-12)
    stacked = COVARIANCE * np.arange(1.0, 21)[:, None, None]
    expected = [
        multivariate_normal(np.zeros(3), c).logpdf(e) for e, c in zip(errors, stacked, strict=True)
    ]
    assert np.allclose(normal_log_score(errors, stacked), expected, rtol=1e-12)


def test_sharpness_is_the_log_determinant_and_grows_with_the_width():
    assert log_determinant(COVARIANCE) == pytest.approx(
        np.log(np.linalg.eigvalsh(COVARIANCE)).sum()
    )
    assert log_determinant(4 * COVARIANCE) - log_determinant(COVARIANCE) == pytest.approx(
        3 * np.log(4)
    )


@pytest.mark.parametrize(
    "singular", [np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0]), np.diag([1.0, 1.0, -1.0])]
)
def test_what_is_no_covariance_normalises_nothing(singular):
    with pytest.raises(ModelDomainError, match="positive definite"):
        nees(np.ones(3), singular)
    with pytest.raises(ModelDomainError, match="not positive"):
        log_determinant(singular)


@pytest.mark.parametrize(("scale", "calibrated"), [(1.0, True), (1.15, False), (1 / 1.15, False)])
def test_the_mean_nees_lies_in_its_band_as_often_as_stated_where_the_covariance_is_right(
    scale, calibrated
):
    rng, repeats, cases = np.random.default_rng(7), 4000, 50
    error = rng.standard_normal((repeats, cases, 3)) @ np.linalg.cholesky(COVARIANCE).T
    low, high = nees_band(cases, 3)
    mean = nees(error, scale**2 * COVARIANCE).mean(axis=1)
    share = np.mean((low <= mean) & (mean <= high))
    assert (abs(share - 0.95) < 4 * np.sqrt(0.95 * 0.05 / repeats)) == calibrated


def test_the_band_of_the_nees_holds_its_mean_and_narrows():
    assert nees_band(1, 3) == pytest.approx(chi2.ppf([0.025, 0.975], 3))
    low, high = nees_band(10_000, 3)
    assert low < 3 < high and high - low == pytest.approx(
        2 * norm.ppf(0.975) * np.sqrt(6 / 10_000), rel=1e-3
    )


@pytest.mark.parametrize(("scale", "calibrated"), [(1.0, True), (1.1, False), (0.9, False)])
def test_the_region_of_a_right_covariance_covers_what_it_says(scale, calibrated):
    rng, cases = np.random.default_rng(8), 20_000
    error = rng.standard_normal((cases, 3)) @ np.linalg.cholesky(COVARIANCE).T
    share = in_region(nees(error, scale**2 * COVARIANCE), 3).mean()
    assert (abs(share - 0.95) < 4 * np.sqrt(0.95 * 0.05 / cases)) == calibrated


def test_a_curve_is_as_far_off_as_its_scale_and_no_nearer_for_its_shape():
    time = np.linspace(0, 1, 100)
    recorded = 1 + np.sin(5 * time)
    assert relative_error(recorded, recorded) == 0
    assert relative_error(1.3 * recorded, recorded) == pytest.approx(0.3)
    assert relative_error(np.zeros(100), recorded) == 1
    # what a correlation cannot see: a curve of the right shape and the wrong size
    assert relative_error(10 * recorded, recorded) == pytest.approx(9)
    with pytest.raises(ModelDomainError, match="zero throughout"):
        relative_error(recorded, np.zeros(100))


def test_the_interval_of_a_paired_difference_is_that_of_the_paired_t_test():
    rng = np.random.default_rng(9)
    takes = rng.normal(0, 5, 12)  # what a take is like, which both models share
    a, b = takes + rng.normal(0.3, 0.2, 12), takes + rng.normal(0, 0.2, 12)
    expected = ttest_rel(a, b).confidence_interval(0.95)
    differences = paired_difference(a, b)
    assert differences == pytest.approx(((a - b).mean(), expected.low, expected.high))
    # control: unpaired, the takes' own spread would hide the difference
    assert differences.low > 0 > paired_difference(a, b[::-1]).low


def test_the_interval_of_a_paired_difference_covers_the_true_one_as_often_as_it_says():
    rng, repeats, takes = np.random.default_rng(10), 4000, 6
    differences = np.array(
        [paired_difference(d, np.zeros(takes)) for d in rng.normal(1, 2, (repeats, takes))]
    )
    share = np.mean((differences[:, 1] <= 1) & (differences[:, 2] >= 1))
    assert abs(share - 0.95) < 4 * np.sqrt(0.95 * 0.05 / repeats)


def test_a_difference_that_does_not_exist_is_a_gap():
    single = paired_difference(np.array([2.0]), np.array([0.5]))
    assert single.mean == 1.5 and np.isnan(single[1:]).all()
    for missing in (np.nan, -np.inf):
        assert np.isnan(paired_difference(np.array([1.0, missing]), np.array([0.0, missing]))).all()


@pytest.mark.parametrize("spread", [1.0, 1e-3, 30.0])
def test_the_energy_score_of_a_normal_law_is_that_of_its_draws(spread):
    rng = np.random.default_rng(31)
    root = rng.normal(size=(4, 3, 3)) * [1.0, 0.1, 0.5]
    covariance, error = root @ np.swapaxes(root, -1, -2), spread * rng.normal(size=(4, 3))
    exact = normal_energy_score(error, covariance)
    draws = np.squeeze(root @ rng.standard_normal((20_000, 4, 3, 1)), -1)
    # the first mean from 20 000 draws, the second from pairs of them
    first, second = (
        np.linalg.norm(draws - error, axis=-1),
        np.linalg.norm(draws[::2] - draws[1::2], axis=-1),
    )
    standard_error = np.hypot(
        first.std(axis=0) / np.sqrt(20_000), second.std(axis=0) / np.sqrt(10_000) / 2
    )
    assert np.all(np.abs(exact - first.mean(axis=0) + second.mean(axis=0) / 2) < 4 * standard_error)
    # control: of a law twice as wide
    wide = normal_energy_score(error, 4 * covariance)
    assert spread == 30.0 or np.all(
        np.abs(wide - first.mean(axis=0) + second.mean(axis=0) / 2) > 4 * standard_error
    )


def test_the_energy_score_of_a_normal_law_in_one_direction_is_the_closed_form():
    sigma, x = 0.7, np.linspace(-3, 3, 7)
    np.testing.assert_allclose(
        normal_energy_score(x[:, None], np.full((7, 1, 1), sigma**2)), crps(x, sigma), rtol=1e-9
    )
    with pytest.raises(ModelDomainError, match="positive definite"):
        normal_energy_score(x[:, None], np.zeros((7, 1, 1)))
