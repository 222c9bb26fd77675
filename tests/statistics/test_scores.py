"""Scores against closed forms, quadrature and simulation; each has a law that it must tell from the
true one.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal, norm

from pipeline.core.errors import ModelDomainError
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
    rng, repeats, sigma = np.random.default_rng(count), 200_000 // count, 0.7
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
