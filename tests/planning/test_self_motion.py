"""The grid holds every pose of the joints that carries the tip to the path, and no other."""

from __future__ import annotations

import numpy as np
import pytest
from planned_arms import path_problem

from pipeline.core.errors import PipelineError
from pipeline.planning.problem import InfeasibleError, Problem, settle
from pipeline.planning.self_motion import curves, grid, spacing_of, stages

SPACING = 0.2


def solutions(task: Problem, step: int, tried: int) -> np.ndarray:
    """Poses at ``step`` that Newton's method finds from random ones, and that are to be kept."""
    chain = task.chain
    begun = np.random.default_rng(3).uniform(chain.lower, chain.upper, (tried, len(chain.lower)))
    left, reached = settle(chain, begun, np.tile(task.path[step], (tried, 1)), 60)
    left = task.nearest_turns(left[reached])
    left = left[chain.within_limits(left)]
    return left[task.clear(left)]


@pytest.mark.parametrize("arm", ["planar", "seven"])
def test_every_solution_lies_between_two_neighbours_of_the_grid(arm):
    task = path_problem(arm, 4)
    (poses,) = curves(task, np.array([2]), SPACING)
    held = solutions(task, 2, 400)
    assert len(held) > 50
    apart = np.linalg.norm(task.less_turns(held[:, None] - poses), axis=-1).min(axis=1)
    # half a spacing along the curve; where a curve is cut, up to a whole one
    assert np.mean(apart < 0.55 * SPACING) > 0.9
    assert apart.max() < 1.05 * SPACING
    off = task.chain.displacement(task.chain.pose(poses), task.path[2])
    assert np.abs(off).max() < 1e-10
    assert task.chain.within_limits(poses).all()
    assert (task.clearance(poses) >= task.margin).all()


def test_a_curve_from_one_start_alone_would_miss_branches():
    # the control
    task = path_problem("seven", 4)
    (poses,) = curves(task, np.array([2]), SPACING, 1)
    held = solutions(task, 2, 400)
    apart = np.linalg.norm(task.less_turns(held[:, None] - poses), axis=-1).min(axis=1)
    assert np.mean(apart < SPACING) < 0.7


def test_an_arm_without_joints_to_spare_has_its_branches():
    task = path_problem("square", 4)
    (poses,) = curves(task, np.array([2]), 0.0)
    held = solutions(task, 2, 200)
    apart = np.linalg.norm(held[:, None] - poses, axis=-1)
    assert apart.min(axis=1).max() < 1e-6
    # the elbow up and down, each once
    assert len(poses) == 2
    assert {*apart.argmin(axis=1)} == {0, 1}


def test_the_spacing_gives_about_as_many_points_as_were_asked_for():
    task = path_problem("seven", 4)
    left = grid(task, np.array([0, 2, 4]), spacing_of(task, 300))
    assert 240 < max(len(poses) for poses in left.poses) < 360


def test_stages_lie_as_far_apart_as_a_wide_grid_needs():
    task = path_problem("seven", 100)
    slowest = task.reach.min()
    assert stages(task, 0.0, 1.5).tolist() == list(range(101))
    assert stages(task, slowest, 1.0).tolist() == list(range(101))
    assert stages(task, 10 * slowest, 1.0).tolist() == list(range(0, 101, 10))
    assert stages(task, 1e9 * slowest, 1.0).tolist() == [0, 100]


def test_where_the_path_cannot_be_followed_its_first_step_is_named_and_why():
    task, steps = path_problem("planar", 6), np.array([0, 6])
    path = task.path.copy()
    path[4:, 0] += 5.0
    far = Problem(task.chain, path, task.rate, task.margin, 0.0)
    with pytest.raises(InfeasibleError, match=r"does not reach the pose .*\[step 4\]") as refused:
        grid(far, steps, SPACING)
    assert isinstance(refused.value, PipelineError)
    with pytest.raises(InfeasibleError, match=r"least singular value of .* margin of 5 m \[step 0"):
        grid(path_problem("planar", 6, margin=5.0), steps, SPACING)


def test_a_path_beyond_the_joint_limits_alone_is_named_so():
    task = path_problem("planar", 4)
    object.__setattr__(task.chain, "upper", task.chain.lower + 1e-3)
    with pytest.raises(InfeasibleError, match=r"beyond its joint limits alone \[step 0"):
        grid(task, np.array([0, 4]), SPACING)
