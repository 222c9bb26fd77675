"""The closed loop: the arm without noise stays on the mean path, and comes back to it by the share
that a step corrects.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models.closed_loop import MeanPath, closed_loop_steps, mean_path, measured_poses
from pipeline.models.model import Commands, open_loop
from pipeline.models.noise import process_noise
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.steps import Recorded

STEPS = 40
UNSEEN = Measurements("take", np.empty(0), *np.empty((2, 0, 3)), np.empty((0, 3, 3)))


@pytest.fixture
def path(chain) -> MeanPath:
    """A motion after a rest, of an arm that stands off the origin."""
    progress = np.clip(np.arange(STEPS + 1) - 5, 0, None) / STEPS
    poses = np.array([0.4, 1.7, -0.3]) + progress[:, None] * np.array([0.5, 0.4, -0.6])
    return MeanPath(replace(chain, origin=np.array([0.2, -0.1])), poses)


def moved(path: MeanPath, commands: Commands, off: np.ndarray) -> np.ndarray:
    """(STEPS + 1, 3) deviation from the path of an arm without noise that starts ``off`` it."""
    still = Start(path.poses[0] + off, np.zeros((3, 3)))
    posterior = particle_filter(
        ScaledModel(np.zeros((3, 3))),
        path.chain,
        commands,
        0.01,
        still,
        UNSEEN,
        FilterOptions(1),
        np.random.default_rng(1),
    )
    return posterior.mean - path.poses


def test_on_the_mean_path_the_arm_stays_and_with_the_steps_of_the_poses_it_does_not(path):
    assert np.max(np.abs(moved(path, path.commands(0.3), np.zeros(3)))) < 1e-12
    assert np.max(np.abs(moved(path, open_loop(path.v), np.zeros(3)))) < 1e-12
    # control: the differences of the task's poses lead off it, as J is that before the step
    steps = np.diff(path.chain.pose(path.poses), axis=0)
    assert np.max(np.abs(moved(path, open_loop(steps), np.zeros(3)))) > 1e-4


def test_off_the_path_the_arm_comes_back_by_the_share_of_a_step_and_in_an_open_loop_never(path):
    off = 1e-3 * np.array([1.0, -2.0, 1.0])
    chain, steps = path.chain, np.arange(STEPS + 1)
    for share in (0.0, 0.3):
        deviation = moved(path, path.commands(share), off)
        task = chain.pose(path.poses + deviation) - chain.pose(path.poses)
        expected = task[0] * (1 - share) ** steps[:, None]
        # to first order in the deviation, of which the second order is a hundredth
        assert np.max(np.abs(task - expected)) < 0.03 * np.max(np.abs(task[0]))


def test_the_noise_left_in_a_loop_is_what_was_put_in_with_the_measurements(path):
    rng, chain, share = np.random.default_rng(2), path.chain, 0.4
    v = np.where(np.arange(STEPS)[:, None] < 5, 0.0, path.v)
    q = np.empty((20, STEPS + 1, 3))
    q[:, 0] = path.poses[0] + 1e-3 * rng.standard_normal((20, 3))
    for k in range(STEPS):
        # held to the mean of these takes, as it will be found
        middle = MeanPath(chain, np.stack([q[:, k].mean(axis=0)] * 2))
        off = chain.pose(middle.poses[0]) - chain.pose(q[:, k])
        q[:, k + 1] = q[:, k] + np.matvec(chain.inverse_jacobian(q[:, k]), v[k] + share * off)
    noise = process_noise(chain, q, v)
    recorded = Recorded(chain, q[:, :-1], v, noise, ("a", "b", "c"), np.eye(3))
    np.testing.assert_allclose(measured_poses(recorded), q, atol=1e-15)
    closed = closed_loop_steps(recorded, mean_path(recorded), share)
    # what is common to all takes is the mean path's own curvature
    left = np.ptp(closed.noise, axis=0)
    assert np.max(left) < 1e-5 < 1e-4 < np.max(np.ptp(noise, axis=0))
    assert not closed.v[:, :5].any() and closed.v[:, 5:].all()
    np.testing.assert_allclose(closed.measurement, (1 + 0.6**2) / 2 * np.eye(3))
