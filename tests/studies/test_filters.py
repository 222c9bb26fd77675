"""Scores beside the training mean, durations, the page that states both; the second moments of the
arm's deviations against simulated takes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
from study_runs import options_of

from pipeline.core.filters import MEMORY, NONE
from pipeline.filtering.particle_filter import FilterOptions
from pipeline.laboratory.dynamics import expose, simulate_take
from pipeline.laboratory.swing import desired_joints
from pipeline.models.kinds import options_type
from pipeline.statistics.filters import Filtered, no_filter
from pipeline.studies.filters import stage
from pipeline.studies.filters.deviations import deviations
from pipeline.studies.filters.stage import COVERAGE, LOG, RMS, YARDSTICK

JOINTS = ["a", "b"]


def known() -> dict[str, Filtered]:
    """The training mean, and a filter whose errors are half of its."""
    rng = np.random.default_rng(1)
    training, test = (rng.standard_normal((n, 12, 2)) for n in (200, 40))
    mean = no_filter(training, test)
    half = Filtered(mean.error / 2, mean.covariance / 4, np.zeros((2, 2)))
    return {NONE: mean, "half": half}


def test_a_filter_of_half_the_error_has_half_the_rms_and_ln_2_more_a_joint():
    rows = stage.score_rows(known(), JOINTS)
    half = rows[rows["filter"] == "half"].set_index(["score", "joint"])
    ratio = stage.error_ratio(half)
    assert ratio[RMS, "a"] == pytest.approx(0.5) and ratio[RMS, "b"] == pytest.approx(0.5)
    assert half.loc[(LOG, "all"), "difference"] == pytest.approx(2 * np.log(2))
    covered = rows[rows["score"] == COVERAGE].groupby("filter")["mean"].mean()
    assert covered["half"] == covered[NONE] == pytest.approx(0.68, abs=0.05)
    flags = stage.better_or_worse(rows)
    assert flags["better"].all() and not flags["worse"].any()


@pytest.mark.slow
def test_long_deviations_are_filtered_and_short_ones_are_not(laboratory):
    model = ("additive", options_type("additive")("additive", estimator="paper"))
    trial = partial(
        stage.duration_rows,
        laboratory=laboratory,
        model=model,
        filter_options=FilterOptions(200, "systematic", 0.5),
        sizes=(20, 8),
        seed=3,
    )
    rows = {factor: trial(factor) for factor in (0.1, 10.0)}
    ratios = {}
    for factor, each in rows.items():
        errors = each[each["score"] == RMS]
        ratios[factor] = stage.error_ratio(errors).groupby(errors["filter"]).mean()
    assert rows[0.1]["left"].iloc[0] < 0.1 < 0.8 < rows[10.0]["left"].iloc[0]
    for name in (MEMORY, YARDSTICK, "additive_closed"):
        assert ratios[10.0][name] < 0.9 and ratios[10.0][name] < ratios[0.1][name]
    # the yardstick knows the law
    assert ratios[10.0][YARDSTICK] <= 1.1 * ratios[10.0].min()


def test_the_page_names_filters_that_gain_in_a_score_and_lose_in_none():
    rows = stage.score_rows(known(), JOINTS)
    half = rows[rows["filter"] == "half"]
    others = [half.assign(filter=name) for name in (MEMORY, YARDSTICK)]
    rows = pd.concat([rows, *others], ignore_index=True)
    lasting = [rows.assign(factor=x, sway_time=0.01 * x, left=0.2 * x) for x in (1.0, 3.0)]
    options, tables = options_of("filters"), {"filters_lasting": pd.concat(lasting)}
    log = rows["score"] == LOG
    worse = rows.assign(high=rows["high"].mask(log, -1.0), low=rows["low"].mask(log, -2.0))
    for shown, name in ((rows, "half, open loop"), (worse, "none")):
        facts = stage.facts(tables | {"filters": shown}, options)
        assert facts["particle"].startswith(name)
        assert "half, open loop: 2 of 2 rms errors" in facts["sweep"]
    axes = stage.draw(rows, tables["filters_lasting"]).axes
    labels = [text.get_text() for text in axes[0].get_yticklabels()]
    assert labels == ["half, open loop", "linear, autocorrelation", "yardstick"]


STILL = {
    "sway_std": (0.0, 0.0, 0.0),
    "clearance": 0.0,
    "speed_error_std": 0.0,
    "start_std": 0.0,
    "encoder_ripple": 0.0,
    "jitter_std": 0.0,
}
PARTS = {
    "sway": {"sway_std": (3e-4, 1.7e-3, 0.0332)},
    "play": {"clearance": 0.039},
    "servo": {"speed_error_std": 0.1, "start_std": 4e-3},
    "ripple": {"encoder_ripple": 4e-3},
}
TAKES = 160
EVERY, CLOSE = slice(5, None, 9), slice(20, 45, 3)  # steps of the motion grid that are compared


def simulated(laboratory, dynamics, seed: int, steps: slice) -> tuple[np.ndarray, np.ndarray]:
    """The mean path, and covariances (K, n, K, n) of K ``steps`` over the takes."""
    rng, motion = np.random.default_rng(seed), laboratory.motion
    grid = np.arange(round(motion.duration * motion.rate) + 1) / motion.rate
    poses = []
    for _ in range(TAKES):
        t, q, _ = simulate_take(laboratory.chain, np.zeros(3), motion, dynamics, rng)
        poses.append(expose(t, q, grid, dynamics, rng))
    poses = np.array(poses)
    off = (poses - poses.mean(axis=0))[:, steps]
    return poses.mean(axis=0), np.einsum("tki,tlj->kilj", off, off) / (TAKES - 1)


def distance(covariance: np.ndarray, sample: np.ndarray) -> float:
    """Root mean square distance of ``sample`` from ``covariance``, both (K, n, K, n), in standard
    errors of the entries for normal takes, over entries that are none by their law.
    """
    size = covariance.shape[0] * covariance.shape[1]
    law, scatter = covariance.reshape(size, size), sample.reshape(size, size)
    variance = np.diag(law)
    moving = variance > 1e-3 * variance.max()
    error = np.sqrt((np.outer(variance, variance) + law**2) / (TAKES - 1))
    return float(
        np.sqrt(np.mean(((scatter - law) / np.where(error > 0, error, 1))[moving][:, moving] ** 2))
    )


@pytest.mark.parametrize("part", PARTS)
def test_each_part_has_the_covariance_of_simulated_takes_and_not_another(laboratory, part):
    dynamics = replace(laboratory.dynamics, **(STILL | PARTS[part]))
    path, sample = simulated(laboratory, dynamics, 1, EVERY)
    motion = laboratory.motion
    law = deviations(laboratory.chain, motion, dynamics, path)
    assert distance(law.covariance[EVERY, :, EVERY], sample) < 2.0
    # control: half as large
    smaller = {name: np.multiply(value, 0.5).tolist() for name, value in PARTS[part].items()}
    other = deviations(laboratory.chain, motion, replace(dynamics, **smaller), path)
    assert distance(other.covariance[EVERY, :, EVERY], sample) > 4.0


def test_how_long_a_deviation_lasts_is_seen_in_the_covariance_and_not_in_its_size(laboratory):
    dynamics, motion = replace(laboratory.dynamics, **(STILL | PARTS["sway"])), laboratory.motion
    other = replace(dynamics, sway_time=3 * dynamics.sway_time)
    path, sample = simulated(laboratory, dynamics, 2, CLOSE)
    _, lasting = simulated(laboratory, other, 2, CLOSE)
    law, longer = (
        deviations(laboratory.chain, motion, each, path).covariance for each in (dynamics, other)
    )
    np.testing.assert_allclose(law[5, :, 5], longer[5, :, 5])
    assert longer[40, 0, 46, 0] > 1.5 * law[40, 0, 46, 0] > 0
    for own, takes, wrong in ((law, sample, longer), (longer, lasting, law)):
        assert distance(own[CLOSE, :, CLOSE], takes) < 2.0
        assert distance(wrong[CLOSE, :, CLOSE], takes) > 3.0


def test_the_jitter_of_an_exposure_moves_a_pose_by_the_speed_alone(laboratory):
    motion = laboratory.motion
    dynamics = replace(laboratory.dynamics, **(STILL | {"jitter_std": 2e-3}))
    grid = np.arange(round(motion.duration * motion.rate) + 1) / motion.rate
    path, _ = desired_joints(grid, motion)
    law = deviations(laboratory.chain, motion, dynamics, path)
    assert np.all(law.covariance == 0)
    rng = np.random.default_rng(3)
    t, q, _ = simulate_take(laboratory.chain, np.zeros(3), motion, dynamics, rng)
    scatter = np.array([expose(t, q, grid, dynamics, rng) for _ in range(2000)])
    std = np.sqrt(np.diagonal(law.exposure, axis1=1, axis2=2))
    fast = std[:, 0] > 0.9 * std[:, 0].max()
    np.testing.assert_allclose(scatter.std(axis=0)[fast], std[fast], rtol=0.1)
