"""The particle filter against exact posteriors: of a linear law with and without a memory, a direct
integration over the joint's range, and Pinocchio's displacement of the tip; its worth in a closed
loop.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from loop_takes import takes_in_loop
from noisy_frames import noisy_frames
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
GRID = len(STEPS) + 1
MEAN_PATH = START.mean + np.vstack([np.zeros(3), np.cumsum(STEPS @ INVERSE.T, axis=0)])


def measured_path(t: np.ndarray) -> Measurements:
    """Measurements of one path of the linear model, each frame with its own bias and covariance."""
    rng = default_rng(11)
    noise = rng.multivariate_normal(np.zeros(3), NOISE, len(STEPS))
    path = START.mean + np.cumsum(STEPS @ INVERSE.T + noise, axis=0)
    grid = DT * np.arange(1, GRID)
    truth = np.stack([np.interp(t, grid, joint) for joint in path.T], axis=1)

    bias = 0.05 * np.sin(np.outer(t, [3.0, 5.0, 7.0]))
    spread = rng.standard_normal((len(t), 3, 3))
    root = 0.02 * (np.eye(3) + 0.3 * spread)
    errors = np.matvec(root, rng.standard_normal((len(t), 3)))
    covariance = root @ np.swapaxes(root, 1, 2)
    return Measurements("test01", t, truth + bias + errors, bias, covariance)


FRAMES = measured_path(np.arange(18) / 30 + 0.004)
BAND = 2.0  # root mean square over some hundred correlated deviations


def distance(runs: list[Posterior], *exact_moments: np.ndarray) -> np.ndarray:
    """Root mean square deviation of the runs' average from the exact mean and covariance, in
    standard errors taken from the independent runs; about 1 where the filter is right.
    """
    distances = []
    for name, exact in zip(("mean", "covariance"), exact_moments, strict=True):
        values = np.array([getattr(run, name) for run in runs])
        error = values.std(axis=0, ddof=1) / np.sqrt(len(runs))
        deviation = values.mean(axis=0) - exact
        varies = error > 1e-15
        scores = deviation[varies] / error[varies]
        distances.append(np.sqrt(np.mean(scores**2)))
    return np.array(distances)


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


def exact_posterior(decay: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean (M+1, 3) and covariance (M+1, 3, 3) of the path of :class:`Remembering` given FRAMES;
    the Kalman filter's if nothing is remembered.
    """
    (mean,), (covariance,) = linear_filter(MEAN_PATH, remembered(decay), [FRAMES], DT)
    return mean, covariance


@pytest.mark.parametrize("scheme", [name for name in SCHEMES if name != "none"])
def test_with_a_linear_model_and_normal_noise_the_posterior_is_the_kalman_filters(
    scheme,
):
    options = filter_options(2000, scheme)
    exact = exact_posterior(0.0)

    assert np.all(distance(linear_runs(AdditiveModel(NOISE), options), *exact) < BAND)
    # control: motion noise half as large again
    wide = linear_runs(AdditiveModel(1.5 * NOISE), options)
    assert np.all(distance(wide, *exact) > 2 * BAND)


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


def linear_runs(model, options, seeds=range(16)) -> list[Posterior]:
    """Runs of the filter on the arm of constant Jacobian, all of which resample."""
    runs = runs_of(model, LINEAR, STEPS, START, FRAMES, options, seeds)
    assert all(run.resampled.any() for run in runs)
    return runs


def remembered(decay: float) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (M+1, 3, M+1, 3) of the path of :class:`Remembering`, whose mean is MEAN_PATH."""
    # response of pose k to the noise of step l: 1 + decay + … + decay^(k − l)
    lags = np.arange(GRID)[:, None] - np.arange(1, GRID)
    sums = (1 - decay ** (lags.clip(0) + 1.0)) / (1 - decay)
    response = np.where(lags >= 0, sums, 0.0)
    covariance = np.einsum("kl,ml,ij->kimj", response, response, NOISE)
    return covariance + START.covariance[:, None]


def test_a_law_with_a_memory_has_the_exact_posterior_of_its_path():
    options = filter_options(1000)
    seeds = range(8)
    exact = exact_posterior(0.7)

    assert np.all(
        distance(linear_runs(Remembering(0.7), options, seeds), *exact) < BAND,
    )
    # control: a law with another memory
    shorter = linear_runs(Remembering(0.4), options, seeds)
    assert np.all(distance(shorter, *exact) > 2 * BAND)


# one joint that turns the tip about the base, from PHASE on, and the tip's height as the task: its
# step v/cos is nonlinear
PHASE = 0.6
VARIANCE = 0.015**2
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
    after_step = q + FAST[0, 0] / np.cos(q + PHASE)
    kernel = norm.pdf(q, after_step[:, None], np.sqrt(VARIANCE))

    frames, due, shares = measurements.schedule(len(FAST), DT)
    density = norm.pdf(q, AT_WALL.mean[0], 0.03)
    means = []
    variances = []
    for k in range(len(FAST) + 1):
        density /= density.sum() * cell
        joint = density[:, None] * kernel  # of the poses before and after the step
        if k == 0:
            joint = np.diag(density / cell)
        for frame, share in zip(frames[due == k], shares[due == k], strict=True):
            pose = (1 - share) * q[:, None] + share * q
            joint *= norm.pdf(measurements.y[frame, 0], pose, 0.02)

        density = joint.sum(axis=0)
        weights = density / density.sum()
        mean = weights @ q
        means.append(mean)
        variances.append(weights @ (q - mean) ** 2)
    return np.array(means), np.array(variances)


@pytest.fixture(scope="module")
def walled_runs() -> list[Posterior]:
    identity = np.eye(3)
    turn = Rotation.from_euler("z", PHASE).as_matrix()
    placements = np.array([[*turn.ravel(), 0, 0, 0], [*identity.ravel(), 1.0, 0, 0]])
    lower, upper = np.array(WALLS)[:, None]
    turning = np.zeros(1, dtype=bool)
    arm = SerialChain(("y",), 1.0, placements, turning, lower, upper, np.ones(1))
    model = AdditiveModel(np.array([[VARIANCE]]))

    runs = runs_of(model, arm, FAST, AT_WALL, WALL_FRAMES, filter_options(8000))
    scalar_runs = []
    for run in runs:
        assert run.outside[0] > 0 and run.outside[1:].any() and run.left_out == 1
        mean = run.mean[:, 0]
        variance = run.covariance[:, 0, 0]
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


SENSOR = 0.01  # rad, standard deviation of a measured joint angle of the loop
LOOP_STEPS = 90


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
    progress = np.linspace(0.0, 1.0, LOOP_STEPS + 1)[:, None]
    poses = np.array([0.4, 1.7, -0.3]) + progress * np.array([0.5, 0.4, -0.6])
    path = MeanPath(chain, poses)
    model = AdditiveModel(np.diag((1 - (1 - share) ** 2) * DEVIATION**2))
    first = poses[0] + DEVIATION * rng.standard_normal((30, 3))
    takes = takes_in_loop(model, path, share, first, rng)
    k = np.arange(3, LOOP_STEPS + 1, 3)
    measured = noisy_frames(takes, k, DT, SENSOR**2 * np.eye(3), rng)
    of_mean = np.mean((takes - poses) ** 2, axis=(0, 1))
    start = Start(poses[0], np.diag(DEVIATION**2))

    def filtered(commands: Commands) -> tuple[np.ndarray, np.ndarray]:
        """Relative rms error of each joint, and share of errors within one σ."""
        problem = model, chain, commands, DT, start
        runs = [
            particle_filter(*problem, y, filter_options(400), rng) for y in measured
        ]
        error = np.stack([run.mean for run in runs]) - takes
        covariances = np.stack([run.covariance for run in runs])
        std = np.sqrt(np.diagonal(covariances, axis1=2, axis2=3))
        relative = np.sqrt(np.mean(error**2, axis=(0, 1)) / of_mean)
        return relative, np.mean(np.abs(error) <= std)

    closed, covered = filtered(path.commands(share))
    assert np.all(closed < rms) and covered == pytest.approx(0.683, abs=coverage)

    opened, _ = filtered(open_loop(path.v))
    assert np.all(opened > np.maximum(closed, wandering))
