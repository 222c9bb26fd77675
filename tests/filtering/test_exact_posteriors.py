"""The particle filter against exact posteriors: the Kalman filter's, and a direct integration over
the joint's range.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exact_posterior import distance, kalman
from scipy.spatial.transform import Rotation
from scipy.stats import norm
from sliding_arm import sliding_arm

from pipeline.arm.serial import SerialChain
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Posterior, Start, particle_filter
from pipeline.filtering.resampling import SCHEMES
from pipeline.models.model import open_loop
from pipeline.models.scaled.law import ScaledModel

DT = 0.01


# rows are the joints' directions: what a step of the task moves the joints by is constant
AXES = np.array([[1.0, 0.2, 0.1], [-0.4, 1.0, 0.3], [0.3, -0.5, 1.0]])
AXES /= np.linalg.norm(AXES, axis=1, keepdims=True)
INVERSE = np.linalg.inv(AXES.T)


NOISE = 1e-5 * np.array([[3.3, -2.0, 1.0], [-2.0, 5.5, -3.0], [1.0, -3.0, 9.0]])


START = Start(
    np.array([0.3, -0.2, 0.5]),
    1e-4 * np.array([[4.0, 1.0, 0.0], [1.0, 3.0, -1.0], [0.0, -1.0, 2.0]]),
)


@pytest.fixture(scope="module")
def linear() -> SerialChain:
    return sliding_arm(AXES, np.full(3, -50.0), np.full(3, 50.0))


def steps_of(count: int) -> np.ndarray:
    return 0.02 * np.stack(
        [np.sin(0.1 * np.arange(count)), np.cos(0.07 * np.arange(count)), np.ones(count)], axis=1
    )


def measured_path(steps: np.ndarray, t: np.ndarray, seed: int) -> Measurements:
    """Measurements of one path of the linear model, with a bias and a covariance of each frame's
    own.
    """
    rng = np.random.default_rng(seed)
    path = START.mean + np.cumsum(
        steps @ INVERSE.T + rng.multivariate_normal(np.zeros(3), NOISE, len(steps)), axis=0
    )
    grid = DT * np.arange(1, len(steps) + 1)
    truth = np.stack([np.interp(t, grid, path[:, j]) for j in range(3)], axis=1)
    bias = 0.05 * np.sin(np.outer(t, [3.0, 5.0, 7.0]))
    root = 0.02 * (np.eye(3) + 0.3 * rng.standard_normal((len(t), 3, 3)))
    noise = np.einsum("fij,fj->fi", root, rng.standard_normal((len(t), 3)))
    return Measurements("test01", t, truth + bias + noise, bias, root @ np.swapaxes(root, 1, 2))


STEPS = steps_of(60)


FRAMES = measured_path(STEPS, np.arange(18) / 30 + 0.004, seed=11)


# root mean squares over some hundred correlated deviations for the moments, a single deviation for
# the evidence
BAND = np.array([2.0, 2.0, 4.0])


def independent_runs(
    model, chain, steps, start, measurements, options, seeds=range(16)
) -> list[Posterior]:
    problem = model, chain, open_loop(steps), DT, start, measurements, options
    return [particle_filter(*problem, np.random.default_rng(seed)) for seed in seeds]


@pytest.mark.parametrize("scheme", [name for name in SCHEMES if name != "none"])
def test_with_a_linear_model_and_normal_noise_the_posterior_is_the_kalman_filters(scheme, linear):
    runs = independent_runs(
        ScaledModel(NOISE), linear, STEPS, START, FRAMES, FilterOptions(2000, scheme)
    )
    assert all(run.resampled.any() for run in runs)
    assert np.all(distance(runs, *kalman(STEPS, DT, INVERSE, START, NOISE, FRAMES)) < BAND)


def test_a_motion_noise_half_as_large_again_is_told_from_the_kalman_filters(linear):
    runs = independent_runs(
        ScaledModel(1.5 * NOISE), linear, STEPS, START, FRAMES, FilterOptions(2000)
    )
    assert np.all(distance(runs, *kalman(STEPS, DT, INVERSE, START, NOISE, FRAMES)) > 2 * BAND)


# one joint that turns the tip about the base, from PHASE on, and the tip's height as the task: its
# step v/cos is nonlinear, and so is the noise that grows with it
PHASE, FLOOR, GAIN = 0.6, 0.006**2, 0.3**2


def turning_arm(lower: float, upper: float) -> SerialChain:
    phase = Rotation.from_euler("z", PHASE).as_matrix().ravel()
    placements = np.array([[*phase, 0, 0, 0], [*np.eye(3).ravel(), 1.0, 0, 0]])
    ends = np.array([lower]), np.array([upper]), np.ones(1)
    return SerialChain(("y",), 1.0, placements, np.zeros(1, dtype=bool), *ends)


def step_of(q: np.ndarray, v: float) -> np.ndarray:
    return v / np.cos(q + PHASE)


WALLS = (-0.03, 0.6)  # limits of the first joint, rad


FAST = np.full((10, 1), 0.035)


AT_WALL = Start(np.zeros(1), np.array([[0.03**2]]))


def frames_of(t, y) -> Measurements:
    y = np.array(y)[:, None]
    return Measurements(
        "test01", np.array(t), y, np.zeros_like(y), np.full((len(y), 1, 1), 0.02**2)
    )


WALL_FRAMES = frames_of(
    [0.0, 0.013, 0.016, 0.0333, 0.06, 0.0734, 0.1, 0.2],
    [-0.02, 0.05, 0.06, 0.15, 0.27, 0.37, 0.56, 9.0],
)


def integrated(measurements: Measurements) -> tuple[np.ndarray, np.ndarray, float]:
    """Posterior mean, variance and log-evidence of the first joint by integration over a grid of
    the joint's range.
    """
    edges = np.linspace(*WALLS, 1401)
    cell, q = edges[1] - edges[0], (edges[1:] + edges[:-1]) / 2
    due, _ = measurements.schedule(len(FAST), DT)
    density = norm.pdf(q, AT_WALL.mean[0], 0.03)
    density /= density.sum() * cell
    step = step_of(q, FAST[0, 0])[:, None]
    kernel = norm.pdf(q[None, :], q[:, None] + step, np.sqrt(FLOOR + GAIN * step**2))
    means, variances, evidence = [], [], 0.0
    for k in range(len(FAST) + 1):
        joint = np.diag(density / cell) if k == 0 else density[:, None] * kernel
        for frame, share in due.get(k, ()):
            joint *= norm.pdf(
                measurements.y[frame, 0], (1 - share) * q[:, None] + share * q[None, :], 0.02
            )
        density = joint.sum(axis=0) * cell
        total = density.sum() * cell
        evidence += np.log(total)
        density /= total
        means.append((density @ q) * cell)
        variances.append((density @ (q - means[-1]) ** 2) * cell)
    return np.array(means), np.array(variances), evidence


@pytest.fixture(scope="module")
def walled_runs() -> list[Posterior]:
    model = ScaledModel(np.array([[FLOOR]]), np.array([[GAIN]]))
    arm = turning_arm(*WALLS)
    return independent_runs(model, arm, FAST, AT_WALL, WALL_FRAMES, FilterOptions(8000))


def distance_from_integral(runs: list[Posterior], measurements: Measurements) -> np.ndarray:
    mean, variance, evidence = integrated(measurements)
    first = [replace(run, mean=run.mean[:, 0], covariance=run.covariance[:, 0, 0]) for run in runs]
    return distance(first, mean, variance, evidence)


def test_a_nonlinear_model_within_joint_limits_has_the_posterior_of_a_direct_integration(
    walled_runs,
):
    assert all(
        run.outside[0] > 0 and run.outside[1:].any() and run.left_out == 1 for run in walled_runs
    )
    assert np.all(distance_from_integral(walled_runs, WALL_FRAMES) < BAND)


def test_the_integration_tells_frames_within_a_step_from_frames_moved_to_its_end(walled_runs):
    rounded = replace(WALL_FRAMES, t=np.ceil(np.round(WALL_FRAMES.t / DT, 6)) * DT)
    assert np.all(distance_from_integral(walled_runs, rounded) > 2 * BAND)


def test_without_measurements_the_prior_propagates(linear):
    unseen = measured_path(STEPS, np.empty(0), seed=11)
    (posterior,) = independent_runs(
        ScaledModel(NOISE), linear, STEPS, START, unseen, FilterOptions(4000), seeds=(5,)
    )
    mean, covariance, _ = kalman(STEPS, DT, INVERSE, START, NOISE, unseen)
    deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2) / 4000)
    assert np.max(np.abs(posterior.mean - mean) / deviation) < 4.5
    # the standard error of a normal sample's variance is √(2/P) of it
    growth = np.diagonal(posterior.covariance, axis1=1, axis2=2) / np.diagonal(
        covariance, axis1=1, axis2=2
    )
    assert np.max(np.abs(growth - 1)) < 4.5 * np.sqrt(2 / 4000)
    assert posterior.ess == pytest.approx(4000)
    assert not posterior.measured.any() and not posterior.resampled.any()
    assert posterior.log_evidence == 0.0
