"""Measured against modelled force: tables that keep their contracts and say what the samples
say.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from planar_cables import planar_cables

from pipeline.core import contracts
from pipeline.statistics import densities
from pipeline.wrench.bounds import Bounds
from pipeline.wrench.expectation import expected_sigma_s
from pipeline.wrench.matrix import matrix_model
from pipeline.wrench.measured_force import (
    force_density,
    force_moments,
    force_test,
    modelled_wrenches,
)
from pipeline.wrench.study import estimate_sigma_s, run_study, sigma_s_rows
from tests.wrench.parametric_law import sample_wrench

BOUNDS = Bounds(
    tension=(1.8, 14.0), direction=(0.0, 3.8), tension_sd=(0.5, 2.3), concentration=(170.0, 2400.0)
)
DIRECTIONS = np.array([0.15, 3.7, 1.6])
TENSIONS = np.array([9.19, 6.92, 7.30])  # N; along these directions they give (3, 5) N
SYSTEM = planar_cables(
    TENSIONS, DIRECTIONS, np.array([0.5, 1.2, 2.3]), np.array([2400.0, 600.0, 170.0])
)


def compared():
    rng = np.random.default_rng(25)
    sigma_s = estimate_sigma_s(BOUNDS, 1000, 3, rng)["diagonal"].mean
    return sigma_s, {
        "measured": sample_wrench(SYSTEM, 20_000, rng),
        "modelled": modelled_wrenches(SYSTEM, sigma_s, 20_000, rng),
    }


def test_modelled_wrenches_have_the_mean_and_covariance_of_the_matrix_model():
    sigma_s, forces = compared()
    moments = force_moments("C1", forces, ("fx", "fy")).set_index("source").loc["modelled"]
    covariance = matrix_model(SYSTEM).covariance(sigma_s)
    np.testing.assert_allclose(
        [moments.fx, moments.fy], [3.0, 5.0], atol=4.5 * np.sqrt(covariance.max() / 20_000)
    )
    np.testing.assert_allclose(
        [moments.var_fx, moments.var_fy], np.diag(covariance), rtol=4.5 * np.sqrt(2 / 20_000)
    )
    np.testing.assert_allclose(
        moments["cov"],
        covariance[0, 1],
        atol=4.5 * np.sqrt(np.prod(np.diag(covariance)) / 20_000) * 1.5,
    )


def test_a_system_within_the_bounds_is_modelled_with_nearly_its_variances_and_one_outside_is_not():
    sigma_s, forces = compared()
    moments = force_moments("C1", forces, ("fx", "fy")).set_index("source")
    ratio = (
        moments.loc["modelled", ["var_fx", "var_fy"]]
        / moments.loc["measured", ["var_fx", "var_fy"]]
    )
    assert ratio.sub(1).abs().max() < 0.25
    loose = replace(SYSTEM, concentration=SYSTEM.concentration / 20)
    measured = sample_wrench(loose, 20_000, np.random.default_rng(26))
    assert np.trace(np.cov(measured.T)) > 1.5 * np.trace(matrix_model(SYSTEM).covariance(sigma_s))


def test_both_sources_stand_on_one_grid_and_hold_all_their_mass_there():
    _, forces = compared()
    table = force_density("C1", forces, 60)
    measured, modelled = (
        table[table.source == source].reset_index(drop=True) for source in ("measured", "modelled")
    )
    pd.testing.assert_frame_equal(measured[["fx", "fy"]], modelled[["fx", "fy"]])
    cell = np.diff(np.unique(measured.fx))[0] * np.diff(np.unique(measured.fy))[0]
    for source in (measured, modelled):
        assert len(source) == 3600
        assert abs(source.density.sum() * cell - 1) < 2e-3


def correlated(system, sigma_s, samples, rng):
    """Draws of the matrix model that stay for 20 samples each: the law is the model's, a twentieth
    of them are independent.
    """
    return np.repeat(modelled_wrenches(system, sigma_s, samples // 20, rng), 20, axis=0)


@pytest.mark.slow
def test_a_record_of_the_model_itself_passes_the_test_and_one_of_less_steady_tensions_does_not(
    monkeypatch,
):
    monkeypatch.setattr(densities, "PERMUTATIONS", 199)  # the level is the same
    sigma_s, _ = compared()
    rngs = np.random.default_rng(44).spawn(30)
    own = [force_test(correlated(SYSTEM, sigma_s, 6000, rng), SYSTEM, sigma_s, rng) for rng in rngs]
    p_values = np.array([test["two_sample_p_value"] for test in own])
    # a binomial of 30 draws with 0.05 exceeds it with probability 6e-4
    assert np.mean(p_values <= 0.05) <= 0.2
    assert np.mean([test["effective_samples"] for test in own]) == pytest.approx(300, rel=0.15)
    assert all(75 <= test["tested_samples"] <= 300 for test in own)
    loose = replace(SYSTEM, tension_sd=1.6 * SYSTEM.tension_sd)
    other = [
        force_test(correlated(loose, sigma_s, 6000, rng), SYSTEM, sigma_s, rng)[
            "two_sample_p_value"
        ]
        for rng in rngs
    ]
    assert np.mean(np.array(other) <= 0.05) >= 0.9


@pytest.mark.slow
def test_every_table_keeps_its_contract(tmp_path):
    _, forces = compared()
    rng = np.random.default_rng(43)
    estimates, expected = estimate_sigma_s(BOUNDS, 100, 3, rng), expected_sigma_s(BOUNDS, 3, rng)
    study_sigma, errors, _ = run_study(BOUNDS, [3, 5], 100, 50, 2, np.random.default_rng(27))
    tables = {
        "sigma_s": pd.concat(
            [study_sigma, pd.DataFrame(sigma_s_rows("C1", 3, estimates, expected))],
            ignore_index=True,
        ),
        "wrench_errors": errors,
        "force_moments": force_moments("C1", forces, ("fx", "fy")),
        "force_density": force_density("C1", forces, 30),
        "force_test": pd.DataFrame(
            [
                {"configuration": "C1", "form": "full"}
                | force_test(forces["measured"], SYSTEM, estimates["full"].mean, rng)
            ]
        ),
    }
    for name, table in tables.items():
        contracts.write(table, name, tmp_path)
        assert len(contracts.read(name, tmp_path)) == len(table)
