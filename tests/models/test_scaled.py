"""Fit of noise that grows with speed: known parameters from draws with measurement noise, and no
gain from noise that does not grow.
"""

import numpy as np
import pytest

from pipeline.core.errors import ModelDomainError
from pipeline.models.model import normal_log_density
from pipeline.models.scaled.fit import fit_scaled

TAKES, STEPS, REST = 40, 200, 20
FLOOR = 1e-6 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
GAIN = np.array([[0.04, -0.03, 0.01], [-0.03, 0.09, 0.0], [0.01, 0.0, 0.05]])
MEASUREMENT = 1e-6 * np.array([[1.0, -0.8, 0.0], [-0.8, 2.0, -1.0], [0.0, -1.0, 2.0]])
NONE = np.zeros((3, 3))
FORMS = {"diagonal": (np.diag(np.diag(FLOOR)), np.diag(np.diag(GAIN))), "full": (FLOOR, GAIN)}


def joint_steps() -> np.ndarray:
    """(TAKES, STEPS, 3) rad, from rest to 0.012 rad and back to rest, each joint at its own time, a
    little different in each take.
    """
    time = np.linspace(0, np.pi, STEPS - 2 * REST)
    nominal = np.zeros((STEPS, 3))
    nominal[REST:-REST] = 0.012 * np.stack(
        [np.sin(time), -np.sin(2 * time), np.sin(3 * time) * np.sin(time)], axis=-1
    )
    return nominal * np.random.default_rng(80).normal(1, 0.02, (TAKES, 1, 1))


def drawn(*covariances: np.ndarray) -> np.ndarray:
    """Noise with these covariances of floor, gain and measurement; any may be singular."""
    rng, dq = np.random.default_rng(81), joint_steps()
    floor, gain, measured = (
        rng.multivariate_normal(np.zeros(3), covariance, dq.shape[:-1], method="eigh")
        for covariance in covariances
    )
    return floor + dq * gain + measured


def fit(noise, measurement=MEASUREMENT, structure="full", dq=None):
    return fit_scaled(noise, joint_steps() if dq is None else dq, measurement, structure)


def likelihood(noise, floor, gain, measurement) -> float:
    """Mean log density of the steps."""
    dq = joint_steps()
    covariance = floor + measurement + gain * (dq[..., :, None] * dq[..., None, :])
    return float(normal_log_density(noise, covariance).mean())


def distance(result: np.ndarray, true: np.ndarray, scale: np.ndarray | None = None) -> float:
    scale = np.sqrt(np.diag(true)) if scale is None else scale
    return float(np.abs((result - true) / np.outer(scale, scale)).max())


@pytest.mark.parametrize("measurement", [NONE, MEASUREMENT])
@pytest.mark.parametrize("structure", FORMS)
def test_the_parameters_of_a_models_own_draws_are_found_again(structure, measurement):
    true = FORMS[structure]
    noise = drawn(*true, measurement)
    floor, gain, most = fit(noise, measurement, structure)
    # a variance from half of the 8 000 steps has a standard error of about 2.2 %, measurement
    # included
    assert distance(floor, true[0]) < 0.12 and distance(gain, true[1]) < 0.12
    assert most == pytest.approx(likelihood(noise, floor, gain, measurement), rel=1e-10)
    # controls: speeds of other steps, and no measurement noise
    wrong = fit(noise, measurement, structure, np.roll(joint_steps(), STEPS // 4, axis=1))
    assert max(map(distance, wrong, true)) > 0.3 and wrong[2] < most - 0.05
    if measurement.any():
        assert distance(fit(noise, NONE, structure)[0], true[0]) > 0.25


@pytest.mark.parametrize("structure", FORMS)
def test_where_nothing_but_the_measurement_is_noisy_at_rest_the_floor_is_zero(structure):
    noise, scale = drawn(NONE, FORMS[structure][1], MEASUREMENT), np.sqrt(np.diag(MEASUREMENT))
    floor, gain, _ = fit(noise, structure=structure)
    # from 1 600 steps at rest the standard error of the floor is about 4 % of this
    assert distance(floor, NONE, scale) < 0.12 and np.linalg.eigvalsh(floor)[0] >= 0
    assert distance(gain, FORMS[structure][1]) < 0.12
    # control: a fit that ignores the measurement noise returns it as the floor
    ignorant = fit(noise, NONE, structure)[0]
    assert np.abs(np.diag(ignorant) / np.diag(MEASUREMENT) - 1).max() < 0.2


def test_in_noise_that_does_not_grow_no_gain_is_found_and_the_floor_is_the_additive_covariance():
    for gain in (NONE, GAIN):
        noise = drawn(FLOOR, gain, NONE)
        flat = noise.reshape(-1, 3)
        constant = flat.T @ flat / len(flat)  # of greatest likelihood without a gain
        floor, found, most = fit(noise, NONE)
        more = most - normal_log_density(noise, constant).mean()
        # twice 8 000 times the mean difference is chi-squared with at most 6 degrees of freedom
        assert more > -1e-9 and (more < 25 / (2 * TAKES * STEPS)) == (gain is NONE)
        if gain is NONE:
            assert distance(floor, constant) < 0.1
            assert distance(floor + found * 0.006**2, constant) < 0.1


def test_noise_that_is_zero_at_rest_has_no_greatest_likelihood_but_with_measurement_noise():
    noise = drawn(NONE, GAIN, NONE)
    with pytest.raises(ModelDomainError, match="plane"):
        fit(noise, NONE)
    assert distance(fit(noise, 1e-2 * MEASUREMENT)[1], GAIN) < 0.12


def test_a_joint_that_never_moves_and_no_covariance_are_refused():
    noise, dq = drawn(*FORMS["full"], MEASUREMENT), joint_steps()
    with pytest.raises(ModelDomainError, match="never moves"):
        fit(noise, dq=dq * [1.0, 0.0, 1.0])
    with pytest.raises(ModelDomainError, match="positive semidefinite"):
        fit(noise, -MEASUREMENT)
    with pytest.raises(ModelDomainError, match="not finite"):
        fit(noise * np.where(np.arange(3) == 1, np.nan, 1.0))
