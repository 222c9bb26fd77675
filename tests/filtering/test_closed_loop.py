"""What the filter of a closed loop is worth: where deviations outlast a frame it is better than no
filter, and where they decay within a step no worse.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models.closed_loop import MeanPath
from pipeline.models.draws import draw_steps
from pipeline.models.model import Commands, open_loop
from pipeline.models.scaled.law import ScaledModel

STEPS, TAKES, DT, EVERY = 90, 30, 0.01, 3  # a frame at every third step
DEVIATION = np.array([0.004, 0.006, 0.009])  # rad, that a loop of any share leaves
SENSOR = 0.01  # rad


@pytest.fixture
def path(chain) -> MeanPath:
    progress = np.linspace(0.0, 1.0, STEPS + 1)[:, None]
    return MeanPath(chain, np.array([0.4, 1.7, -0.3]) + progress * np.array([0.5, 0.4, -0.6]))


def model_of(share: float) -> ScaledModel:
    """Noise under which a loop of ``share`` κ leaves DEVIATION."""
    return ScaledModel(np.diag((1 - (1 - share) ** 2) * DEVIATION**2))


def takes_of(path: MeanPath, share: float, rng: np.random.Generator) -> np.ndarray:
    """(TAKES, STEPS + 1, 3) rad, corrected by NumPy."""
    chain, q = path.chain, np.empty((TAKES, STEPS + 1, 3))
    q[:, 0] = path.poses[0] + DEVIATION * rng.standard_normal((TAKES, 3))
    for k in range(STEPS):
        v = path.v[k] + share * (chain.pose(path.poses[k]) - chain.pose(q[:, k]))
        q[:, k + 1] = draw_steps(model_of(share), chain, q[:, k], v, rng)[0]
    return q


def scored(path: MeanPath, share: float, commands: Commands) -> tuple[np.ndarray, np.ndarray]:
    """(3,) rms error of the filter in units of that of no filter, and coverage of its ±1σ."""
    rng = np.random.default_rng(3)
    takes, frames = takes_of(path, share, rng), np.arange(EVERY, STEPS + 1, EVERY)
    start = Start(path.poses[0], np.diag(DEVIATION**2))
    noise = np.tile(SENSOR**2 * np.eye(3), (len(frames), 1, 1))
    errors, covered = [], []
    for take in takes:
        y = take[frames] + SENSOR * rng.standard_normal((len(frames), 3))
        measured = Measurements("take", DT * frames, y, np.zeros_like(y), noise)
        posterior = particle_filter(
            model_of(share), path.chain, commands, DT, start, measured, FilterOptions(400), rng
        )
        errors.append(posterior.mean - take)
        bound = np.sqrt(np.diagonal(posterior.covariance, axis1=1, axis2=2))
        covered.append(np.abs(errors[-1]) <= bound)
    none = takes - path.poses
    rms = np.sqrt(np.mean(np.square(errors), axis=(0, 1)) / np.mean(none**2, axis=(0, 1)))
    return rms, np.mean(covered, axis=(0, 1))


def test_where_deviations_outlast_a_frame_the_closed_loop_is_better_than_no_filter(path):
    rms, covered = scored(path, 0.03, path.commands(0.03))
    assert np.all(rms < 0.9)
    np.testing.assert_allclose(covered, 0.683, atol=0.08)
    # control: added up in an open loop the same noise wanders
    wandering, _ = scored(path, 0.03, open_loop(path.v))
    assert np.all(wandering > rms)


def test_where_they_decay_within_a_step_it_is_no_worse_and_the_open_loop_far_worse(path):
    rms, covered = scored(path, 0.9, path.commands(0.9))
    assert np.all(rms < 1.02)
    np.testing.assert_allclose(covered, 0.683, atol=0.03)
    wandering, _ = scored(path, 0.9, open_loop(path.v))
    assert np.all(wandering > 1.3)
