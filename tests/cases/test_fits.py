"""A model in a case: the stages' own fit, realisations and scores, and refusals that are
outcomes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pipeline.cases.case import Takes
from pipeline.cases.evidence import outcome
from pipeline.models.noise import mean_covariance

REALIZATIONS = 12


def fared(case, kind, takes):
    return outcome(case.model_case(kind), takes, REALIZATIONS, np.random.default_rng(1))


def steps_off_nominal(takes) -> np.ndarray:
    """(takes, M, 3) what the test takes' steps are off the nominal ones."""
    test, training = np.stack(list(takes.test.values())), takes.training
    return (
        test[:, 1:]
        - test[:, :-1]
        - np.matvec(training.chain.inverse_jacobian(test[:, :-1]), training.v)
    )


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_the_log_score_has_the_measurement_noise_times_its_factor(base, takes, factor):
    scores = fared(replace(base, measurement=factor), "additive", takes).log_score
    covariance = mean_covariance(takes.training.noise) + factor * takes.training.measurement
    expected = multivariate_normal(np.zeros(3), covariance).logpdf(steps_off_nominal(takes))
    np.testing.assert_allclose(scores["all"], expected.mean(axis=1), rtol=1e-10)
    np.testing.assert_allclose(
        scores["moving"], expected[:, np.any(takes.training.v, axis=1)].mean(axis=1), rtol=1e-10
    )


def test_without_measurement_noise_only_moving_steps_are_scored(base, takes):
    scores = fared(replace(base, measurement=0.0), "gaussian", takes).log_score
    assert set(scores) == {"moving"} and np.all(np.isfinite(scores["moving"]))


def test_without_test_takes_each_training_take_is_predicted_by_a_fit_to_the_others(base, takes):
    alone = replace(takes, test={})
    scores = fared(base, "additive", alone).log_score["all"]
    training = takes.training
    others = np.delete(training.noise, 3, axis=0)
    rest = training.subset(np.delete(np.arange(12), 3))
    law = multivariate_normal(np.zeros(3), mean_covariance(others) + rest.measurement)
    assert scores[3] == pytest.approx(law.logpdf(training.noise[3]).mean(), rel=1e-10)
    assert len(scores) == 12


def test_equal_random_numbers_make_the_same_outcome_and_the_fit_is_the_cases_own(base, takes):
    once, again = fared(base, "wishart", takes), fared(base, "wishart", takes)
    np.testing.assert_array_equal(once.mean, again.mean)
    otherwise = fared(base.with_wishart(ratio_factor=100.0), "wishart", takes)
    assert otherwise.estimates["sigma_b"] < once.estimates["sigma_b"]


def test_realisations_spread_more_when_they_run_freely(base, takes):
    modes = (replace(base, mode=mode) for mode in ("one_step", "free_running"))
    step, free = (fared(case, "additive", takes).deviation for case in modes)
    assert np.all(free[-1] > 2 * step[-1])


def test_a_model_that_refuses_is_an_outcome_with_its_reason(base, takes):
    never_rests = Takes(
        replace(takes.training, v=np.broadcast_to([0.002, -0.001, 0.02], takes.training.v.shape)),
        takes.poses,
        takes.test,
    )
    refused = fared(base, "wishart", never_rests)
    assert refused.model is None and refused.log_score == {} and refused.mean is None
    assert len(refused.refusals) == 1 and "rest" in refused.refusals[0]


def test_an_unbounded_u_of_the_papers_estimator_is_said_beside_it_as_by_the_stage(base, takes):
    estimates = fared(base, "gaussian", takes).estimates
    assert {"u_paper", "alpha_paper", "u_paper_unbounded"} <= set(estimates)
    assert estimates["u_paper_unbounded"] in (0, 1)
    assert "u_paper_unbounded" not in fared(base, "additive", takes).estimates
