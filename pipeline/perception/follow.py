"""Which way the joint angles of a dataset's takes are had from their markers."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from pipeline.arm.model import arm_of
from pipeline.core.options.dataset import Robot
from pipeline.core.options.motion_capture import Mocap
from pipeline.perception import markers
from pipeline.perception.joint_track import JointTrack


def follower(robot: Robot, mocap: Mocap) -> Callable[..., JointTrack]:
    """Makes of a take's rows of the table ``markers``, and its name as ``take``, the angles of the
    joints: of an arm in a plane link by link, of one in space all at once.
    """
    if robot.plane:
        return partial(markers.track_rows, mocap=mocap, arm=arm_of(robot))
    # here, as they load the compiler, which an arm in a plane does without
    from pipeline.perception import space
    from pipeline.perception.carried import carried

    points = carried(robot, mocap)
    return partial(space.track_rows, mocap=mocap, points=points, joints=robot.joints)
