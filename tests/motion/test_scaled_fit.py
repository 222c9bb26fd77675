"""Noise that grows with speed is found again in its own draws, and not in noise that does not."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import ModelDomainError
from pipeline.motion.additive import fit_covariance
from pipeline.motion.covariance import gaussian_log_density
from pipeline.motion.residuals import residuals
from pipeline.motion.scaled import scaled_covariance
from pipeline.motion.scaled_fit import ScaledFit, fit_scaled

TAKES, STEPS = 40, 200
FLOOR = 1e-6 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
GAIN = np.array([[0.04, -0.03, 0.01], [-0.03, 0.09, 0.0], [0.01, 0.0, 0.05]])
FORMS = {
    "diagonal": (np.diag(np.diag(FLOOR)), np.diag(np.diag(GAIN))),
    "full": (FLOOR, GAIN),
    "timing": (FLOOR, np.full((3, 3), 0.04)),
}


def joint_steps() -> np.ndarray:
    """(TAKES, STEPS, 3) rad, from rest to 0.012 rad and back, each joint at its own time, a little different in each take."""
    time = np.linspace(0, np.pi, STEPS)
    nominal = 0.012 * np.stack([np.sin(time), -np.sin(2 * time), np.sin(3 * time) * np.sin(time)], axis=-1)
    return nominal * np.random.default_rng(80).normal(1, 0.02, (TAKES, 1, 1))


def drawn(floor: np.ndarray, gain: np.ndarray, dq: np.ndarray, seed: int = 81) -> np.ndarray:
    """Noise of that law with a mean of its own at each step."""
    rng = np.random.default_rng(seed)
    lower = np.linalg.cholesky(scaled_covariance(floor, gain, dq))
    return np.matvec(lower, rng.standard_normal(dq.shape)) + 0.01 * rng.standard_normal((STEPS, 3))


def distance(found: np.ndarray, true: np.ndarray) -> float:
    scale = np.sqrt(np.diag(true))
    return float(np.abs((found - true) / np.outer(scale, scale)).max())


@pytest.mark.parametrize("structure", FORMS)
def test_the_parameters_of_a_models_own_draws_are_found_again(structure):
    floor, gain = FORMS[structure]
    found = fit_scaled(drawn(floor, gain, joint_steps()), joint_steps(), structure)
    # a variance from the half of 8 000 steps that tell of it has a standard error of about 2.2 %
    assert distance(found.floor, floor) < 0.1
    assert distance(found.gain, gain) < 0.1
    assert found.log_likelihood > found.additive_log_likelihood + 0.05
    # control: the joints' speeds belong to their steps
    wrong = fit_scaled(drawn(floor, gain, joint_steps()), np.roll(joint_steps(), STEPS // 4, axis=1), structure)
    assert max(distance(wrong.floor, floor), distance(wrong.gain, gain)) > 0.3


def test_in_noise_that_does_not_grow_no_gain_is_found_and_the_floor_is_the_additive_covariance():
    noise = drawn(FLOOR, np.zeros((3, 3)), joint_steps())
    additive = fit_covariance(noise)
    for structure, expected in (("full", additive), ("timing", additive), ("diagonal", np.diag(np.diag(additive)))):
        found = fit_scaled(noise, joint_steps(), structure)
        # what speed explains of the greatest variance, against 4 standard errors
        assert distance(scaled_covariance(found.floor, found.gain, np.full(3, 0.006)), expected) < 0.1
        assert distance(found.floor, expected) < 0.1
        # twice 8 000 times the mean difference is chi-squared with at most 6 degrees of freedom, but for the correlations
        assert structure == "diagonal" or -1e-9 < found.log_likelihood - found.additive_log_likelihood < 25 / (2 * TAKES * STEPS)


def test_the_full_form_is_at_least_as_likely_as_those_it_contains():
    noise = drawn(*FORMS["full"], joint_steps())
    found = {structure: fit_scaled(noise, joint_steps(), structure).log_likelihood for structure in FORMS}
    assert found["full"] > max(found["diagonal"], found["timing"])


@pytest.mark.parametrize("structure", FORMS)
def test_the_likelihood_is_that_of_the_parameters_and_no_neighbour_has_a_greater(structure):
    noise = drawn(*FORMS[structure], joint_steps())
    found = fit_scaled(noise, joint_steps(), structure)

    def likelihood(fit: ScaledFit, floor: float = 1.0, gain: float = 1.0) -> float:
        covariance = scaled_covariance(floor * fit.floor, gain * fit.gain, joint_steps())
        return float(gaussian_log_density(residuals(noise), covariance).mean())

    np.testing.assert_allclose(found.log_likelihood, likelihood(found), rtol=1e-10)
    for share in (0.99, 1.01):
        assert likelihood(found, floor=share) < found.log_likelihood
        assert likelihood(found, gain=share) < found.log_likelihood


@pytest.mark.parametrize("structure", FORMS)
def test_the_fit_follows_the_units_of_the_noise(structure):
    noise = drawn(*FORMS[structure], joint_steps())
    one, other = fit_scaled(noise, joint_steps(), structure), fit_scaled(10 * noise, 10 * joint_steps(), structure)
    np.testing.assert_allclose(other.floor, 100 * one.floor, rtol=1e-3, atol=1e-8)
    np.testing.assert_allclose(other.gain, one.gain, rtol=1e-3, atol=1e-5)


def test_noise_that_is_zero_at_rest_has_no_greatest_likelihood():
    dq = joint_steps()
    dq[:, :20] = 0.0
    noise = drawn(1e-30 * np.eye(3), GAIN, dq)
    noise[:, :20] = 0.0
    with pytest.raises(ModelDomainError, match="plane"):
        fit_scaled(noise, dq, "full")


def test_a_joint_that_never_moves_and_an_unknown_structure_are_refused():
    noise, dq = drawn(*FORMS["full"], joint_steps()), joint_steps()
    with pytest.raises(ModelDomainError, match="structure must be one of"):
        fit_scaled(noise, dq, "banded")
    with pytest.raises(ModelDomainError, match="never moves"):
        fit_scaled(noise, dq * [1.0, 0.0, 1.0], "full")
