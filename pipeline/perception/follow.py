"""Choice of the way from a dataset's markers to its joint angles."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from pipeline.arm.model import arm_of
from pipeline.core.options.dataset import Robot
from pipeline.core.options.instruments import Mocap
from pipeline.perception import markers, space
from pipeline.perception.joint_track import JointTrack


def follower(robot: Robot, mocap: Mocap) -> Callable[..., JointTrack]:
    """Return the function that makes joint angles of a take's rows of the table ``markers`` and its
    name ``take``: of an arm in a plane link by link, of an arm in space all at once.
    """
    if robot.plane:
        return partial(markers.track_rows, mocap=mocap, arm=arm_of(robot))
    points = space.carried(robot, mocap)
    return partial(space.track_rows, mocap=mocap, points=points, joints=robot.joints)
