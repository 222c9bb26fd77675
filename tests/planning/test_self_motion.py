"""The grid holds every pose of the joints that carries the tip to the path, and no other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planned_arms import chain, joint_path, path_problem

from pipeline.planning.problem import CLOSE, InfeasibleError, Problem, settle
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
    if arm == "seven":
        # the control: the curve of one start alone misses branches
        (poses,) = curves(task, np.array([2]), SPACING, 1)
        apart = np.linalg.norm(task.less_turns(held[:, None] - poses), axis=-1).min(axis=1)
        assert np.mean(apart < SPACING) < 0.7


def test_a_grid_has_about_as_many_points_as_it_is_given():
    task = path_problem("seven", 4)
    poses = grid(task, np.array([0, 2, 4]), spacing_of(task, 300))
    assert 240 < max(len(each) for each in poses) < 360


def test_an_arm_without_joints_to_spare_has_its_branches():
    task = path_problem("square", 4)
    (poses,) = curves(task, np.array([2]), 0.0)
    held = solutions(task, 2, 200)
    apart = np.linalg.norm(held[:, None] - poses, axis=-1)
    assert apart.min(axis=1).max() < 1e-6
    # the elbow up and down, each once
    assert len(poses) == 2
    assert {*apart.argmin(axis=1)} == {0, 1}


def test_stages_lie_as_far_apart_as_a_wide_grid_needs():
    task = path_problem("seven", 100)
    slowest = task.reach.min()
    assert stages(task, 0.0, 1.5).tolist() == list(range(101))
    assert stages(task, slowest, 1.0).tolist() == list(range(101))
    assert stages(task, 10 * slowest, 1.0).tolist() == list(range(0, 101, 10))
    assert stages(task, 1e9 * slowest, 1.0).tolist() == [0, 100]


@pytest.mark.parametrize(
    ("changes", "upper", "words"),
    [
        ({}, 9.0, r"does not reach the pose .*\[step 4\]"),
        ({"margin": 5.0}, 9.0, r"least singular value of .* margin of 5 m \[step 0"),
        ({}, 1e-3, r"beyond its joint limits alone \[step 0"),
    ],
)
def test_where_the_path_cannot_be_followed_its_first_step_is_named_and_why(changes, upper, words):
    task = path_problem("planar", 6, **changes)
    chain = replace(task.chain, upper=np.minimum(task.chain.upper, task.chain.lower + upper))
    path = task.path.copy()
    path[4:, 0] += 5.0
    with pytest.raises(InfeasibleError, match=words):
        grid(replace(task, chain=chain, path=path), np.array([0, 6]), SPACING)


LOST = np.nan  # an angle at which no Jacobian has an inverse


def test_the_poses_are_reached_and_a_lane_without_an_inverse_stays_where_it_is():
    arm, q = chain("planar"), joint_path("planar", 20)
    begun, target = q + 0.05, arm.pose(q)
    begun[7] = LOST
    assert arm.singular(begun).tolist() == [lane == 7 for lane in range(21)]
    settled, reached = settle(arm, begun, target, 20)
    assert reached.tolist() == [lane != 7 for lane in range(21)]
    off = np.linalg.norm(arm.displacement(arm.pose(settled), target), axis=-1)
    assert off[reached].max() <= CLOSE
    np.testing.assert_array_equal(settled[7], begun[7])
    # a lane is settled as it would be alone
    alone, _ = settle(arm, begun[3:4], target[3:4], 20)
    np.testing.assert_array_equal(settled[3:4], alone)
    # control: without a round nothing is reached
    assert not settle(arm, begun, target, 0)[1].any()
