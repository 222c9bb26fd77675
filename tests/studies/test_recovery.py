"""Data have the law that they are said to have, and the table counts what estimators return."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.core import config
from pipeline.models.kinds import build_model, estimate
from pipeline.models.noise import mean_covariance
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.recordings.steps import training_steps
from pipeline.studies.recovery import stage
from pipeline.studies.recovery.stage import drawn, recovery_row

HERE = Path(stage.__file__).parent


@pytest.fixture
def recorded(project):
    """The recorded steps of the project."""
    settings = config.sections("recovery", HERE / "dvc.yaml")
    return training_steps(settings.dataset.robot, settings.dataset.motion)


def test_drawn_noise_has_the_covariance_of_its_law_and_of_the_measurement(recorded):
    parts = {"q": recorded.q[:, ::20], "v": recorded.v[::20], "noise": recorded.noise[:, ::20]}
    part = replace(recorded, **parts, known_measurement=recorded.measurement)
    model = WishartModel(0.25, Decomposition("pivoted_lu"))
    rng = np.random.default_rng(4)
    noise = np.stack([drawn(model, part, rng).noise for _ in range(1500)])
    expected = model.covariance(part.chain, part.q, part.v) + part.measurement
    rms = np.sqrt(np.diagonal(expected.mean(axis=(0, 1))))
    np.testing.assert_allclose(np.sqrt(noise.var(axis=0).mean(axis=(0, 1))), rms, rtol=0.03)
    # the nominal step is the project's: measured minus nominal has the bias of E[B⁻¹]
    nominal = part.chain.nominal_step(part.q, part.v)
    bias = noise.mean(axis=0) - nominal / 15  # d/(d − n − 1) − 1 at σ_B = .25
    assert np.abs(bias).max() < 5 * np.sqrt(np.max(expected) / 1500)


def test_a_row_has_bias_error_and_coverage_of_the_estimates():
    rng = np.random.default_rng(2)
    estimates = 0.26 + 0.02 * rng.standard_normal(4000)
    again = estimates + 0.02 * rng.standard_normal(4000)
    pairs = [({"a": one}, {"a": other}) for one, other in zip(estimates, again, strict=True)]
    row = recovery_row("a", 0.25, [None, *pairs])
    assert row["lost"] == 1 and row["datasets"] == 4000
    assert row["mean"] == pytest.approx(0.26, abs=0.001)
    assert row["mean_low"] > 0.25 and row["mean_high"] - row["mean"] == pytest.approx(
        1.96 * 0.02 / np.sqrt(4000), rel=0.05
    )
    assert row["root_mean_square_error"] == pytest.approx(np.hypot(0.01, 0.02), rel=0.03)
    assert row["bootstrap_standard_error"] == pytest.approx(0.02, rel=0.03)
    # an interval of ±1.96 standard errors about an estimate that is half a standard error off
    assert row["coverage"] == pytest.approx(0.92, abs=0.015)
    few = [None, ({"a": 0.2}, {"a": 0.21}), ({"b": 0.2}, {"b": 0.2})]
    assert recovery_row("a", 0.25, few) == {"truth": 0.25, "datasets": 1, "lost": 2}


@pytest.mark.parametrize("name", ["additive", "gaussian", "scaled", "scaled_full"])
def test_a_known_law_has_the_recorded_variance_and_the_names_of_the_estimates(recorded, name):
    options = stage.Options({name: []}, [0.25], takes=12, stride=2, datasets=2)
    (case,) = stage.known_laws(recorded, options)
    law = build_model(case.truth.parameters)
    mean = law.covariance(recorded.chain, recorded.q, recorded.v).mean(axis=(0, 1))
    np.testing.assert_allclose(np.trace(mean), np.trace(mean_covariance(recorded.noise)), rtol=1e-6)
    assert set(case.truth.values) == set(estimate(recorded, case.estimators["–"]).estimates)


def test_the_papers_covariance_is_off_by_the_measurement_noise_and_the_shrunk_one_is_not(recorded):
    options = stage.Options({"additive": ["paper", "shrinkage"]}, [0.25], 12, 1, datasets=40)
    part = replace(recorded, known_measurement=recorded.measurement)
    (case,) = stage.known_laws(part, options)
    pairs = [stage.recover((case, i), part, 7) for i in range(options.datasets)]
    for j in range(3):
        name = f"sigma_omega_{j + 1}{j + 1}_rad2"
        paper, shrunk = (
            recovery_row(name, case.truth.values[name], [pair[each] for pair in pairs])
            for each in ("paper", "shrinkage")
        )
        bias = paper["mean"] - paper["truth"]
        half = paper["mean_high"] - paper["mean"]
        assert abs(bias - part.measurement[j, j]) < 2.5 * half
        assert bias > half and abs(shrunk["mean"] - shrunk["truth"]) < bias
