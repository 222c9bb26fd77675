"""The particle filter against exact posteriors: the Kalman filter's, a direct integration over the
joint's range, and Pinocchio's displacement of the tip; its worth in a closed loop.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from numpy.random import default_rng
from sample_options import filter_options
from scipy.spatial.transform import Rotation
from scipy.stats import norm
from sliding_arm import sliding_arm

from pipeline.arm.chain import SerialChain
from pipeline.filtering.linear import linear_filter
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Posterior, Start, particle_filter
from pipeline.filtering.sampling import SCHEMES
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.closed_loop import MeanPath
from pipeline.models.draws import draw_steps
from pipeline.models.model import Commands, Traits, open_loop

DT = 0.01
# rows are the joints' directions: what a step of the task moves the joints by is constant
AXES = np.array([[1.0, 0.2, 0.1], [-0.4, 1.0, 0.3], [0.3, -0.5, 1.0]])
AXES /= np.linalg.norm(AXES, axis=1, keepdims=True)
INVERSE = np.linalg.inv(AXES.T)
LINEAR = sliding_arm(AXES, np.full(3, -50.0), np.full(3, 50.0))
NOISE = 1e-5 * np.array([[3.3, -2.0, 1.0], [-2.0, 5.5, -3.0], [1.0, -3.0, 9.0]])
START = Start(
    np.array([0.3, -0.2, 0.5]),
    1e-4 * np.array([[4.0, 1.0, 0.0], [1.0, 3.0, -1.0], [0.0, -1.0, 2.0]]),
)
_K = np.arange(60)
STEPS = 0.02 * np.stack([np.sin(0.1 * _K), np.cos(0.07 * _K), np.ones(60)], axis=1)


def measured_path(t: np.ndarray) -> Measurements:
    """Measurements of one path of the linear model, each frame with its own bias and covariance."""
    rng = default_rng(11)
    moves = STEPS @ INVERSE.T + rng.multivariate_normal(np.zeros(3), NOISE, len(STEPS))
    path = START.mean + np.cumsum(moves, axis=0)
    grid = DT * np.arange(1, len(STEPS) + 1)
    truth = np.stack([np.interp(t, grid, path[:, j]) for j in range(3)], axis=1)
    bias = 0.05 * np.sin(np.outer(t, [3.0, 5.0, 7.0]))
    root = 0.02 * (np.eye(3) + 0.3 * rng.standard_normal((len(t), 3, 3)))
    noise = np.matvec(root, rng.standard_normal((len(t), 3)))
    covariance = root @ np.swapaxes(root, 1, 2)
    return Measurements("test01", t, truth + bias + noise, bias, covariance)


FRAMES = measured_path(np.arange(18) / 30 + 0.004)
BAND = 2.0  # root mean square over some hundred correlated deviations


def kalman(measurements: Measurements) -> tuple[np.ndarray, np.ndarray]:
    """Exact filtering means (M+1, 3) and covariances (M+1, 3, 3) of the linear model, on the pair
    of poses that bound a step.
    """
    frames, due, shares = measurements.schedule(len(STEPS), DT)
    mean = np.tile(START.mean, 2)
    covariance = np.tile(START.covariance, (2, 2))
    means, covariances = [], []
    unbiased = measurements.y - measurements.bias
    for k in range(len(STEPS) + 1):
        if k > 0:
            last = covariance[3:, 3:]
            mean = np.concatenate([mean[3:], mean[3:] + INVERSE @ STEPS[k - 1]])
            covariance = np.block([[last, last], [last, last + NOISE]])
        for frame, share in zip(frames[due == k], shares[due == k], strict=True):
            observation = np.hstack([(1 - share) * np.eye(3), share * np.eye(3)])
            across = observation @ covariance
            total = across @ observation.T + measurements.covariance[frame]
            gain = np.linalg.solve(total, across).T
            mean = mean + gain @ (unbiased[frame] - observation @ mean)
            covariance = covariance - gain @ across
        means.append(mean[3:])
        covariances.append(covariance[3:, 3:])
    return np.array(means), np.array(covariances)


def distance(runs: list[Posterior], *exact_moments: np.ndarray) -> np.ndarray:
    """Root mean square deviation of the runs' average from the exact mean and covariance, in
    standard errors taken from the independent runs; about 1 where the filter is right.
    """
    deviations = []
    for name, exact in zip(("mean", "covariance"), exact_moments, strict=True):
        values = np.array([getattr(run, name) for run in runs])
        error = values.std(axis=0, ddof=1) / np.sqrt(len(runs))
        difference = values.mean(axis=0) - exact
        varies = error > 1e-15
        standardised = difference[varies] / error[varies]
        deviations.append(np.sqrt(np.mean(standardised**2)))
    return np.array(deviations)


def runs_of(
    model,
    chain,
    steps,
    start,
    measurements,
    options,
    seeds=range(16),
) -> list[Posterior]:
    problem = model, chain, open_loop(steps), DT, start, measurements, options
    return [particle_filter(*problem, default_rng(seed)) for seed in seeds]


@pytest.mark.parametrize("scheme", [name for name in SCHEMES if name != "none"])
def test_with_a_linear_model_and_normal_noise_the_posterior_is_the_kalman_filters(
    scheme,
):
    options = filter_options(2000, scheme)
    runs = runs_of(AdditiveModel(NOISE), LINEAR, STEPS, START, FRAMES, options)
    exact = kalman(FRAMES)
    assert all(run.resampled.any() for run in runs)
    assert np.all(distance(runs, *exact) < BAND)

    # control: motion noise half as large again
    runs = runs_of(AdditiveModel(1.5 * NOISE), LINEAR, STEPS, START, FRAMES, options)
    assert np.all(distance(runs, *exact) > 2 * BAND)


@dataclass(frozen=True)
class Remembering:
    """The error e about the commanded pose follows e + ω: ω = ``decay``·(e − e₋₁) + N(0, NOISE)."""

    decay: float
    traits: ClassVar = Traits(
        noisy_at_rest=True,
        needs_jacobian=False,
        compiled=False,
        memory=True,
    )

    def first_memory(self, q, commanded, rng) -> np.ndarray:
        return np.zeros(q.shape)  # e − e₋₁

    def advance(self, chain, q, v, memory, rng) -> tuple[np.ndarray, np.ndarray]:
        noise = rng.standard_normal(q.shape) @ np.linalg.cholesky(NOISE).T
        change = self.decay * memory + noise
        return q + chain.nominal_step(q, v) + change, change


def remembered(decay: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean (M+1, 3) and covariance (M+1, 3, M+1, 3) of the path of :class:`Remembering`."""
    grid = len(STEPS) + 1
    mean = START.mean + np.vstack([np.zeros(3), np.cumsum(STEPS @ INVERSE.T, axis=0)])
    # response of pose k to the noise of step l: 1 + decay + … + decay^(k − l)
    lags = np.arange(grid)[:, None] - np.arange(1, grid)
    response = np.where(
        lags >= 0,
        (1 - decay ** (lags.clip(0) + 1.0)) / (1 - decay),
        0.0,
    )
    covariance = np.einsum("kl,ml,ij->kimj", response, response, NOISE)
    return mean, covariance + START.covariance[:, None]


def test_a_law_with_a_memory_has_the_exact_posterior_of_its_path():
    exact = linear_filter(*remembered(0.7), [FRAMES], DT)
    options, seeds = filter_options(1000), range(8)
    means, covariances = exact

    def distance_of(decay: float) -> np.ndarray:
        model = Remembering(decay)
        runs = runs_of(model, LINEAR, STEPS, START, FRAMES, options, seeds)
        assert all(run.resampled.any() for run in runs)
        return distance(runs, means[0], covariances[0])

    assert np.all(distance_of(0.7) < BAND)
    # control: a law with another memory
    assert np.all(distance_of(0.4) > 2 * BAND)


# one joint that turns the tip about the base, from PHASE on, and the tip's height as the task: its
# step v/cos is nonlinear
PHASE, VARIANCE = 0.6, 0.015**2
WALLS = (-0.03, 0.6)  # limits of the joint, rad
FAST = np.full((10, 1), 0.035)
AT_WALL = Start(np.zeros(1), np.array([[0.03**2]]))
WALL_FRAMES = Measurements(
    "test01",
    np.array([0.0, 0.013, 0.016, 0.0333, 0.06, 0.0734, 0.1, 0.2]),
    np.array([[-0.02, 0.05, 0.06, 0.15, 0.27, 0.37, 0.56, 9.0]]).T,
    np.zeros((8, 1)),
    np.full((8, 1, 1), 0.02**2),
)


def integrated(measurements: Measurements) -> tuple[np.ndarray, np.ndarray]:
    """Posterior mean and variance by integration over a grid of the joint's range."""
    edges = np.linspace(*WALLS, 1401)
    q = (edges[1:] + edges[:-1]) / 2
    cell = q[1] - q[0]
    frames, due, shares = measurements.schedule(len(FAST), DT)
    density = norm.pdf(q, AT_WALL.mean[0], 0.03)
    density /= density.sum() * cell
    after_step = q + FAST[0, 0] / np.cos(q + PHASE)
    kernel = norm.pdf(q, after_step[:, None], np.sqrt(VARIANCE))
    means, variances = [], []
    for k in range(len(FAST) + 1):
        joint = density[:, None] * kernel
        if k == 0:
            joint = np.diag(density / cell)
        for frame, share in zip(frames[due == k], shares[due == k], strict=True):
            pose = (1 - share) * q[:, None] + share * q[None, :]
            joint *= norm.pdf(measurements.y[frame, 0], pose, 0.02)
        density = joint.sum(axis=0) * cell
        density /= density.sum() * cell
        means.append((density @ q) * cell)
        variances.append((density @ (q - means[-1]) ** 2) * cell)
    return np.array(means), np.array(variances)


@pytest.fixture(scope="module")
def walled_runs() -> list[Posterior]:
    model = AdditiveModel(np.array([[VARIANCE]]))
    phase = Rotation.from_euler("z", PHASE).as_matrix().ravel()
    placements = np.array([[*phase, 0, 0, 0], [*np.eye(3).ravel(), 1.0, 0, 0]])
    ends = *np.array(WALLS)[:, None], np.ones(1)
    arm = SerialChain(("y",), 1.0, placements, np.zeros(1, dtype=bool), *ends)
    runs = runs_of(model, arm, FAST, AT_WALL, WALL_FRAMES, filter_options(8000))
    scalar_runs = []
    for run in runs:
        assert run.outside[0] > 0 and run.outside[1:].any() and run.left_out == 1
        mean, variance = run.mean[:, 0], run.covariance[:, 0, 0]
        scalar_runs.append(replace(run, mean=mean, covariance=variance))
    return scalar_runs


def test_a_nonlinear_model_within_joint_limits_has_the_posterior_of_a_direct_integration(
    walled_runs,
):
    assert np.all(distance(walled_runs, *integrated(WALL_FRAMES)) < BAND)


def test_the_integration_tells_frames_within_a_step_from_frames_moved_to_its_end(
    walled_runs,
):
    rounded = replace(WALL_FRAMES, t=np.ceil(np.round(WALL_FRAMES.t / DT, 6)) * DT)
    assert np.all(distance(walled_runs, *integrated(rounded)) > 2 * BAND)


DEVIATION = np.array([0.004, 0.006, 0.009])  # rad, that a loop of any share leaves


@pytest.mark.parametrize(
    "share, rms, coverage, wandering",
    [(0.03, 0.9, 0.08, 0.0), (0.9, 1.02, 0.03, 1.2)],
)
def test_the_filter_of_a_closed_loop_is_calibrated_and_the_open_loops_wanders(
    chain,
    share,
    rms,
    coverage,
    wandering,
):
    """Rms errors in units of the training mean's; a deviation outlasts a frame with share 0.03, and
    decays within a step with 0.9.
    """
    rng = default_rng(3)
    steps = 90
    count = 30
    sensor = 0.01
    progress = np.linspace(0.0, 1.0, steps + 1)[:, None]
    poses = np.array([0.4, 1.7, -0.3]) + progress * np.array([0.5, 0.4, -0.6])
    path = MeanPath(chain, poses)
    start = Start(poses[0], np.diag(DEVIATION**2))
    model = AdditiveModel(np.diag((1 - (1 - share) ** 2) * DEVIATION**2))
    takes = np.empty((count, steps + 1, 3))
    takes[:, 0] = poses[0] + DEVIATION * rng.standard_normal((count, 3))
    for k in range(steps):  # corrected by NumPy
        off = chain.displacement(chain.pose(takes[:, k]), chain.pose(poses[k]))
        v = path.v[k] + share * off
        takes[:, k + 1] = draw_steps(model, chain, takes[:, k], v, rng)[0]
    k = np.arange(3, steps + 1, 3)
    noise = np.tile(sensor**2 * np.eye(3), (len(k), 1, 1))
    zero = np.zeros((len(k), 3))
    y = takes[:, k] + sensor * rng.standard_normal((count, len(k), 3))
    measured = [Measurements("take", DT * k, angles, zero, noise) for angles in y]

    def filtered(commands: Commands) -> tuple[np.ndarray, np.ndarray]:
        options, arguments = filter_options(400), (model, chain, commands, DT, start)
        means, variances = [], []
        for take in measured:
            posterior = particle_filter(*arguments, take, options, rng)
            means.append(posterior.mean)
            variances.append(np.diagonal(posterior.covariance, axis1=1, axis2=2))
        error = np.stack(means) - takes
        squared = np.mean(error**2, axis=(0, 1))
        of_mean = np.mean((takes - poses) ** 2, axis=(0, 1))
        covered = np.mean(np.abs(error) <= np.sqrt(variances))
        return np.sqrt(squared / of_mean), covered

    closed, covered = filtered(path.commands(share))
    assert np.all(closed < rms) and covered == pytest.approx(0.683, abs=coverage)

    opened, _ = filtered(open_loop(path.v))
    assert np.all(opened > np.maximum(closed, wandering))
