"""The fit of (ũ, α): exact in α, recovery from the model's own moments, and the ridge."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import ModelDomainError
from pipeline.models.gaussian.estimators import fit_distance, weighted_medians

STEPS = 320
INVERSE_NORM = 15.25 + 1.75 * np.cos(np.linspace(0, 4 * np.pi, STEPS))  # 13.5 … 17
STEP_NORM = 0.03 * np.abs(np.sin(np.linspace(0, 2 * np.pi, STEPS)))
EXTENSIONS = np.geomspace(0.02, 17.0, 200)


def model_covariance(alpha: float, extension: float) -> np.ndarray:
    u = INVERSE_NORM.max() + extension
    return (alpha**2 * (u**2 - INVERSE_NORM**2) / 9 * STEP_NORM**2)[:, None, None] * np.eye(3)


def fit(covariance: np.ndarray, **options):
    options = {"beta1": 0.5, "extensions": EXTENSIONS} | options
    return fit_distance(
        np.full((STEPS, 3), 0.01),
        covariance,
        np.zeros((STEPS, 3)),
        STEP_NORM,
        INVERSE_NORM,
        rows=3,
        **options,
    )


def test_the_weighted_median_minimises_the_sum_of_distances():
    rng = np.random.default_rng(1)
    for size in (1, 2, 7, 50):
        values, weights = rng.standard_normal(size), rng.uniform(0.1, 2, size)
        cost = (weights * np.abs(values[:, None] - values)).sum(axis=1)
        median = weighted_medians(values, weights)
        assert (weights * np.abs(median - values)).sum() == pytest.approx(cost.min(), rel=1e-12)


@pytest.mark.parametrize(("alpha", "extension"), [(0.1, 1.0), (0.3, 5.0)])
def test_the_models_own_moments_return_its_parameters(alpha, extension):
    result = fit(model_covariance(alpha, extension))
    assert result.alpha == pytest.approx(alpha, rel=1e-3)
    assert result.u == pytest.approx(INVERSE_NORM.max() + extension, rel=1e-3)
    assert not result.at_end and not result.unbounded
    # β₁ weighs a constant: the mean of one step is the nominal one whatever the parameters
    assert result.objective == pytest.approx(0.5 * STEPS * np.sqrt(3) * 0.01, rel=1e-5)
    assert fit(model_covariance(alpha, extension), beta1=0.9).alpha == pytest.approx(
        result.alpha, rel=1e-3
    )


def test_the_parameters_survive_the_sampling_of_a_hundred_takes():
    rng = np.random.default_rng(2)
    noise = (
        rng.standard_normal((100, STEPS, 3)) * np.sqrt(model_covariance(0.1, 1.0)[:, 0, 0])[:, None]
    )
    covariance = np.einsum("tki,tkj->kij", noise, noise) / 100
    result = fit(covariance)
    assert result.alpha == pytest.approx(0.1, rel=0.1)
    assert result.extension == pytest.approx(1.0, rel=0.35)


def test_alpha_is_the_best_for_each_extension():
    rng = np.random.default_rng(3)
    covariance = model_covariance(0.1, 1.0) * rng.uniform(0.5, 2, (STEPS, 1, 1))
    result = fit(covariance)
    for i in (0, 80, 199):
        alphas = np.linspace(0.5, 2, 301) * result.alphas[i]
        traces = np.trace(model_covariance(1.0, EXTENSIONS[i]), axis1=1, axis2=2)
        target = np.trace(covariance, axis1=1, axis2=2)
        rivals = (
            0.5 * np.abs(alphas[:, None] ** 2 * traces - target).sum(axis=1)
            + 0.5 * STEPS * np.sqrt(3) * 0.01
        )
        assert result.objectives[i] <= rivals.min() * (1 + 1e-12)
    assert result.objective <= result.objectives.min()


def test_noise_that_follows_the_speed_alone_runs_to_the_end_of_the_interval_along_the_ridge():
    """u → ∞ with αu fixed is one model: such data do not determine u, and the fit says so."""
    result = fit((1e-3 * STEP_NORM**2)[:, None, None] * np.eye(3))
    assert result.at_end and result.unbounded
    assert result.extension == EXTENSIONS[-1]
    u = INVERSE_NORM.max() + EXTENSIONS
    product = result.alphas * u
    assert (
        np.ptp(product[-50:]) / product[-1] < 0.5 * np.ptp(result.alphas[-50:]) / result.alphas[-1]
    )


def test_the_printed_objective_without_the_absolute_value_rewards_no_noise_at_all():
    """tr{Cov(q) − Cov(q̃)} as printed falls all the way to α = 0; its absolute value does not."""
    recorded = np.trace(model_covariance(0.1, 1.0), axis1=1, axis2=2)
    alphas = np.linspace(0, 0.3, 61)
    difference = np.array(
        [np.trace(model_covariance(alpha, 1.0), axis1=1, axis2=2) - recorded for alpha in alphas]
    )
    assert alphas[difference.sum(axis=1).argmin()] == 0
    assert alphas[np.abs(difference).sum(axis=1).argmin()] == pytest.approx(0.1)


@pytest.mark.parametrize(
    "options",
    [
        {"beta1": 1.0},
        {"beta1": -0.1},
        {"extensions": np.array([1.0, 2.0])},
        {"extensions": np.array([0.0, 1, 2])},
    ],
)
def test_bad_options_are_refused(options):
    with pytest.raises(ModelDomainError):
        fit(model_covariance(0.1, 1.0), **options)


def test_a_motion_at_rest_throughout_is_refused():
    with pytest.raises(ModelDomainError, match="at rest"):
        fit_distance(
            np.zeros((5, 3)),
            np.zeros((5, 3, 3)),
            np.zeros((5, 3)),
            np.zeros(5),
            np.full(5, 14.0),
            rows=3,
            beta1=0.5,
            extensions=EXTENSIONS,
        )
