"""Scores against SciPy's densities and simulation, each with a law that it must tell from the true
one.
"""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.stats import chi2, kstest, multivariate_normal

from pipeline.statistics import scores
from pipeline.statistics.takes import paired_difference

COVARIANCE = np.array([[2.0, -0.9, 0.1], [-0.9, 1.5, 0.4], [0.1, 0.4, 0.8]])
JOINTS = ("hip", "knee")
TAKES = 30
STEPS = 200
FRAMES = 100


def test_the_normal_log_score_is_the_log_density():
    errors = default_rng(6).standard_normal((20, 3))
    covariances = COVARIANCE * np.arange(1.0, 21)[:, None, None]
    expected = []
    for error, covariance in zip(errors, covariances, strict=True):
        expected.append(multivariate_normal(np.zeros(3), covariance).logpdf(error))

    score = scores.normal_log_score(errors, covariances)

    assert_allclose(score, expected, rtol=1e-12)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_the_log_score_prefers_the_true_law_and_the_nees_is_chi_squared_under_it_alone(
    scale,
):
    rng = default_rng(5)
    outcome = rng.standard_normal((2000, 3)) @ np.linalg.cholesky(COVARIANCE).T
    scaled = scale**2 * COVARIANCE

    of_true, of_scaled = (
        scores.normal_log_score(outcome, covariance)
        for covariance in (COVARIANCE, scaled)
    )
    assert paired_difference(of_scaled, of_true).high < 0
    law = chi2(3).cdf
    assert kstest(scores.nees(outcome, COVARIANCE), law).pvalue > 1e-3
    assert kstest(scores.nees(outcome, scaled), law).pvalue < 1e-9


def test_an_honest_posterior_covers_as_it_says_in_every_joint_and_a_narrow_one_does_not():
    std = np.array([0.01, 0.03])
    error = std * default_rng(1).normal(size=(TAKES, STEPS, 2))
    covariance = np.tile(np.diag(std**2), (TAKES, STEPS, 1, 1))

    honest, no_reason = scores.posterior_scores(error, covariance, JOINTS)
    narrow, _ = scores.posterior_scores(error, 0.25 * covariance, JOINTS)
    table = scores.score_comparison({"honest": honest, "narrow": narrow}, "honest")

    assert no_reason is None
    for joint, rms in zip(JOINTS, std, strict=True):
        coverage = f"coverage_of_one_sigma_{joint}"
        assert honest[f"rms_error_{joint}_rad"].mean() == pytest.approx(rms, rel=0.02)
        assert honest[coverage].mean() == pytest.approx(0.683, abs=0.02)
        assert narrow[coverage].mean() < 0.42
    assert honest["nees"].mean() == pytest.approx(len(JOINTS), rel=0.05)
    rows = table.set_index(["model", "score"])
    assert rows.loc[("narrow", "log_score"), "high"] < 0


@pytest.fixture
def takes() -> tuple[np.ndarray, np.ndarray]:
    """Training and test takes (takes, FRAMES, 2) of one law, whose spread grows over the steps."""
    rng = default_rng(1)
    std = np.linspace(0.01, 0.03, FRAMES)[:, None] * [1.0, 2.0]
    middle = np.sin(np.arange(FRAMES))[:, None]
    drawn = middle + std * rng.standard_normal((260, FRAMES, 2))
    return drawn[:200], drawn[200:]


def test_without_a_filter_the_training_takes_predict_the_test_takes_as_they_say(takes):
    training, measured = takes
    none = scores.training_mean(training, measured)
    assert_allclose(none.error, training.mean(axis=0) - measured)
    assert_allclose(none.covariance[7, 30], np.cov(training[:, 30].T))
    assert np.mean(np.abs(none.error) <= none.bound) == pytest.approx(0.683, abs=0.02)
    assert not none.measurement.any()
