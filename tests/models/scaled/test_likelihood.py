"""Noise that grows with speed is found again in its own draws beside the measurement's, and not in
noise that does not grow.
"""

from __future__ import annotations

import numpy as np
import pytest
from additive_likelihood import fit_additive

from pipeline.core.errors import ModelDomainError
from pipeline.models.normal import normal_log_density
from pipeline.models.scaled.fit import fit_scaled, negative_log_likelihood


def scaled_covariance(floor, gain, dq):
    return floor + gain * (dq[..., :, None] * dq[..., None, :])


TAKES, STEPS, REST = 40, 200, 20
FLOOR = 1e-6 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
GAIN = np.array([[0.04, -0.03, 0.01], [-0.03, 0.09, 0.0], [0.01, 0.0, 0.05]])
MEASUREMENT = 1e-6 * np.array([[1.0, -0.8, 0.0], [-0.8, 2.0, -1.0], [0.0, -1.0, 2.0]])
NONE = np.zeros((3, 3))
FORMS = {
    "diagonal": (np.diag(np.diag(FLOOR)), np.diag(np.diag(GAIN))),
    "full": (FLOOR, GAIN),
}
SPREAD = np.sqrt(np.diag(FLOOR))


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


def drawn(
    floor: np.ndarray,
    gain: np.ndarray,
    measurement: np.ndarray = MEASUREMENT,
    dq: np.ndarray | None = None,
) -> np.ndarray:
    """Noise of that law; any of its covariances may be singular."""
    rng, dq = np.random.default_rng(81), joint_steps() if dq is None else dq
    size = dq.shape[:-1]
    of_floor, of_gain, of_measurement = (
        rng.multivariate_normal(np.zeros(3), covariance, size, method="eigh")
        for covariance in (floor, gain, measurement)
    )
    return of_floor + dq * of_gain + of_measurement


def likelihood(
    noise: np.ndarray, floor: np.ndarray, gain: np.ndarray, measurement: np.ndarray
) -> float:
    return float(
        normal_log_density(
            noise, scaled_covariance(floor + measurement, gain, joint_steps())
        ).mean()
    )


def distance(result: np.ndarray, true: np.ndarray, scale: np.ndarray | None = None) -> float:
    scale = np.sqrt(np.diag(true)) if scale is None else scale
    return float(np.abs((result - true) / np.outer(scale, scale)).max())


@pytest.mark.parametrize("measurement", [NONE, MEASUREMENT])
@pytest.mark.parametrize("structure", FORMS)
def test_the_parameters_of_a_models_own_draws_are_found_again(structure, measurement):
    floor, gain = FORMS[structure]
    noise = drawn(floor, gain, measurement)
    result = fit_scaled(noise, joint_steps(), measurement, structure)
    # a variance from the half of 8 000 steps that tell of it has a standard error of about 2.2 %,
    # measurement included
    assert distance(result.floor, floor) < 0.12
    assert distance(result.gain, gain) < 0.12
    assert result.log_likelihood > fit_additive(noise, measurement).log_likelihood + 0.05
    # controls: the joints' speeds belong to their steps, and the measurement's noise to the
    # measurement
    wrong = fit_scaled(noise, np.roll(joint_steps(), STEPS // 4, axis=1), measurement, structure)
    assert max(distance(wrong.floor, floor), distance(wrong.gain, gain)) > 0.3
    if measurement.any():
        assert distance(fit_scaled(noise, joint_steps(), NONE, structure).floor, floor) > 0.25


@pytest.mark.parametrize("structure", FORMS)
def test_where_nothing_but_the_measurement_is_noisy_at_rest_the_floor_is_zero(structure):
    _, gain = FORMS[structure]
    noise = drawn(NONE, gain)
    result = fit_scaled(noise, joint_steps(), MEASUREMENT, structure)
    # 1 600 steps at rest tell the floor from the measurement's noise to about 4 % of this
    assert distance(result.floor, NONE, np.sqrt(np.diag(MEASUREMENT))) < 0.12
    assert distance(result.gain, gain) < 0.12
    assert np.linalg.eigvalsh(result.floor)[0] >= 0
    # control: who ignores the measurement's noise finds it in the floor
    ignorant = fit_scaled(noise, joint_steps(), NONE, structure).floor
    assert np.abs(np.diag(ignorant) / np.diag(MEASUREMENT) - 1).max() < 0.2


@pytest.mark.parametrize("gain", [NONE, GAIN])
def test_at_a_zero_floor_no_direction_of_it_is_more_likely(gain):
    # a stated measurement noise above the true one drives the floor to exactly zero along every
    # axis
    noise, stated = drawn(NONE, gain), 1.5 * MEASUREMENT
    result = fit_scaled(noise, joint_steps(), stated, "full")
    assert distance(result.floor, NONE, np.sqrt(np.diag(MEASUREMENT))) < 1e-6
    directions = 3e-4 * np.random.default_rng(82).normal(size=(30, 3))
    for direction in directions:
        more = np.outer(direction, direction)
        assert likelihood(noise, result.floor + more, result.gain, stated) < result.log_likelihood
        assert (
            likelihood(noise, result.floor, result.gain + 1e5 * more, stated)
            < result.log_likelihood
        )
    # control: where there is a floor, at zero they are
    noise = drawn(FLOOR, gain)
    more = [likelihood(noise, np.outer(d, d), gain, MEASUREMENT) for d in directions]
    assert max(more) > likelihood(noise, NONE, gain, MEASUREMENT)


def test_in_noise_that_does_not_grow_no_gain_is_found_and_the_floor_is_the_additive_covariance():
    noise = drawn(FLOOR, NONE)
    additive = fit_additive(noise, MEASUREMENT)
    for structure, expected in (("full", additive.covariance),):
        result = fit_scaled(noise, joint_steps(), MEASUREMENT, structure)
        # what speed explains of the greatest variance, against 4 standard errors
        assert (
            distance(
                scaled_covariance(result.floor, result.gain, np.full(3, 0.006)), expected, SPREAD
            )
            < 0.1
        )
        assert distance(result.floor, expected, SPREAD) < 0.1
        # twice 8 000 times the mean difference is chi-squared with at most 6 degrees of freedom
        assert -1e-9 < result.log_likelihood - additive.log_likelihood < 25 / (2 * TAKES * STEPS)
    # control: in noise that grows it is more
    growing = drawn(FLOOR, GAIN)
    grown = fit_scaled(growing, joint_steps(), MEASUREMENT, "full")
    constant = fit_additive(growing, MEASUREMENT)
    assert grown.log_likelihood - constant.log_likelihood > 25 / (2 * TAKES * STEPS)


@pytest.mark.parametrize("measurement", [NONE, MEASUREMENT])
@pytest.mark.parametrize("structure", FORMS)
def test_the_likelihood_is_that_of_the_parameters_and_no_neighbour_has_a_greater(
    structure, measurement
):
    noise = drawn(*FORMS[structure])
    result = fit_scaled(noise, joint_steps(), measurement, structure)
    np.testing.assert_allclose(
        result.log_likelihood, likelihood(noise, result.floor, result.gain, measurement), rtol=1e-10
    )
    for share in (0.99, 1.01):
        assert (
            likelihood(noise, share * result.floor, result.gain, measurement)
            < result.log_likelihood
        )
        assert (
            likelihood(noise, result.floor, share * result.gain, measurement)
            < result.log_likelihood
        )
    # correlations too, where the form has them
    tilt = np.zeros((3, 3))
    tilt[0, 1] = tilt[1, 0] = 0.01 * SPREAD[0] * SPREAD[1]
    for sign in (-1, 1):
        assert (
            structure == "diagonal"
            or likelihood(noise, result.floor + sign * tilt, result.gain, measurement)
            < result.log_likelihood
        )
        assert (
            structure != "full"
            or likelihood(noise, result.floor, result.gain + 1e4 * sign * tilt, measurement)
            < result.log_likelihood
        )


@pytest.mark.parametrize("structure", FORMS)
def test_the_fit_follows_the_units_of_the_joints(structure):
    noise, dq = drawn(*FORMS[structure]), joint_steps()
    units = np.array([10.0, 0.1, 1.0])
    one = fit_scaled(noise, dq, MEASUREMENT, structure)
    other = fit_scaled(noise * units, dq * units, MEASUREMENT * np.outer(units, units), structure)
    assert distance(other.floor / np.outer(units, units), one.floor, SPREAD) < 1e-3
    np.testing.assert_allclose(other.gain, one.gain, atol=1e-4)
    assert other.log_likelihood == pytest.approx(one.log_likelihood - np.log(units).sum(), abs=1e-8)


def test_noise_that_is_zero_at_rest_has_no_greatest_likelihood_but_with_measurement_noise():
    noise = drawn(NONE, GAIN, NONE)
    assert not noise[:, :REST].any()
    with pytest.raises(ModelDomainError, match="plane"):
        fit_scaled(noise, joint_steps(), NONE, "full")
    assert distance(fit_scaled(noise, joint_steps(), 1e-2 * MEASUREMENT, "full").gain, GAIN) < 0.12


def test_a_joint_that_never_moves_and_no_covariance_are_refused():
    noise, dq = drawn(*FORMS["full"]), joint_steps()
    with pytest.raises(ModelDomainError, match="never moves"):
        fit_scaled(noise, dq * [1.0, 0.0, 1.0], MEASUREMENT, "full")
    with pytest.raises(ModelDomainError, match="positive semidefinite"):
        fit_scaled(noise, dq, -MEASUREMENT, "full")
    with pytest.raises(ModelDomainError, match="not finite"):
        fit_scaled(noise * np.where(np.arange(3) == 1, np.nan, 1.0), dq, MEASUREMENT, "full")


def test_the_compiled_likelihood_and_its_slopes_are_those_of_plain_numpy():
    rng = np.random.default_rng(82)
    w, x = rng.normal(0, [1, 2, 3], (700, 3)), rng.normal(0, [2, 1, 0.5], (700, 3))
    units = np.sqrt(np.diag(FLOOR))
    floor, gain = (FLOOR + MEASUREMENT) / np.outer(units, units), GAIN
    covariance = floor + gain * x[:, :, None] * x[:, None, :]
    precision = np.linalg.inv(covariance)
    white = np.matvec(precision, w)
    slope = 0.5 * (precision - white[:, :, None] * white[:, None, :])
    value, by_floor, by_gain = negative_log_likelihood(w, x, floor, gain)
    assert value == pytest.approx(
        0.5 * np.mean(np.linalg.slogdet(covariance)[1] + np.vecdot(w, white)), rel=1e-12
    )
    np.testing.assert_allclose(by_floor, slope.mean(axis=0), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(
        by_gain, (slope * x[:, :, None] * x[:, None, :]).mean(axis=0), rtol=1e-10, atol=1e-12
    )
    # control: without a floor a step at rest has no density
    x[5] = 0
    assert negative_log_likelihood(w, x, NONE, gain)[0] == np.inf
