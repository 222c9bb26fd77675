"""On the bench every motion has takes of the same numbers, of an arm that knows nothing of the task
that is planned.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.config import CONF
from pipeline.core.errors import ConfigError
from pipeline.studies.planning.bench import Rig, bench_of


def test_the_task_that_is_planned_changes_nothing_of_the_arm_that_moves(bench, rig):
    whole = bench_of(CONF / "dataset/youbot.yaml", [], 0.64)
    assert (bench.chain.task, whole.chain.task) == (("x", "z"), ("x", "z", "phi"))
    assert bench.built.task == whole.chain.task
    other = replace(rig, bench=whole)
    assert np.array_equal(rig.poses(bench.recorded, "take"), other.poses(whole.recorded, "take"))
    # three joints for two rows: a step of the joints stands beside that of the task
    assert bench.command(bench.recorded).shape == (500, 5)
    assert whole.command(whole.recorded).shape == (500, 3)


def test_the_takes_of_two_motions_err_alike_and_those_of_training_are_others(bench, rig):
    moved = bench.recorded + np.array([0.0, 0.0, 0.01])
    first, second = (rig.poses(path, "take") - path for path in (bench.recorded, moved))
    training = rig.poses(bench.recorded, "training") - bench.recorded
    spread = first.std()
    assert np.abs(first - second).max() < 0.2 * spread < np.abs(first - training).max()
    # a motion's takes hang neither on how many there are nor on how many are simulated at once
    fewer = Rig(bench, rig.dynamics, takes=2, seed=1)
    assert np.array_equal(fewer.poses(bench.recorded, "take"), (first + bench.recorded)[:2])


def test_the_training_takes_have_their_noise_about_the_step_that_was_commanded(bench, rig):
    recorded = rig.training()
    assert recorded.noise.shape == recorded.q.shape == (6, 500, 3)
    poses = rig.poses(bench.recorded, "training")
    np.testing.assert_allclose(recorded.q_next, poses[:, 1:], atol=1e-12)


def test_a_motion_that_the_arm_cannot_follow_is_refused(bench, rig):
    with pytest.raises(ConfigError, match="joint limits"):
        rig.poses(bench.recorded + 3.0, "take")
