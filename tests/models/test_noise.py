"""Process noise of recorded joint angles, its sign and moments; models at the recorded total
variance, whose other properties do not change; and realisations, step by step and free-running.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
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
        q[:, k + 1] = q[:, k] + chain.inverse_jacobian(q[:, k]) @ v[k] + noise[:, k]

    assert_allclose(process_noise(chain, q, v), noise, atol=1e-15)


def test_the_measurement_noise_is_what_moves_at_rest():
    rng = default_rng(4)
    noise = rng.multivariate_normal(np.zeros(3), np.diag([1.0, 4.0, 9.0]), (400, 8))
    v = np.zeros((8, 3))
    v[3:6, 1] = 0.01
    noise[:, 3:6] *= 10

    assert_allclose(
        measurement_covariance(noise, v),
        np.diag([1.0, 4.0, 9.0]),
        atol=0.5,
    )

    # control: with the moving steps it would be far larger
    assert np.trace(takes_moments(noise)[1].mean(axis=0)) > 30 * 14 / 2
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
    data, model = recorded(size, m), MODELS[name]
    if m == 2 and name == "wishart":
        model = replace(model, decomposition=Decomposition("qr"))
    scaled = at_recorded_level(model, data)
    of_noise = float(np.trace(mean_covariance(data.noise)))

    assert model_trace(scaled, data) + np.trace(MEASUREMENT) == pytest.approx(
        of_noise,
        rel=1e-9,
    )

    # other parameters do not change, nor does the covariance over time of a normal model
    assert type(scaled) is type(model)
    for name in ("u", "decomposition"):
        assert getattr(scaled, name, None) == getattr(model, name, None)

    if not isinstance(model, WishartModel):
        at = data.chain, data.q, data.v
        ratio = model_trace(scaled, data) / model_trace(model, data)
        assert_allclose(
            scaled.covariance(*at),
            ratio * model.covariance(*at),
            rtol=1e-12,
        )

    # in a closed loop every take has its own commands
    closed = at_recorded_level(
        model,
        replace(data, v=np.tile(data.v, (len(data.q), 1, 1))),
    )

    assert model_trace(closed, data) == pytest.approx(
        model_trace(scaled, data),
        rel=1e-12,
    )


def test_there_is_no_level_without_noise_of_the_motion():
    at_rest = replace(recorded(), v=np.zeros_like(recorded().v))
    for model in MODELS.values():
        with pytest.raises(
            ModelDomainError,
            match="does not exceed the measurement noise",
        ):
            at_recorded_level(model, recorded(1e-6))
    for name in ("gaussian", "wishart"):
        with pytest.raises(
            ModelDomainError,
            match=r"no noise at any step|at rest at every step",
        ):
            at_recorded_level(MODELS[name], at_rest)
    with pytest.raises(
        ModelDomainError,
        match=r"at the limit .* of a finite covariance",
    ):
        at_recorded_level(MODELS["wishart"], recorded(1e3))


STD = np.array([1e-3, 2e-3, 3e-3])
SILENT = AdditiveModel(np.zeros((3, 3)))
NOISY = AdditiveModel(np.diag(STD**2))
MODES = ["one_step", "free_running"]


@pytest.fixture
def rng() -> np.random.Generator:
    return default_rng(21)


def takes(poses: np.ndarray, count: int, steps: int) -> np.ndarray:
    """(count, steps + 1, 3) recorded angles that wander about ``poses``."""
    wander = default_rng(22).normal(0, 0.01, (count, steps + 1, 3)).cumsum(axis=1)
    return poses[:count, None] + wander


def test_without_noise_single_steps_start_where_the_recording_was_and_a_free_run_adds_them_up(
    chain,
    poses,
    step,
    rng,
):
    q = takes(poses, 5, 8)
    v = np.tile(step, (8, 1))
    recorded = q.copy()
    single, run = (realize(SILENT, chain, q, v, mode, rng) for mode in MODES)
    nominal = (
        q[:, :-1] + np.linalg.solve(chain.jacobian(q[:, :-1]), v[..., None])[..., 0]
    )

    assert_allclose(single[0][:, 1:], nominal, rtol=1e-10)

    at = q[:, 0]
    for k in range(8):
        at = at + np.linalg.solve(chain.jacobian(at), v[k][:, None])[..., 0]
        assert_allclose(run[0][:, k + 1], at, rtol=1e-10)

    assert single[1:] == run[1:] == (0, 0)
    assert np.array_equal(run[0][:, 0], q[:, 0]) and np.array_equal(q, recorded)

    # recorded poses that differ do not count as spread of single steps
    _, deviation = realized_moments(chain, q, v, "one_step", single[0])
    assert deviation.max() < 1e-12 < single[0].std(axis=0).min()

    # of a free run the angles are compared, whatever the recorded ones do meanwhile
    _, deviation = realized_moments(chain, q, v, "free_running", run[0])
    assert_allclose(deviation, run[0].std(axis=0, ddof=1))


def test_the_bias_of_a_step_is_the_mean_of_many_draws_and_zero_for_a_normal_law(
    chain,
    poses,
    rng,
):
    q = np.tile(takes(poses, 5, 3), (2000, 1, 1))
    v = np.tile([0.0, 0.0, 0.01], (3, 1))
    wishart = WishartModel(0.3, Decomposition("pivoted_lu"))
    bias = mean_bias(wishart, chain, q, v)
    drawn = realize(wishart, chain, q, v, "one_step", rng)[0][:, 1:]
    off = (drawn - q[:, :-1] - chain.nominal_step(q[:, :-1], v)).mean(axis=0)

    assert bias[0] == 0 < bias[1:].min()
    assert_allclose(np.linalg.norm(off, axis=-1), bias[1:], rtol=0.3)
    assert mean_bias(MODELS["gaussian"], chain, q, v).max() < 1e-12
    assert np.isnan(
        mean_bias(MODELS["wishart without a covariance"], chain, q, v),
    ).all()


def test_a_free_run_that_reaches_a_singular_pose_is_lost_and_counted(chain, poses, rng):
    q, v = takes(poses, 3, 4), np.zeros((4, 3))
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
    count, steps = 2000, 16
    q = np.tile(poses[0], (count, steps + 1, 1))
    spread = realize(NOISY, chain, q, np.zeros((steps, 3)), mode, rng)[0].std(axis=0)[
        1:
    ]
    stated = STD * np.arange(1, steps + 1)[:, None] ** growth
    band = 4 / np.sqrt(2 * count)

    assert_allclose(spread, stated, rtol=band)

    # control: the other mode's law is far outside the band
    of_other_mode = STD * np.arange(1, steps + 1)[:, None] ** (0.5 - growth)
    assert np.abs(spread / of_other_mode - 1).max() > 5 * band
