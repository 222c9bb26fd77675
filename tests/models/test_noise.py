"""Process noise of recorded joint angles, its sign and moments; models at the recorded total
variance, whose other properties do not change; and realisations, step by step and free-running.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from random_arm import motion, random_arm

from pipeline.core.errors import ModelDomainError
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.draws import mean_bias, realize, realized_moments
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.steps import (
    Recorded,
    at_recorded_level,
    mean_covariance,
    measurement_covariance,
    process_noise,
    recorded_deviation,
)
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.statistics.takes import takes_moments

MEASUREMENT = 1e-10 * np.diag([1.0, 2.0, 3.0])
FULL = np.array([[2.0, -0.5, 0.1], [-0.5, 1.0, 0.2], [0.1, 0.2, 3.0]])
MODELS = {
    "additive": AdditiveModel(1e-7 * FULL),
    "gaussian": GaussianModel(0.1, 40.0),
    "wishart": WishartModel(0.1, Decomposition("pivoted_lu")),
    "wishart without a covariance": WishartModel(1.2, Decomposition("qr_transposed")),
}


def test_the_noise_put_into_a_motion_comes_out_measured_minus_nominal(chain):
    rng = default_rng(2)
    v = rng.uniform(-0.02, 0.02, (6, 3)) * [0.1, 0.1, 1]
    noise = 0.005 * rng.standard_normal((4, 6, 3))
    q = np.empty((4, 7, 3))
    q[:, 0] = [0.3, 1.6, -0.2]
    for k in range(6):
        nominal = chain.inverse_jacobian(q[:, k]) @ v[k]
        q[:, k + 1] = q[:, k] + nominal + noise[:, k]

    assert_allclose(process_noise(chain, q, v), noise, atol=1e-15)


def test_the_measurement_noise_is_what_moves_at_rest():
    variances = np.diag([1.0, 4.0, 9.0])
    noise = default_rng(4).multivariate_normal(np.zeros(3), variances, (400, 8))
    v = np.zeros((8, 3))
    v[3:6, 1] = 0.01
    noise[:, 3:6] *= 10

    assert_allclose(measurement_covariance(noise, v), variances, atol=0.5)

    # control: with the moving steps it would be far larger
    _, covariances = takes_moments(noise)
    assert np.trace(covariances.mean(axis=0)) > 30 * 14 / 2
    with pytest.raises(ModelDomainError, match="never rests"):
        measurement_covariance(noise, np.ones((8, 3)))


def test_the_recorded_deviation_is_over_the_takes_of_steps_or_of_angles():
    q, noise = default_rng(3).standard_normal((2, 4, 6, 3))
    steps, angles = (recorded_deviation(q, noise[:, 1:], mode) for mode in MODES)
    assert_allclose(steps[1:], np.std(noise[:, 1:], axis=0) * np.sqrt(4 / 3))
    assert_allclose(angles, np.std(q, axis=0) * np.sqrt(4 / 3))


def recorded(size: float = 1e-4, m: int = 3) -> Recorded:
    """Twelve takes of a motion that begins with a rest, their noise of ``size`` rad."""
    arm = random_arm(3, m)
    q, v = motion(arm, 40, 10)
    noise = size * default_rng(5).standard_normal((12, *q[:-1].shape))
    joints = ("one", "two", "three")
    return Recorded(arm, np.tile(q[:-1], (12, 1, 1)), v, noise, joints, MEASUREMENT)


def model_trace(model, recorded) -> float:
    """Mean trace of the exact covariance of a step over takes and steps, in rad²."""
    covariance = model.covariance(recorded.chain, recorded.q, recorded.v)
    return float(np.trace(covariance, axis1=-2, axis2=-1).mean())


@pytest.mark.parametrize("m", [3, 2])
@pytest.mark.parametrize("size", [1e-4, 1e-1])
@pytest.mark.parametrize("name", MODELS)
def test_at_the_recorded_level_the_total_variance_is_the_recorded_one(name, size, m):
    data = recorded(size, m)
    model = MODELS[name]
    if m == 2 and name == "wishart":
        model = replace(model, decomposition=Decomposition("qr"))

    scaled = at_recorded_level(model, data)

    total = model_trace(scaled, data) + np.trace(MEASUREMENT)
    of_noise = float(np.trace(mean_covariance(data.noise)))
    assert total == pytest.approx(of_noise, rel=1e-9)
    # other parameters do not change, nor does the covariance over time of a normal model
    assert type(scaled) is type(model)
    for parameter in ("u", "decomposition"):
        assert getattr(scaled, parameter, None) == getattr(model, parameter, None)
    if not isinstance(model, WishartModel):
        place = data.chain, data.q, data.v
        ratio = model_trace(scaled, data) / model_trace(model, data)
        covariance = ratio * model.covariance(*place)
        assert_allclose(scaled.covariance(*place), covariance, rtol=1e-12)

    # in a closed loop every take has its own commands
    commands = np.tile(data.v, (len(data.q), 1, 1))
    closed = at_recorded_level(model, replace(data, v=commands))
    expected = pytest.approx(model_trace(scaled, data), rel=1e-12)
    assert model_trace(closed, data) == expected


AT_REST = r"no noise at any step|at rest at every step"
NO_LEVEL = [  # model, size of the noise in rad, and the refusal
    *[(name, 1e-6, "does not exceed the measurement noise") for name in MODELS],
    ("gaussian", None, AT_REST),
    ("wishart", None, AT_REST),
    ("wishart", 1e3, r"at the limit .* of a finite covariance"),
]


@pytest.mark.parametrize(("name", "size", "words"), NO_LEVEL)
def test_there_is_no_level_without_noise_of_the_motion(name, size, words):
    if size is None:
        data = replace(recorded(), v=np.zeros_like(recorded().v))
    else:
        data = recorded(size)
    with pytest.raises(ModelDomainError, match=words):
        at_recorded_level(MODELS[name], data)


STD = np.array([1e-3, 2e-3, 3e-3])
SILENT = AdditiveModel(np.zeros((3, 3)))
NOISY = AdditiveModel(np.diag(STD**2))
MODES = ["one_step", "free_running"]


@pytest.fixture
def rng() -> np.random.Generator:
    return default_rng(21)


def takes(poses: np.ndarray, count: int, steps: int) -> np.ndarray:
    """(count, steps + 1, 3) recorded angles that wander about ``poses``."""
    moves = default_rng(22).normal(0, 0.01, (count, steps + 1, 3))
    return poses[:count, None] + moves.cumsum(axis=1)


def nominal_end(chain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Poses after a step without noise from ``q`` (..., 3) under ``v`` (3,) or (..., 3)."""
    step = np.linalg.solve(chain.jacobian(q), v[..., None])
    return q + step[..., 0]


def test_without_noise_single_steps_start_where_the_recording_was_and_a_free_run_adds_them_up(
    chain,
    poses,
    step,
    rng,
):
    q = takes(poses, 5, 8)
    v = np.tile(step, (8, 1))
    before = q.copy()
    (single, *lost), (run, *lost_run) = (
        realize(SILENT, chain, q, v, mode, rng) for mode in MODES
    )

    assert_allclose(single[:, 1:], nominal_end(chain, q[:, :-1], v), rtol=1e-10)
    for k in range(8):
        expected = nominal_end(chain, run[:, k], v[k])
        assert_allclose(run[:, k + 1], expected, rtol=1e-10)
    assert lost == lost_run == [0, 0]
    assert_array_equal(run[:, 0], q[:, 0])
    assert_array_equal(q, before)


def test_the_deviation_of_single_steps_has_no_spread_of_the_recorded_poses(
    chain,
    poses,
    step,
    rng,
):
    q = takes(poses, 5, 8)
    v = np.tile(step, (8, 1))
    single, run = (realize(SILENT, chain, q, v, mode, rng)[0] for mode in MODES)
    _, deviation = realized_moments(chain, q, v, "one_step", single)
    assert deviation.max() < 1e-12 < single.std(axis=0).min()

    # of a free run the angles are compared, whatever the recorded ones do meanwhile
    _, deviation = realized_moments(chain, q, v, "free_running", run)
    assert_allclose(deviation, run.std(axis=0, ddof=1))


def test_the_bias_of_a_step_is_the_mean_of_many_draws_and_zero_for_a_normal_law(
    chain,
    poses,
    rng,
):
    q = np.tile(takes(poses, 5, 3), (2000, 1, 1))
    v = np.tile([0.0, 0.0, 0.01], (3, 1))
    wishart = WishartModel(0.3, Decomposition("pivoted_lu"))
    drawn, *_ = realize(wishart, chain, q, v, "one_step", rng)
    nominal = q[:, :-1] + chain.nominal_step(q[:, :-1], v)
    off = (drawn[:, 1:] - nominal).mean(axis=0)

    bias = mean_bias(wishart, chain, q, v)
    without_bias = mean_bias(MODELS["gaussian"], chain, q, v)
    without_mean = mean_bias(MODELS["wishart without a covariance"], chain, q, v)

    assert bias[0] == 0 < bias[1:].min()
    assert_allclose(np.linalg.norm(off, axis=-1), bias[1:], rtol=0.3)
    assert without_bias.max() < 1e-12
    assert np.isnan(without_mean).all()


def test_a_free_run_that_reaches_a_singular_pose_is_lost_and_counted(chain, poses, rng):
    q = takes(poses, 3, 4)
    v = np.zeros((4, 3))
    first = q[0, 0]
    straight = first.copy()
    straight[1] = chain.straight
    v[0] = chain.jacobian(first) @ (straight - first)  # the others arrive elsewhere

    single, _, lost_single = realize(SILENT, chain, q, v, "one_step", rng)
    run, _, lost_run = realize(SILENT, chain, q, v, "free_running", rng)

    assert (lost_single, lost_run) == (0, 1)
    assert np.isfinite(single).all()
    lost = np.isnan(run).any(axis=-1)
    assert lost.sum(axis=1).tolist() == [3, 0, 0]
    assert lost[0].tolist() == [False, False, True, True, True]


@pytest.mark.parametrize(("mode", "growth"), [("one_step", 0.0), ("free_running", 0.5)])
def test_the_spread_stays_step_by_step_and_grows_with_the_root_of_time_running_freely(
    mode,
    growth,
    chain,
    poses,
    rng,
):
    count = 2000
    steps = 16
    q = np.tile(poses[0], (count, steps + 1, 1))
    drawn, *_ = realize(NOISY, chain, q, np.zeros((steps, 3)), mode, rng)
    spread = drawn.std(axis=0)[1:]
    time = np.arange(1, steps + 1)[:, None]
    band = 4 / np.sqrt(2 * count)

    assert_allclose(spread, STD * time**growth, rtol=band)
    # control: the other mode's law is far outside the band
    of_other_mode = STD * time ** (0.5 - growth)
    assert np.abs(spread / of_other_mode - 1).max() > 5 * band
