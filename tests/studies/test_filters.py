"""Simulated recordings have the laboratory's motions and noise, and deviations with the moments of
their law; filters have scores beside the training mean, over durations and on the page.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2
from study_runs import options_of

from pipeline.core import rng
from pipeline.core.filters import MEMORY, NONE
from pipeline.laboratory import dynamics
from pipeline.laboratory.dynamics import Chance, draw, expose, swing
from pipeline.statistics.scores import Filtered, training_mean
from pipeline.studies.filters import stage
from pipeline.studies.filters.stage import COVERAGE, LOG, RMS, YARDSTICK
from pipeline.studies.simulated import PhysicsFactors, disturb, measure_poses, observe, perform

JOINTS = ["a", "b"]
STILL = PhysicsFactors(disturbances=0.0)


def test_a_condition_without_factors_moves_as_the_recorded_takes_of_its_seed(laboratory):
    own, stream = laboratory.dynamics, rng.stream(5, "record.session")
    recorded_session = dynamics.open_session(laboratory.chain, own, stream)
    for number, take in enumerate(perform(laboratory, PhysicsFactors(), 5, "test", 2)):
        stream = rng.stream(5, "record.test", number)
        motion = dynamics.perform(recorded_session, laboratory.motion, own, stream)
        duration = laboratory.motion.duration
        frames = dynamics.depth_frames(motion.swing, duration, laboratory.clock, stream)
        np.testing.assert_array_equal(take.poses, motion.motion_capture)
        np.testing.assert_array_equal(take.seen, frames.joints)


@pytest.mark.parametrize(
    ("factors", "scaled"),
    [
        ({"clearance": 2.0}, {"clearance": 2.0}),
        ({"speed_exponent": 0.5}, {"speed_exponent": 0.5}),
        ({"lasting": 10.0}, {"sway_time": 10.0, "clearance_time": 10.0}),
    ],
)
def test_a_factor_scales_its_disturbance_alone(laboratory, factors, scaled):
    own = laboratory.dynamics
    changed = {name: factor * getattr(own, name) for name, factor in scaled.items()}
    assert disturb(own, PhysicsFactors(**factors)) == replace(own, **changed)


def test_measured_poses_have_the_noise_of_the_motion_capture_times_its_factor(laboratory):
    takes, factor = perform(laboratory, STILL, 5, "train", 8), 3.0
    poses = measure_poses(takes, laboratory.pose_noise, factor, np.random.default_rng(3))
    noise = poses - np.stack([take.poses for take in takes])
    root = factor * np.linalg.cholesky(laboratory.pose_noise)
    squares = np.sum(np.linalg.solve(root, noise.reshape(-1, 3).T) ** 2, axis=1)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], noise.size // 3)  # 1 in 1000 for each of three axes
    assert np.all((low < squares) & (squares < high))
    # the control: another factor would be seen
    assert not np.any((low < squares * 1.2) & (squares * 1.2 < high))


def test_the_depth_cameras_noise_has_the_interpolated_moments_and_is_estimated_so(laboratory):
    draws = laboratory.depth_noise.sample(np.full(20_000, 0.25), np.random.default_rng(4))
    variance = 0.75 * 1e-4 + 0.25 * 4e-4
    error = 4 * np.sqrt(variance / len(draws))
    np.testing.assert_allclose(draws.mean(axis=0), [0.015, 0.01, 0.0], atol=error)
    wide = 4 * variance * np.sqrt(2 / len(draws))
    np.testing.assert_allclose(np.cov(draws.T), variance * np.eye(3), atol=wide)
    _, camera = observe(laboratory, PhysicsFactors(disturbances=0.0, motion_capture=0.0), 5, 2, 12)
    everywhere = camera.noise[camera.noise["take"] == "none"]
    share = everywhere["t"].to_numpy() / laboratory.motion.duration
    error = 4.5 * np.sqrt((1e-4 + share * 3e-4) / 12)
    assert np.all(np.abs(everywhere["b:a"] - 0.02 * (1 - share)) < error)
    assert np.all(np.abs(everywhere["b:b"] - 0.04 * share) < error)


SIZES = ("clearance", "speed_error_std", "start_std", "encoder_ripple", "jitter_std")
AT_REST = {"sway_std": (0.0, 0.0, 0.0)} | dict.fromkeys(SIZES, 0.0)
EVERY, CLOSE = slice(5, None, 9), slice(20, 45, 3)  # steps of the motion grid that are compared
SWAY = {"sway_std": (3e-4, 1.7e-3, 0.0332)}
PARTS = {  # values, steps
    "sway": (SWAY, EVERY),
    "sway, lasting": (SWAY, CLOSE),
    "play": ({"clearance": 0.039}, EVERY),
    "servo": ({"speed_error_std": 0.1, "start_std": 4e-3}, EVERY),
    "ripple": ({"encoder_ripple": 4e-3}, EVERY),
}
TAKES = 160


def simulated(laboratory, dynamics, seed: int, steps: slice) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean path, and covariances (K, n, K, n) of K ``steps`` over the takes."""
    draws, motion = np.random.default_rng(seed), laboratory.motion
    grid = np.arange(round(motion.duration * motion.rate) + 1) / motion.rate
    drawn = [draw(laboratory.chain, motion, dynamics, draws) for _ in range(TAKES)]
    chance = Chance(*map(np.stack, zip(*drawn, strict=True)))
    t, q, _ = swing(laboratory.chain, np.zeros(3), motion, dynamics, chance)
    poses = np.array([expose(t, each, grid, dynamics, draws) for each in q])
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
    off = (scatter - law) / np.where(error > 0, error, 1)
    return float(np.sqrt(np.mean(off[moving][:, moving] ** 2)))


@pytest.mark.parametrize("part", PARTS)
def test_each_part_has_the_covariance_of_simulated_takes_and_not_another(laboratory, part):
    own, steps = PARTS[part]
    dynamics = replace(laboratory.dynamics, **(AT_REST | own))
    path, sample = simulated(laboratory, dynamics, 1, steps)
    # control: deviations of half the size, or that last three times as long
    other = {name: np.multiply(value, 0.5).tolist() for name, value in own.items()}
    if part == "sway, lasting":
        other = {"sway_time": 3 * dynamics.sway_time}
    right, wrong = (
        distance(stage.deviations(laboratory, each, path)[0][steps, :, steps], sample)
        for each in (dynamics, replace(dynamics, **other))
    )
    assert right < 2.0 < 3.0 < wrong


def known() -> dict[str, Filtered]:
    """Return the training mean, and a filter with half the errors of the training mean."""
    draws = np.random.default_rng(1)
    training, test = (draws.standard_normal((n, 12, 2)) for n in (200, 40))
    mean = training_mean(training, test)
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
    chosen = SimpleNamespace(particles=200, scheme="systematic", threshold=0.5)
    settings, ratios = SimpleNamespace(filter=chosen, seed=3), {}
    options = options_of("filters", model="additive", training=20, test=8)
    rows = {
        factor: stage.duration_rows(factor, laboratory, settings, options) for factor in (0.1, 10.0)
    }
    for factor, each in rows.items():
        errors = each[each["score"] == RMS]
        ratios[factor] = stage.error_ratio(errors).groupby(errors["filter"]).mean()
    assert rows[0.1]["left"].iloc[0] < 0.1 < 0.8 < rows[10.0]["left"].iloc[0]
    for name in (MEMORY, YARDSTICK, "additive_closed"):
        assert ratios[10.0][name] < 0.9 and ratios[10.0][name] < ratios[0.1][name]
    # the yardstick knows the law
    assert ratios[10.0][YARDSTICK] <= 1.1 * ratios[10.0].min()
