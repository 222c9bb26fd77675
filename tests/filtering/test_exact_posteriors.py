"""The particle filter against exact posteriors: the Kalman filter's, and a direct integration over
the joint's range.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from exact_posterior import distance, kalman
from numba import njit
from scipy.stats import norm

from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Posterior, Start, particle_filter
from pipeline.filtering.resampling import SCHEMES
from pipeline.models.commands import open_loop
from pipeline.models.law import planar
from pipeline.models.model import Law

DT = 0.01


INVERSE = np.array([[4.0, 1.0, 0.2], [-6.0, 3.0, 0.5], [2.0, -4.0, 1.0]])


NOISE = 1e-5 * np.array([[3.3, -2.0, 1.0], [-2.0, 5.5, -3.0], [1.0, -3.0, 9.0]])


START = Start(
    np.array([0.3, -0.2, 0.5]),
    1e-4 * np.array([[4.0, 1.0, 0.0], [1.0, 3.0, -1.0], [0.0, -1.0, 2.0]]),
)


@dataclass
class Linear:
    """A constant inverse Jacobian and additive normal noise: the case in which the Kalman filter is
    exact.
    """

    noise: np.ndarray

    def law(self, chain):
        return Law(linear, np.linalg.cholesky(self.noise).ravel(), normals=(1, 3))


@njit
def linear(numbers, parameters, arm, poses):
    v, q, moved = planar(poses)
    for i in range(poses.count):
        for j in range(3):
            moved[j][i] = q[j][i]
            for k in range(3):
                moved[j][i] += (
                    INVERSE[j, k] * v[k][i] + parameters[3 * j + k] * numbers.normal[k, i]
                )
    return 0


def steps_of(count: int) -> np.ndarray:
    return 0.004 * np.stack(
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


@pytest.mark.parametrize("scheme", [name for name, scheme in SCHEMES.items() if scheme is not None])
def test_with_a_linear_model_and_normal_noise_the_posterior_is_the_kalman_filters(scheme, free):
    runs = independent_runs(Linear(NOISE), free, STEPS, START, FRAMES, FilterOptions(2000, scheme))
    assert all(run.resampled.any() for run in runs)
    assert np.all(distance(runs, *kalman(STEPS, DT, INVERSE, START, NOISE, FRAMES)) < BAND)


def test_a_motion_noise_half_as_large_again_is_told_from_the_kalman_filters(free):
    runs = independent_runs(Linear(1.5 * NOISE), free, STEPS, START, FRAMES, FilterOptions(2000))
    assert np.all(distance(runs, *kalman(STEPS, DT, INVERSE, START, NOISE, FRAMES)) > 2 * BAND)


class StateDependent:
    """A nonlinear step of the first joint with a spread of its own at each pose; the others stand
    still.
    """

    def law(self, chain):
        return Law(state_dependent, np.empty(0), normals=(1, 1))


@njit
def centre(q, v):
    return q + v * (1 + 0.5 * np.sin(5 * q))


@njit
def spread(q):
    return 0.006 + 0.01 * np.cos(9 * q) ** 2


@njit
def state_dependent(numbers, parameters, arm, poses):
    v, q, moved = planar(poses)
    for i in range(poses.count):
        moved[0][i] = centre(q[0][i], v[0][i]) + spread(q[0][i]) * numbers.normal[0, i]
        moved[1][i], moved[2][i] = q[1][i], q[2][i]
    return 0


WALLS = (-0.03, 0.6)  # limits of the first joint, rad


FAST = np.tile([0.03, 0.0, 0.0], (10, 1))


AT_WALL = Start(np.array([0.0, 0.0, 0.0]), np.diag([0.03**2, 0.0, 0.0]))


def along_first_joint(t, y) -> Measurements:
    frames = len(t)
    measured = np.stack([np.asarray(y), np.zeros(frames), np.zeros(frames)], axis=1)
    return Measurements(
        "test01",
        np.asarray(t),
        measured,
        np.zeros((frames, 3)),
        np.tile(np.diag([0.02**2, 1.0, 1.0]), (frames, 1, 1)),
    )


WALL_FRAMES = along_first_joint(
    [0.0, 0.013, 0.016, 0.0333, 0.06, 0.0734, 0.1, 0.2],
    [-0.02, 0.02, 0.03, 0.14, 0.16, 0.28, 0.33, 9.0],
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
    kernel = norm.pdf(
        q[None, :], centre.py_func(q, FAST[0, 0])[:, None], spread.py_func(q)[:, None]
    )
    means, variances, evidence = [], [], 0.0
    for k in range(len(FAST) + 1):
        joint = np.diag(density / cell) if k == 0 else density[:, None] * kernel
        for frame, share in due.get(k, ()):
            joint *= norm.pdf(
                measurements.y[frame, 0], (1 - share) * q[:, None] + share * q[None, :], 0.02
            )
            evidence += 2 * norm.logpdf(0.0)
        density = joint.sum(axis=0) * cell
        total = density.sum() * cell
        evidence += np.log(total)
        density /= total
        means.append((density @ q) * cell)
        variances.append((density @ (q - means[-1]) ** 2) * cell)
    return np.array(means), np.array(variances), evidence


@pytest.fixture(scope="module")
def walled_runs(free) -> list[Posterior]:
    walled = replace(
        free, lower=np.array([WALLS[0], -1.0, -1.0]), upper=np.array([WALLS[1], 1.0, 1.0])
    )
    return independent_runs(
        StateDependent(), walled, FAST, AT_WALL, WALL_FRAMES, FilterOptions(8000)
    )


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


def test_without_measurements_the_prior_propagates(free):
    unseen = measured_path(STEPS, np.empty(0), seed=11)
    (posterior,) = independent_runs(
        Linear(NOISE), free, STEPS, START, unseen, FilterOptions(4000), seeds=(5,)
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
