"""Closed loop: an arm without noise stays on the mean path. The fit returns κ within its standard
error for takes of every model in the loop, measured with noise; regression of the noise on the
measured deviation does not.
"""

from dataclasses import replace

import numpy as np
import pytest
from loop_takes import takes_in_loop
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from random_arm import motion, random_arm
from sample_options import filter_options
from scipy.linalg import block_diag

from pipeline.core.errors import ModelDomainError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Start, particle_filter
from pipeline.models import closed_loop
from pipeline.models.additive.fit import Options as Additive
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.gaussian.fit import Options as Gaussian
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.kinds import estimate
from pipeline.models.model import Commands, open_loop, without_measurement
from pipeline.models.steps import Estimate, Recorded, process_noise
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.fit import Options as Wishart
from pipeline.models.wishart.law import WishartModel

TAKES = 30
STEPS = 60
REST = 10
JOINTS = ("a", "b", "c")
POSE = np.array([3e-3, 3e-3, 4e-3])  # rad, standard deviation of a measured pose
COVARIANCE = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
UNSEEN = Measurements("take", np.empty(0), *np.empty((2, 0, 3)), np.empty((0, 3, 3)))
# a model, an estimator that accounts for the measurement noise, and a factor on that noise, so that
# the model's noise does not hide it
MODELS = {
    "additive": (
        AdditiveModel(COVARIANCE),
        Additive("additive", estimator="shrinkage"),
        1,
    ),
    "gaussian": (
        GaussianModel(0.1, 18.0),
        Gaussian("gaussian", estimator="likelihood"),
        2,
    ),
    "wishart": (
        WishartModel(0.2, Decomposition("qr")),
        Wishart("wishart", estimator="likelihood", decomposition="qr"),
        2,
    ),
}
SEVEN = {"still": (AdditiveModel(3e-5 * np.eye(7)), MODELS["additive"][1], 1)}  # joints


@pytest.fixture(scope="module")
def path(chain) -> closed_loop.MeanPath:
    """Mean path of a motion from rest to rest, of a planar arm with its base off the origin."""
    share = np.clip((np.arange(STEPS + 1) - REST) / (STEPS - 2 * REST), 0.0, 1.0)
    progress = (1 - np.cos(np.pi * share)) / 2
    poses = [0.4, 1.7, -0.3] + progress[:, None] * np.array([0.5, 0.4, -0.6])
    return closed_loop.MeanPath(replace(chain, origin=np.array([0.2, -0.1])), poses)


CASES = MODELS | SEVEN


def deviation_of(
    path: closed_loop.MeanPath,
    commands: Commands,
    off: np.ndarray,
) -> np.ndarray:
    """(STEPS + 1, 3) deviation from the path of an arm without noise that starts at ``off``."""
    still = Start(path.poses[0] + off, np.zeros((3, 3)))
    quiet = AdditiveModel(np.zeros((3, 3)))
    run = commands, 0.01, still, UNSEEN, filter_options(1), default_rng(1)
    return particle_filter(quiet, path.chain, *run).mean - path.poses


def test_on_the_mean_path_the_arm_stays_and_with_the_steps_of_the_poses_it_does_not(
    path,
):
    for commands in (path.commands(0.3), open_loop(path.v)):
        assert np.max(np.abs(deviation_of(path, commands, np.zeros(3)))) < 1e-12

    # control: differences of the tip's poses lead away, as J is evaluated before the step
    steps = np.diff(path.chain.coordinates(path.poses), axis=0)
    assert np.max(np.abs(deviation_of(path, open_loop(steps), np.zeros(3)))) > 1e-4


def takes_about_their_mean(path: closed_loop.MeanPath, v: np.ndarray, share: float):
    """(20, STEPS + 1, 3) poses of takes without noise under the commands ``v`` that correct
    ``share`` of their deviation from the mean of the takes, as in the fit.
    """
    chain = path.chain
    off = 1e-3 * default_rng(2).standard_normal((20, 3))
    poses = [path.poses[0] + off]
    for command in v:
        q = poses[-1]
        deviation = chain.displacement(chain.pose(q), chain.pose(q.mean(axis=0)))
        poses.append(q + chain.nominal_step(q, command + share * deviation))
    return np.stack(poses, axis=1)


def test_the_noise_left_in_a_loop_is_what_was_put_in_with_the_measurements(path):
    chain = path.chain
    share = 0.4
    v = path.v + 1e-9
    v[:5] = 0.0
    q = takes_about_their_mean(path, v, share)
    noise = process_noise(chain, q, v)
    recorded = Recorded(chain, q[:, :-1], v, noise, JOINTS, np.eye(3))
    assert_allclose(recorded.poses, q, atol=1e-15)

    mean_path = closed_loop.mean_path(recorded)
    closed = closed_loop.closed_loop_steps(recorded, mean_path, share)

    # the part common to all takes is the curvature of the mean path
    assert np.max(np.ptp(closed.noise, axis=0)) < 1e-5
    assert np.max(np.ptp(noise, axis=0)) > 1e-4
    assert not closed.v[:, :5].any() and closed.v[:, 5:].all()
    assert_allclose(closed.measurement, (1 + 0.6**2) / 2 * np.eye(3))
    # takes share the commands of an open loop alone
    takes = np.array([3, 3, 0])
    assert recorded.subset(takes).v is recorded.v
    assert_array_equal(closed.subset(takes).v, closed.v[takes])


def takes_of(
    kind: str,
    path: closed_loop.MeanPath,
    share: float,
    seed: int,
) -> Recorded:
    """Takes of a model in a loop with ``share`` κ, measured with noise and a constant of each
    take.
    """
    model, _, noisier = CASES[kind]
    rng = default_rng(seed)
    n = path.poses.shape[1]
    start = np.tile(path.poses[0], (TAKES, 1))
    q = takes_in_loop(model, path, share, start, rng)

    std = np.resize(noisier * POSE, n)
    measured = q + std * rng.standard_normal(q.shape)
    measured += 1e-3 * rng.standard_normal((TAKES, 1, n))
    noise = process_noise(path.chain, measured, path.v)
    measurement = 2 * np.diag(std**2)
    joints = tuple(f"joint_{j}" for j in range(n))
    return Recorded(path.chain, measured[:, :-1], path.v, noise, joints, measurement)


def fitted(kind: str, recorded: Recorded) -> closed_loop.ClosedLoopFit:
    _, options, _ = CASES[kind]
    return closed_loop.fit_closed_loop(recorded, options, estimate(recorded, options))


def regression(recorded: Recorded) -> float:
    """κ by regression of the noise on the deviation before it, of moving steps."""
    moving = np.any(recorded.v, axis=1)
    deviation = (recorded.q - recorded.q.mean(axis=0))[:, moving]
    noise = (recorded.noise - recorded.noise.mean(axis=0))[:, moving]
    return -float(np.sum(noise * deviation) / np.sum(deviation**2))


ARMS = [(kind, 3, 3) for kind in MODELS]  # model, joints and task rows
ARMS += [("additive", 3, 2), ("wishart", 3, 2), ("still", 7, 6)]


@pytest.mark.parametrize(("kind", "n", "m"), ARMS)
def test_the_share_comes_back_from_takes_of_every_model(kind, n, m, path):
    """Also on arms with more joints than task rows. Band: 4.5 standard errors, below a third of the
    share.
    """
    if n > m:
        arm = random_arm(n, m)
        poses, _ = motion(arm, STEPS, REST, size=0.08)
        path = closed_loop.MeanPath(arm, poses)

    fit = fitted(kind, takes_of(kind, path, 0.4, seed=1))

    assert abs(fit.share - 0.4) < 4.5 * fit.standard_error < 0.13


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["additive", "gaussian"])
def test_its_interval_covers_the_truth_as_it_says_and_the_regressions_does_not(
    kind,
    path,
):
    """At least 12 of 16 intervals of 95 % cover the truth, which nine in 10 000 such sets miss, and
    the mean deviation is within one standard error. Control: regression.
    """
    likelihood = []
    regressed = []
    for seed in range(16):
        recorded = takes_of(kind, path, 0.4, seed)
        fit = fitted(kind, recorded)
        likelihood.append((fit.share - 0.4) / fit.standard_error)
        regressed.append((regression(recorded) - 0.4) / fit.standard_error)

    bias = abs(np.mean(likelihood))
    assert np.sum(np.abs(likelihood) < 1.96) >= 12
    assert bias < 1.0
    assert np.sum(np.abs(regressed) < 1.96) < 12
    assert np.mean(regressed) - bias > 1.0


@pytest.mark.parametrize("kind", ["additive", "gaussian"])
def test_of_takes_in_an_open_loop_the_interval_holds_zero(kind, path):
    fit = fitted(kind, takes_of(kind, path, 0.0, seed=2))
    assert 0 <= fit.share < 1.96 * fit.standard_error < 0.02
    # control: a share of a tenth is detected
    closed = fitted(kind, takes_of(kind, path, 0.1, seed=2))
    assert closed.share > 3 * closed.standard_error


def covariance(n: int, scale: float, rng) -> np.ndarray:
    """(n, n) random covariance of about ``scale``²."""
    root = scale * rng.standard_normal((n, n))
    return root @ root.T + 0.1 * scale**2 * np.eye(n)


def log_likelihoods(
    space: closed_loop.StateSpace,
    deviation: np.ndarray,
    share: float,
) -> np.ndarray:
    """(takes,) log densities of e_k − e_0 for k > 0 as one normal vector, without a recursion; it
    contains no constant of a take.
    """
    takes, poses, n = deviation.shape
    steps = poses - 1
    begin, _ = without_measurement(np.cov(deviation[:, 0].T), space.measurement)

    # rows of e_k − e_0 in (e_0, w_0, w_1, …)
    first = np.eye(n, n * poses)
    row = first
    rows = []
    for k in range(steps):
        transition = space.drift[k] - share * space.correction[k]
        row = transition @ row + np.eye(n, n * poses, n * (k + 1))
        rows.append(row - first)
    responses = np.vstack(rows)
    total = responses @ block_diag(begin, *space.noise) @ responses.T
    total += np.kron(np.eye(steps) + 1.0, space.measurement)  # n_k − n_0

    changes = (deviation[:, 1:] - deviation[:, :1]).reshape(takes, -1)
    squares = np.vecdot(changes, np.linalg.solve(total, changes.T).T)
    _, log_determinant = np.linalg.slogdet(total)
    return -0.5 * (squares + (takes - 1) / takes * log_determinant)


def test_the_likelihood_is_that_of_the_whole_motion_as_one_normal_vector():
    rng = default_rng(4)
    n = 2
    steps = 5
    takes = 6
    space = closed_loop.StateSpace(
        drift=np.eye(n) + 0.1 * rng.standard_normal((steps, n, n)),
        correction=np.eye(n) + 0.1 * rng.standard_normal((steps, n, n)),
        noise=np.stack([covariance(n, 1.0, rng) for _ in range(steps)]),
        measurement=covariance(n, 0.5, rng),
        moving=np.ones(steps, dtype=bool),
    )
    deviation = 2 * rng.standard_normal((takes, steps + 1, n))
    deviation -= deviation.mean(axis=0)

    shares = np.array([0.0, 0.3, 0.9])
    likelihoods = closed_loop.take_log_likelihoods(space, deviation, shares)

    expected = [log_likelihoods(space, deviation, share) for share in shares]
    assert_allclose(likelihoods, expected, rtol=1e-10)


def test_a_share_without_a_covariance_has_no_likelihood_and_the_others_keep_theirs():
    """The innovation y_1 − y_0 has the variance 1.99κ² − 0.2 + 0.02, negative at κ = 0.1."""
    unit = np.ones((1, 1, 1))
    matrices = unit, unit, -0.2 * unit, 0.01 * unit[0]
    space = closed_loop.StateSpace(*matrices, np.ones(1, dtype=bool))
    deviation = np.array([1.0, -1.0])[:, None, None] * np.ones((2, 2, 1))
    shares = np.array([1.0, 0.1])

    with np.errstate(all="raise"):
        both = closed_loop.take_log_likelihoods(space, deviation, shares)
        alone = closed_loop.take_log_likelihoods(space, deviation, shares[:1])

    assert np.all(np.isfinite(alone))
    assert_array_equal(both[:1], alone)
    assert np.all(both[1] == -np.inf)


def test_a_single_take_and_an_unknown_measurement_noise_are_refused(path):
    recorded = takes_of("additive", path, 0.4, seed=6)
    _, options, _ = MODELS["additive"]
    with pytest.raises(ModelDomainError, match="needs two takes"):
        closed_loop.fit_closed_loop(recorded.subset(np.array([3])), options, None)

    moving = np.any(recorded.v, axis=1)
    never_rests = replace(
        recorded,
        v=recorded.v[moving],
        q=recorded.q[:, moving],
        noise=recorded.noise[:, moving],
        known_measurement=None,
    )
    law = {"kind": "additive", "noise_covariance": COVARIANCE.tolist()}
    with pytest.raises(ModelDomainError, match="never rests"):
        closed_loop.fit_closed_loop(never_rests, options, Estimate(law, {}, {}))
