"""Moments of the parametric force model against quadrature, simulation, limits and invariances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import i0
from scipy.stats import vonmises

from pipeline.core.errors import ModelDomainError
from pipeline.wrench.parametric import (
    CableSystem,
    force_covariance,
    mean_resultant_length,
)
from tests.wrench.parametric_law import force_mean, sample_forces

BAND = 4.5  # standard errors; six moments leave it with probability 4e-5

WIDE = CableSystem(
    np.array([4.0, 7.0, 2.5]),
    np.array([0.4, 2.1, 5.0]),
    np.array([0.5, 2.0, 1.0]),
    np.array([3.0, 8.0, 40.0]),
)


def covariance_z(samples, covariance):
    """Standardised deviation of the three distinct sample (co)variances from ``covariance``."""
    centred = samples - samples.mean(axis=0)
    products = np.stack(
        [centred[:, 0] ** 2, centred[:, 1] ** 2, centred[:, 0] * centred[:, 1]], axis=1
    )
    expected = np.array([covariance[0, 0], covariance[1, 1], covariance[0, 1]])
    return (products.mean(axis=0) - expected) * np.sqrt(len(samples)) / products.std(axis=0)


@pytest.mark.parametrize(("theta", "kappa"), [(0.0, 0.5), (0.7, 4.0), (2.5, 169.35), (4.0, 2416.0)])
def test_moments_of_one_cable_equal_those_integrated_over_its_direction(theta, kappa):
    tension, sd = 5.0, 1.3
    law = vonmises(kappa, loc=0.0)
    edge = min(np.pi, 15 / np.sqrt(kappa))

    def expectation(function):
        return quad(
            lambda angle: function(theta + angle) * law.pdf(angle),
            -edge,
            edge,
            epsabs=1e-13,
            epsrel=1e-13,
        )[0]

    mean = tension * np.array([expectation(np.cos), expectation(np.sin)])
    second = (tension**2 + sd**2) * np.array(
        [
            [expectation(lambda a: np.cos(a) ** 2), expectation(lambda a: np.cos(a) * np.sin(a))],
            [expectation(lambda a: np.cos(a) * np.sin(a)), expectation(lambda a: np.sin(a) ** 2)],
        ]
    )
    cable = CableSystem(np.array([tension]), np.array([theta]), np.array([sd]), np.array([kappa]))
    np.testing.assert_allclose(force_mean(cable), mean, atol=1e-10)
    np.testing.assert_allclose(force_covariance(cable), second - np.outer(mean, mean), atol=1e-9)


def test_simulated_forces_have_the_closed_forms_moments_and_the_small_angle_law_does_not():
    samples = sample_forces(WIDE, 200_000, np.random.default_rng(1))
    covariance = force_covariance(WIDE)
    mean_z = (samples.mean(axis=0) - force_mean(WIDE)) / np.sqrt(np.diag(covariance) / len(samples))
    assert np.abs(mean_z).max() < BAND
    assert np.abs(covariance_z(samples, covariance)).max() < BAND
    along = np.stack([np.cos(WIDE.direction), np.sin(WIDE.direction)])
    across = np.stack([-np.sin(WIDE.direction), np.cos(WIDE.direction)])
    small_angle = (along * WIDE.tension_sd**2) @ along.T + (
        across * WIDE.tension**2 / WIDE.concentration
    ) @ across.T
    assert np.abs(covariance_z(samples, small_angle)).max() > 5 * BAND


def test_concentrations_whose_bessel_functions_overflow_give_the_small_angle_law():
    kappa = 1e5
    with np.errstate(over="ignore"):
        assert np.isinf(i0(kappa))
    assert mean_resultant_length(kappa) == pytest.approx(1 - 1 / (2 * kappa), abs=1 / kappa**2)
    cable = CableSystem(np.array([6.0]), np.array([np.pi / 2]), np.array([2.0]), np.array([kappa]))
    np.testing.assert_allclose(
        np.diag(force_covariance(cable)), [36.0 / kappa, 4.0], rtol=0.2, atol=0
    )
    np.testing.assert_allclose(force_covariance(cable)[0, 0], (36.0 + 4.0) / kappa, rtol=1e-4)


def test_turning_every_cable_turns_the_mean_and_the_covariance():
    angle = 0.83
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = CableSystem(WIDE.tension, WIDE.direction + angle, WIDE.tension_sd, WIDE.concentration)
    np.testing.assert_allclose(force_mean(turned), rotation @ force_mean(WIDE), rtol=1e-12)
    np.testing.assert_allclose(
        force_covariance(turned), rotation @ force_covariance(WIDE) @ rotation.T, rtol=1e-12
    )


def test_an_array_of_systems_gives_what_each_system_gives():
    rng = np.random.default_rng(2)
    shape = (4, 5, 3)
    many = CableSystem(
        rng.uniform(2, 9, shape),
        rng.uniform(0, 6, shape),
        rng.uniform(0, 2, shape),
        rng.uniform(1, 900, shape),
    )
    one = CableSystem(
        many.tension[2, 3], many.direction[2, 3], many.tension_sd[2, 3], many.concentration[2, 3]
    )
    np.testing.assert_array_equal(force_covariance(many)[2, 3], force_covariance(one))
    np.testing.assert_array_equal(force_mean(many)[2, 3], force_mean(one))


@pytest.mark.parametrize(
    "change",
    [
        {"concentration": np.zeros(3)},
        {"tension_sd": -np.ones(3)},
        {"direction": np.zeros(2)},
        {"tension": np.full(3, np.nan)},
    ],
)
def test_values_without_a_law_are_refused(change):
    fields = {
        "tension": np.ones(3),
        "direction": np.zeros(3),
        "tension_sd": np.ones(3),
        "concentration": np.ones(3),
    }
    with pytest.raises(ModelDomainError):
        CableSystem(**(fields | change))
