"""The chains to the links of an arm, against Pinocchio; links that it does not move are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from space_arms import LWR4, UR5, link_poses

from pipeline.arm.model import link_chains
from pipeline.core.errors import ConfigError

KEY = "dataset.mocap.markers"


@pytest.mark.parametrize(
    ("robot", "links"),
    [(UR5, ["shoulder", "forearm", "wrist_2", "flange"]), (LWR4, ["link_2", "link_5", "flange"])],
)
def test_a_links_frame_lies_where_pinocchio_has_it(robot, links):
    q = np.random.default_rng(1).uniform(-2, 2, (50, len(robot.joints)))
    for link, chain in link_chains(robot, links, KEY).items():
        pose = chain.pose(q[:, : len(chain.lower)])
        rotation, position = link_poses(robot, link, q)
        np.testing.assert_allclose(pose[:, :3], position, atol=1e-12)
        np.testing.assert_allclose(pose[:, 3:].reshape(-1, 3, 3), rotation, atol=1e-12)


def test_held_joints_are_no_joints_of_the_chain():
    held = replace(UR5, joints=UR5.joints[2:], locked={"joint_2": -0.7}, task=["x", "z"])
    (chain,) = link_chains(held, ["wrist_1"], KEY).values()
    q = np.random.default_rng(1).uniform(-2, 2, (5, 2))
    whole = np.hstack([np.tile([0.0, -0.7], (5, 1)), q, np.zeros((5, 2))])
    np.testing.assert_allclose(
        chain.pose(q)[:, :3], link_poses(UR5, "wrist_1", whole)[1], atol=1e-12
    )


@pytest.mark.parametrize(
    ("link", "words"), [("elbow", "no frame 'elbow'"), ("base", "no joint of the arm moves 'base'")]
)
def test_a_link_that_the_arm_does_not_move_is_refused(link, words):
    with pytest.raises(ConfigError, match=words):
        link_chains(UR5, ["forearm", link], KEY)
