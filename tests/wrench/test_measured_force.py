"""Measured against modelled wrench: moments, densities, and the test of all rows."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from cable_systems import planar_cables, sample_wrench
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import multivariate_normal

from pipeline.statistics import densities
from pipeline.wrench import models
from pipeline.wrench.measured_force import (
    NormalLaw,
    force_moments,
    force_test,
    measured_wrenches,
    rows_of,
)
from pipeline.wrench.study import averaged_sigma_s

BOUNDS = models.Bounds((1.8, 14.0), (0.0, 3.8), (0.5, 2.3), (170.0, 2400.0))
DIRECTIONS = np.array([0.15, 3.7, 1.6])
TENSIONS = np.array([9.19, 6.92, 7.30])  # N; along these directions they give (3, 5) N
SPREADS = np.array([0.5, 1.2, 2.3]), np.array([2400.0, 600.0, 170.0])
SYSTEM = planar_cables(TENSIONS, DIRECTIONS, *SPREADS)


def correlated(system, sigma_s, samples, rng):
    """Draws of the matrix model that stay for 20 samples each: the law is the model's, a twentieth
    of them are independent.
    """
    model = models.matrix_model(system)
    independent = models.sample_wrenches(model, sigma_s, samples // 20, rng)
    return np.repeat(independent, 20, axis=0)


def shares_rejected(system, sigma_s, rngs) -> tuple[float, pd.DataFrame]:
    """Share of records of the cables ``system`` that the test of SYSTEM rejects, and the tests."""
    tests = []
    for rng in rngs:
        record = correlated(system, sigma_s, 6000, rng)
        tests.append(force_test(record, SYSTEM, sigma_s, rng))
    table = pd.DataFrame(tests)
    return np.mean(table["two_sample_p_value"] <= 0.05), table


@pytest.mark.slow
def test_a_record_of_the_model_itself_passes_the_test_and_one_of_less_steady_tensions_does_not(
    monkeypatch,
):
    monkeypatch.setattr(densities, "PERMUTATIONS", 199)  # the level is the same
    systems = models.draw_systems(BOUNDS, 1000, 3, default_rng(25))
    sigma_s = averaged_sigma_s(systems)["diagonal"].mean
    model = models.matrix_model(SYSTEM)
    share = model.sigma_s_factor() * sigma_s[0, 0] / model.covariance(sigma_s)[0, 0]
    loose = replace(SYSTEM, tension_sd=1.6 * SYSTEM.tension_sd)
    rngs = default_rng(44).spawn(30)

    rejected, tests = shares_rejected(SYSTEM, sigma_s, rngs)
    rejected_loose, _ = shares_rejected(loose, sigma_s, rngs)

    # a binomial of 30 draws with 0.05 exceeds it with probability 6e-4
    assert rejected <= 0.2
    assert rejected_loose >= 0.9
    assert tests["effective_samples"].mean() == pytest.approx(300, rel=0.15)
    assert tests["tested_samples"].between(75, 300).all()
    assert tests["matrix_share_fx"][0] == pytest.approx(share)
    assert share < 0.5


TOWED = models.CableSystem(
    tension=[8.2, 9.1, 7.6],
    direction=[[0.6, 0.0, 0.8], [-0.48, 0.36, 0.8], [-0.36, -0.48, 0.8]],
    tension_sd=[0.5, 0.8, 1.1],
    concentration=[2400.0, 1200.0, 600.0],
    attachment=[[0.1, 0.0, 0.01], [-0.05, 0.087, 0.01], [-0.05, -0.087, 0.01]],
)
LENGTH = 0.1
SIX = ("fx", "fy", "fz", "mx", "my", "mz")


def sigma_s_of(system: models.CableSystem) -> np.ndarray:
    """(6, 6) the Σ_S with which the matrix model has the covariance of the cables."""
    unbounded = models.unbounded_sigma_s(system)
    return models.optimal_sigma_s(unbounded, "full")[0]


def test_the_divergence_is_the_mean_log_ratio_of_the_two_normal_densities():
    measured = NormalLaw(np.array([1.0, 2.0]), np.array([[2.0, 0.5], [0.5, 1.0]]))
    nominal = NormalLaw(np.array([0.0, 2.5]), np.array([[3.0, -1.0], [-1.0, 4.0]]))
    law = multivariate_normal(*measured)
    drawn = law.rvs(200_000, random_state=default_rng(7))
    ratios = law.logpdf(drawn) - multivariate_normal(*nominal).logpdf(drawn)
    error = ratios.std() / np.sqrt(len(ratios))
    divergence = measured.divergence_from(nominal)

    assert divergence == pytest.approx(ratios.mean(), abs=4 * error)

    # control: the term of the log-determinant is far larger than the band
    ratio = np.linalg.solve(nominal.covariance, measured.covariance)
    assert abs(np.log(np.linalg.det(ratio))) / 2 > 100 * error


def test_rows_are_those_that_the_cables_give():
    angles = planar_cables([5.0, 4.0], [0.1, 2.0], [0.5, 0.5], [900.0, 900.0])
    assert rows_of(angles) == ("fx", "fy")
    assert rows_of(replace(angles, attachment=np.ones((2, 2)))) == ("fx", "fy", "mz")
    assert rows_of(replace(TOWED, attachment=None)) == SIX[:3]
    assert rows_of(TOWED) == SIX


def test_moments_of_measured_wrenches_are_over_the_length():
    wrenches = sample_wrench(TOWED, 50, default_rng(1))
    record = pd.DataFrame(wrenches, columns=SIX)
    angles = planar_cables([5.0, 4.0], [0.1, 2.0], [0.5, 0.5], [900.0, 900.0])
    planar = replace(angles, attachment=np.ones((2, 2)))

    measured = measured_wrenches(record, TOWED, LENGTH)
    moment = measured_wrenches(record, planar, LENGTH)[:, 2]

    assert_allclose(measured[:, :3], wrenches[:, :3])
    assert_allclose(LENGTH * measured[:, 3:], wrenches[:, 3:])
    assert_array_equal(moment, record["mz"] / LENGTH)


def test_six_rows_of_a_record_of_the_cables_have_the_moments_of_the_matrix_model():
    system = TOWED.in_units_of(LENGTH)
    rng = default_rng(45)
    record = pd.DataFrame(sample_wrench(TOWED, 20_000, rng), columns=SIX)
    model = models.matrix_model(system)
    sigma_s = sigma_s_of(system)
    wrenches = {
        "measured": measured_wrenches(record, system, LENGTH),
        "modelled": models.sample_wrenches(model, sigma_s, 20_000, rng),
    }
    exact = np.diag(models.wrench_covariance(system))
    pull = system.jacobian() @ system.tension
    # of vMF(κ) cables pull 1/κ less than their tension
    band = 4.5 * np.sqrt(exact / 20_000) + 0.03

    moments = force_moments("T3", wrenches, SIX).set_index("source")

    for source in wrenches:
        row = moments.loc[source]
        variances = row[[f"var_{name}" for name in SIX]].astype(float)
        assert_allclose(variances, exact, rtol=0.06)
        assert np.all(np.abs(row[list(SIX)].astype(float) - pull) < band)
    # the control: of other attachments the moments differ and the forces do not
    nearer = replace(system, attachment=0.5 * system.attachment)
    ratio = np.diag(models.wrench_covariance(nearer)) / exact
    assert np.all(np.abs(ratio[3:] - 1) > 0.2)
