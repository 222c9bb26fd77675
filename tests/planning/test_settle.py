"""Newton's method for whole batches: poses that it reaches, and lanes without an inverse."""

from __future__ import annotations

import numpy as np
from planned_arms import chain, joint_path

from pipeline.planning.problem import CLOSE, inverses, settle

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


def test_the_inverses_are_those_of_the_regular_poses():
    arm, q = chain("planar"), joint_path("planar", 4)
    every, regular = inverses(arm, q)
    assert regular.all()
    np.testing.assert_array_equal(every, arm.inverse_jacobian(q))
    q[2] = LOST
    some, regular = inverses(arm, q)
    assert regular.tolist() == [True, True, False, True, True]
    np.testing.assert_array_equal(some, every[regular])
