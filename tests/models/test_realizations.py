"""Realisations step by step and running freely: where each step starts, and how the spread
grows.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import ConfigError, ModelDomainError, SingularJacobianError
from pipeline.models import realizations
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.realizations import realize, realized_moments
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.wishart.law import WishartModel

STD = np.array([1e-3, 2e-3, 3e-3])
SILENT = ScaledModel(np.zeros((3, 3)))
NOISY = ScaledModel(np.diag(STD**2))
MODES = ["one_step", "free_running"]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(21)


def takes(poses: np.ndarray, count: int, steps: int) -> np.ndarray:
    """(count, steps + 1, 3) recorded angles that wander about ``poses``."""
    wander = np.random.default_rng(22).normal(0, 0.01, (count, steps + 1, 3)).cumsum(axis=1)
    return poses[:count, None] + wander


def test_without_noise_a_free_run_adds_up_its_nominal_steps(chain, poses, step, rng):
    q, v = takes(poses, 5, 8), np.tile(step, (8, 1))
    simulated, clipped, lost = realize(SILENT, chain, q, v, "free_running", rng)
    for take, run in zip(q, simulated, strict=True):
        at = take[0]
        for k in range(8):
            at = at + np.linalg.solve(chain.jacobian(at), v[k])
            np.testing.assert_allclose(run[k + 1], at, rtol=1e-10)
    assert clipped == lost == 0


def test_without_noise_a_single_step_starts_where_the_recording_was(chain, poses, step, rng):
    q, v = takes(poses, 5, 8), np.tile(step, (8, 1))
    simulated, _, _ = realize(SILENT, chain, q, v, "one_step", rng)
    nominal = q[:, :-1] + np.linalg.solve(chain.jacobian(q[:, :-1]), v[..., None])[..., 0]
    np.testing.assert_allclose(simulated[:, 1:], nominal, rtol=1e-10)
    # control: running freely it comes to other places
    assert np.abs(realize(SILENT, chain, q, v, "free_running", rng)[0] - simulated).max() > 1e-3


@pytest.mark.parametrize("mode", MODES)
def test_equal_streams_give_equal_realisations_and_each_starts_at_its_own_take(
    mode, chain, poses, step
):
    q, v = takes(poses, 5, 8), np.tile(step, (8, 1))
    recorded = q.copy()
    first, again, other = (
        realize(NOISY, chain, q, v, mode, np.random.default_rng(seed))[0] for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert np.array_equal(first[:, 0], q[:, 0]) and np.array_equal(q, recorded)


@pytest.mark.parametrize("mode", MODES)
def test_a_singular_recorded_pose_is_refused_and_another_mode_by_those_there_are(
    mode, chain, poses, step, rng
):
    q, v = takes(poses, 2, 3), np.tile(step, (3, 1))
    with pytest.raises(ConfigError, match="'two_step'; there are one_step, free_running") as why:
        realize(NOISY, chain, q, v, "two_step", rng)
    assert why.value.evidence["key"] == "simulation.mode"
    q[1, 0] = straight(chain, q[1, 0])
    with pytest.raises(SingularJacobianError):
        realize(NOISY, chain, q, v, mode, rng)


@pytest.mark.parametrize(("mode", "growth"), [("one_step", 0.0), ("free_running", 0.5)])
def test_the_spread_stays_step_by_step_and_grows_with_the_root_of_time_running_freely(
    mode, growth, chain, poses, rng
):
    count, steps = 2000, 16
    q = np.tile(poses[0], (count, steps + 1, 1))
    spread = realize(NOISY, chain, q, np.zeros((steps, 3)), mode, rng)[0].std(axis=0)[1:]
    stated = STD * np.arange(1, steps + 1)[:, None] ** growth
    band = 4 / np.sqrt(2 * count)
    np.testing.assert_allclose(spread, stated, rtol=band)
    # control: the other mode's law is far outside the band
    other = STD * np.arange(1, steps + 1)[:, None] ** (0.5 - growth)
    assert np.abs(spread / other - 1).max() > 5 * band


def test_clipped_steps_are_counted_over_all_realisations(chain, poses, step, rng):
    q, v = np.tile(poses[:5, None], (1, 9, 1)), np.tile(step, (8, 1))
    norm = np.linalg.norm(chain.inverse_jacobian(poses[:5]), axis=(1, 2))
    between = GaussianModel(0.1, np.sort(norm)[2:4].mean())
    assert realize(between, chain, q, v, "one_step", rng)[1] == 2 * 8


def straight(chain, q):
    """The pose with the second link in line with the first."""
    bend = chain.segment_headings(q)
    return q - np.array([0.0, bend[1] - bend[0], 0.0])


def test_a_realisation_that_comes_to_a_singular_pose_is_lost_and_counted(
    chain, poses, step, rng, monkeypatch
):
    def straightening(model, chain, q, v, rng):
        following, clipped = draw_steps(model, chain, q, v, rng)
        following[0] = straight(chain, following[0]) if len(following) == 6 else following[0]
        return following, clipped

    monkeypatch.setattr(realizations, "draw_steps", straightening)
    q, v = takes(poses, 6, 5), np.tile(step, (5, 1))
    simulated, _, lost = realize(SILENT, chain, q, v, "free_running", rng)
    assert lost == 1
    assert (
        np.isfinite(simulated[1:]).all()
        and np.isfinite(simulated[0, :2]).all()
        and np.isnan(simulated[0, 2:]).all()
    )


def test_recorded_poses_that_differ_do_not_count_as_spread_of_single_steps(chain, poses, step, rng):
    q, v = takes(poses, 50, 4), np.tile(step, (4, 1))
    realized, _, _ = realize(SILENT, chain, q, v, "one_step", rng)
    _, deviation, _ = realized_moments(SILENT, chain, q, v, "one_step", realized)
    assert deviation.max() < 1e-12 < realized.std(axis=0).min()


def test_a_model_without_covariance_has_a_mean_and_a_reason_and_no_spread(chain, poses, step, rng):
    wide, q, v = WishartModel(0.9), takes(poses, 5, 4), np.tile(step, (4, 1))
    realized, _, _ = realize(wide, chain, q, v, "one_step", rng)
    mean, deviation, refused = realized_moments(wide, chain, q, v, "one_step", realized)
    assert np.isfinite(mean).all() and np.isnan(deviation).all() and "covariance" in refused


def test_the_spread_of_a_single_surviving_realisation_is_refused(chain, poses, step):
    q, v = takes(poses, 3, 4), np.tile(step, (4, 1))
    realized = np.array(q)
    realized[1:, 2:] = np.nan
    with pytest.raises(ModelDomainError, match="fewer than two") as refusal:
        realized_moments(NOISY, chain, q, v, "free_running", realized)
    assert refusal.value.evidence["step"] == 2
