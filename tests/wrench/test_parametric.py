"""The parametric wrench model in plane and space against quadrature, simulation, the paper's
formulas, limits and invariances; its directions against an independent sampler.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cable_systems import directions_about, planar_cables, sample_wrench
from scipy.integrate import quad
from scipy.special import i0, i0e, i1, i1e
from scipy.stats import ks_2samp, vonmises

from pipeline.core.errors import ModelDomainError
from pipeline.wrench.parametric import (
    LARGE,
    mean_resultant_length,
    sample_directions,
    wrench_covariance,
    wrench_mean,
)


def test_the_mean_length_is_a_ratio_of_bessel_functions_in_the_plane_and_of_hyperbolic_in_space():
    kappa = np.array([0.01, 0.5, 4.0, 169.35, 600.0])
    np.testing.assert_allclose(mean_resultant_length(kappa, 2), i1(kappa) / i0(kappa), rtol=1e-13)
    closed = 1 / np.tanh(kappa) - 1 / kappa  # which loses digits as κ falls
    np.testing.assert_allclose(mean_resultant_length(kappa, 3), closed, rtol=1e-13 / kappa.min())
    assert np.abs(mean_resultant_length(kappa, 3) - mean_resultant_length(kappa, 2)).min() > 1e-4


@pytest.mark.parametrize("p", [2, 3])
def test_it_is_smooth_where_the_series_takes_over_and_finite_where_bessel_functions_fail(p):
    below, above = mean_resultant_length(LARGE * np.array([1.0, 1 + 1e-9]), p)
    assert above == pytest.approx(below, abs=1e-14)
    lengths = mean_resultant_length(np.array([1e-8, 2e9, 1e15]), p)
    np.testing.assert_allclose(lengths, [1e-8 / p, 1 - (p - 1) / 4e9, 1.0], rtol=1e-9)
    assert 1 - lengths[1] == pytest.approx((p - 1) / 4e9, rel=1e-6)


@pytest.mark.parametrize("mean", [[0.6, -0.8], [0.0, 0.6, -0.8]])
def test_drawn_directions_have_the_law_of_an_independent_sampler_and_not_of_another_spread(mean):
    rng = np.random.default_rng(61)
    means, kappas = np.array([mean, mean]), np.array([3.0, 40.0])
    drawn = sample_directions(means, kappas, 4000, rng)
    assert drawn.shape == (4000, 2, len(mean))
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=-1), 1.0, rtol=1e-12)
    for cable, kappa in enumerate(kappas):
        other = directions_about(np.array(mean), kappa, 4000, rng)
        for component in range(len(mean)):
            assert ks_2samp(drawn[:, cable, component], other[:, component]).pvalue > 1e-4
    assert ks_2samp(drawn[:, 0, -1], other[:, -1]).pvalue < 1e-10
    again = sample_directions(means, kappas, 4000, np.random.default_rng(61))
    np.testing.assert_array_equal(drawn, again)


BAND = 4.5  # standard errors; six rows have 27 moments, which leave it with probability 2e-4
WIDE = [[4.0, 7.0, 2.5], [0.4, 2.1, 5.0], [0.5, 2.0, 1.0], [3.0, 8.0, 40.0]]
WIDE = planar_cables(*map(np.array, WIDE))
APART = replace(WIDE, attachment=np.array([[0.3, -0.2], [-0.5, 0.1], [0.2, 0.6]]))
SPACE = replace(
    WIDE,
    direction=np.array([[0.36, 0.48, 0.8], [-0.6, 0.0, 0.8], [0.0, -0.8, 0.6]]),
    attachment=np.array([[0.3, -0.2, 0.1], [-0.5, 0.1, 0.4], [0.2, 0.6, -0.3]]),
)
SYSTEMS = {"plane, one point": WIDE, "plane": APART, "space": SPACE}
SYSTEMS["space, one point"] = replace(SPACE, attachment=None)


def covariance_z(samples, covariance):
    """Standardised deviations of the distinct sample (co)variances from ``covariance``."""
    centred = samples - samples.mean(axis=0)
    i, j = np.triu_indices(samples.shape[1])
    products = centred[:, i] * centred[:, j]
    return (products.mean(axis=0) - covariance[i, j]) * np.sqrt(len(samples)) / products.std(axis=0)


@pytest.mark.parametrize(("theta", "kappa"), [(0.0, 0.5), (0.7, 4.0), (2.5, 169.35), (4.0, 2416.0)])
def test_moments_of_one_cable_equal_those_integrated_over_its_direction(theta, kappa):
    tension, sd = 5.0, 1.3
    law = vonmises(kappa, loc=0.0)
    edge = min(np.pi, 15 / np.sqrt(kappa))

    def expectation(function):
        def density(angle):
            return function(theta + angle) * law.pdf(angle)

        return quad(density, -edge, edge, epsabs=1e-13, epsrel=1e-13)[0]

    mean = tension * np.array([expectation(np.cos), expectation(np.sin)])
    square, mixed = expectation(lambda a: np.cos(a) ** 2), expectation(lambda a: np.sin(2 * a) / 2)
    second = (tension**2 + sd**2) * np.array([[square, mixed], [mixed, 1 - square]])
    cable = planar_cables(*(np.array([value]) for value in (tension, theta, sd, kappa)))
    np.testing.assert_allclose(wrench_mean(cable), mean, atol=1e-10)
    np.testing.assert_allclose(wrench_covariance(cable), second - np.outer(mean, mean), atol=1e-9)


def test_in_the_plane_the_variances_of_the_force_are_the_papers_formulas():
    angle = np.arctan2(WIDE.direction[:, 1], WIDE.direction[:, 0])
    length = i1e(WIDE.concentration) / i0e(WIDE.concentration)
    second_moment = WIDE.tension**2 + WIDE.tension_sd**2
    a = second_moment - (length * WIDE.tension) ** 2
    b = length * second_moment / WIDE.concentration
    xx = np.sum(a * np.cos(angle) ** 2 - b * np.cos(2 * angle))
    yy = np.sum(a * np.sin(angle) ** 2 + b * np.cos(2 * angle))
    xy = np.sum(np.sin(2 * angle) * (a - 2 * b) / 2)
    np.testing.assert_allclose(wrench_covariance(WIDE), [[xx, xy], [xy, yy]], rtol=1e-13)
    # the forces of cables with attachments apart are the same
    np.testing.assert_allclose(wrench_covariance(APART)[:2, :2], [[xx, xy], [xy, yy]], rtol=1e-13)


@pytest.mark.parametrize("place", SYSTEMS)
def test_simulated_wrenches_have_the_closed_forms_moments_and_the_small_angle_law_does_not(place):
    system = SYSTEMS[place]
    samples = sample_wrench(system, 100_000, np.random.default_rng(1))
    mean, covariance = wrench_mean(system), wrench_covariance(system)
    mean_z = (samples.mean(axis=0) - mean) / np.sqrt(np.diag(covariance) / len(samples))
    assert samples.shape[1] == {"plane": 3, "space": 6}.get(place, system.dimension)
    assert np.abs(mean_z).max() < BAND
    assert np.abs(covariance_z(samples, covariance)).max() < BAND
    maps, columns = system.maps(), system.jacobian()
    across = system.tension**2 / system.concentration
    small_angle = np.einsum("mip,m,mjp->ij", maps, across, maps)
    small_angle += (columns * (system.tension_sd**2 - across)) @ columns.T
    assert np.abs(covariance_z(samples, small_angle)).max() > 5 * BAND


@pytest.mark.parametrize("place", ["plane", "space"])
def test_the_moment_is_that_about_the_origin_and_one_about_another_point_is_not(place):
    system = SYSTEMS[place]
    shift = np.array([0.4, -0.7, 0.2])[: system.dimension]
    samples = sample_wrench(system, 20_000, np.random.default_rng(62))
    moved = replace(system, attachment=system.attachment - shift)
    p = system.dimension
    for distinct, case in ((False, system), (True, moved)):
        covariance = wrench_covariance(case)
        z = covariance_z(samples[:, p:], covariance[p:, p:])
        assert (np.abs(z).max() > 3 * BAND) == distinct
    # the moment about another point is M − shift × F
    carry = np.eye(len(covariance))
    for column, force in enumerate(np.eye(p)):
        turned = -np.cross(np.append(shift, 0.0)[:3], np.append(force, 0.0)[:3])
        carry[p:, column] = turned[2 if p == 2 else slice(None)]
    np.testing.assert_allclose(carry @ wrench_covariance(system) @ carry.T, covariance, atol=1e-12)


def test_concentrations_whose_bessel_functions_overflow_give_the_small_angle_law():
    kappa = 1e5
    with np.errstate(over="ignore"):
        assert np.isinf(i0(kappa))
    assert mean_resultant_length(kappa, 2) == pytest.approx(1 - 1 / (2 * kappa), abs=1 / kappa**2)
    cable = planar_cables(*(np.array([v]) for v in (6.0, np.pi / 2, 2.0, kappa)))
    np.testing.assert_allclose(np.diag(wrench_covariance(cable)), [36.0 / kappa, 4.0], rtol=0.2)
    np.testing.assert_allclose(wrench_covariance(cable)[0, 0], (36.0 + 4.0) / kappa, rtol=1e-4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"concentration": np.zeros(3)}, "concentration > 0"),
        ({"tension_sd": -np.ones(3)}, "tension_sd"),
        ({"direction": WIDE.direction[:2]}, "direction has shape"),
        ({"direction": 2 * WIDE.direction}, "unit vectors"),
        ({"direction": np.ones((3, 1))}, "and 2 or 3"),
        ({"attachment": np.zeros((3, 3))}, "attachment has shape"),
        ({"tension": np.full(3, np.nan)}, "not finite"),
    ],
)
def test_values_without_a_law_are_refused(change, words):
    with pytest.raises(ModelDomainError, match=words):
        replace(WIDE, **change)
