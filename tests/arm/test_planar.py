"""The planar chain against geometry; and taken out of a URDF, against Pinocchio's kinematics of the
whole robot in space and against the serial chain of the same arm.
"""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from planar_poses import load_arm
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import PlanarChain, SerialChain
from pipeline.arm.model import arm_of, chain_of
from pipeline.arm.urdf import read_urdf
from pipeline.core.errors import ConfigError, SingularJacobianError
from pipeline.core.options.dataset import Robot
from tests.arm.arm_urdfs import JOINTS, LOCKED, UR5, YOUBOT, by_pinocchio, gantry, urdf


@pytest.fixture(scope="module", params=list(product((1.0, -1.0), repeat=3)), ids=str)
def chain(request) -> PlanarChain:
    """Links that point anywhere, for every combination of the joints' senses."""
    links = default_rng(3).uniform(-0.2, 0.2, (3, 2))
    limits = np.full(3, -2.0), np.full(3, 2.5), np.ones(3)
    return PlanarChain(np.array([0.1, 0.4]), links, np.array(request.param), *limits)


def bent(chain: PlanarChain, count: int = 200) -> np.ndarray:
    """Joint angles anywhere within the limits whose elbow is bent by 3 degrees at least."""
    q = default_rng(4).uniform(chain.lower, chain.upper, (4 * count, 3))
    return q[np.abs(np.sin(q[:, 1] - chain.straight)) > 0.05][:count]


def in_line(chain: PlanarChain) -> np.ndarray:
    """Joint angles that stretch the first two links into one line."""
    bend = np.arctan2(*chain.links[0]) - np.arctan2(*chain.links[1])
    return np.array([0.3, chain.signs[1] * bend, -0.2])


def test_segments_point_along_headings_that_give_the_joints_back_whatever_the_turns(
    chain,
):
    q = bent(chain)
    psi = chain.segment_headings(q)
    segments = np.diff(chain.points(q), axis=1)
    directions = np.stack([np.sin(psi), np.cos(psi)], axis=-1)

    assert_allclose(
        segments,
        chain.lengths[:, None] * directions,
        atol=1e-14,
    )
    assert np.array_equal(chain.points(q)[:, 0], np.tile(chain.origin, (len(q), 1)))

    turns = 2 * np.pi * default_rng(6).integers(-2, 3, q.shape)
    assert_allclose(chain.joints_from_segments(psi + turns), q, atol=1e-12)

    # the turns are those nearest to the middle of the limits
    middle = (chain.lower + chain.upper) / 2
    beyond = chain.joints_from_segments(
        chain.segment_headings(middle + np.array([3.1, -3.1, 3.2])),
    )

    assert_allclose(
        beyond - middle,
        [3.1, -3.1, 3.2 - 2 * np.pi],
        atol=1e-12,
    )


@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_singular_pose_and_one_that_is_not_finite_are_refused_with_their_place(chain):
    q = bent(chain, 12).reshape(3, 4, 3)
    q[1, 2] = in_line(chain)
    with pytest.raises(
        SingularJacobianError,
        match=r"singular at 1 frame\(s\)",
    ) as refused:
        chain.inverse_jacobian(q, what="frame")

    evidence = refused.value.evidence
    assert evidence.pop("least_singular_value") < 1e-14
    assert evidence == {"index": (1, 2), "q": in_line(chain).round(4).tolist()}

    for not_finite in (np.inf, np.nan):
        q[1, 2, 1] = not_finite
        assert chain.singular(q).sum() == 1
        with pytest.raises(SingularJacobianError, match="not finite"):
            chain.inverse_jacobian(q)


ORDER = [1, 2, 0]  # of the rows z, phi, x, whose chain is not a PlanarChain
ARMS = ["youbot", "ur5", "oblique", "flat", "gantry"]


@pytest.fixture(scope="module", params=ARMS)
def options(request, tmp_path_factory) -> dict:
    """The youBot's, the UR5's, one in an oblique plane with a joint turned round, one that lies
    flat, and one with sliding and fixed joints below, within and beyond its planar chain.
    """
    file = tmp_path_factory.mktemp("urdf") / "robot.urdf"
    if request.param == "youbot":
        return {
            "urdf": str(YOUBOT),
            "joints": JOINTS,
            "tool": "arm_tool",
            "locked": LOCKED,
        }
    if request.param == "ur5":
        joints = ["joint_2", "joint_3", "joint_4"]
        return {"urdf": str(UR5), "joints": joints, "tool": "wrist_centre"}
    if request.param == "gantry":
        file.write_text(gantry())
        locked = {"carriage": 0.35, "telescope": 0.08, "turret": 0.9}  # m, m, rad
        joints = ["shoulder", "elbow", "wrist"]
        return {"urdf": str(file), "joints": joints, "tool": "flange", "locked": locked}
    flat = request.param == "flat"
    axes = ("0 0 1", "0 0 1", "0 0 -1") if flat else ("0 1 0", "0 -1 0", "0 1 0")
    file.write_text(urdf(axes, "0 0 0.5" if flat else "0.4 0.2 -0.3"))
    return {"urdf": str(file), "joints": ["a", "b", "c"], "tool": "tool"}


@pytest.fixture(scope="module")
def both(options) -> tuple[PlanarChain, SerialChain]:
    planar = chain_of(Robot(**options, plane=True))
    serial = chain_of(Robot(**options, plane=True, task=["z", "phi", "x"]))
    assert isinstance(planar, PlanarChain) and isinstance(serial, SerialChain)
    return planar, serial


def test_pose_joints_and_jacobian_are_the_whole_robots_seen_in_the_plane(options):
    robot = Robot(**options, plane=True)
    arm = arm_of(robot)
    tree = read_urdf(Path(robot.urdf))
    # the plane's z axis is as far up as it can be
    up = 1 if abs(arm.rotation[2, 1]) > 0.99 else 2

    assert np.linalg.det(arm.rotation) > 0 and arm.rotation[up, 2] > 0.5
    assert abs(arm.rotation[up, 0]) < 1e-12

    q = np.vstack([np.zeros(3), bent(arm.chain, 20)])
    places, jacobians = by_pinocchio(robot, robot.tool, q)
    x, z, phi = arm.chain.coordinates(q).T
    across = np.full(len(q), arm.to_plane(places[0, :3])[1])
    tool = arm.to_base(np.stack([x, across, z], axis=-1))

    assert_allclose(tool, places[:, :3], atol=1e-12)

    turn = Rotation.from_rotvec(phi[:, None] * arm.rotation[:, 1]).as_matrix()
    rotation = places[:, 3:].reshape(-1, 3, 3)
    assert_allclose(turn @ rotation[0], rotation, atol=1e-12)

    vx, vy, vz = np.moveaxis(arm.rotation.T @ jacobians[:, :3], 1, 0)
    wx, wy, wz = np.moveaxis(arm.rotation.T @ jacobians[:, 3:], 1, 0)
    planar = np.stack([vx, vz, wy], axis=1)
    assert_allclose(arm.chain.jacobian(q), planar, atol=1e-12)

    # and nothing of the motion leaves the plane
    assert_allclose([vy, wx, wz], 0, atol=1e-12)

    for j, name in enumerate(robot.joints):
        places, _ = by_pinocchio(robot, tree.children[name], q)
        seen = arm.to_plane(places[:, :3])[:, [0, 2]]
        assert_allclose(arm.chain.points(q)[:, j], seen, atol=1e-12)


def test_steps_and_displacements_of_the_serial_chain_are_the_same(both):
    planar, serial = both
    for name in ("lower", "upper", "max_speed"):
        assert_array_equal(*(getattr(chain, name) for chain in both))

    q = bent(planar, 100)
    v = default_rng(2).normal(size=3)
    size = 1e-12 * np.abs(planar.inverse_jacobian(q)).max()
    step = planar.nominal_step(q, v)

    assert_allclose(serial.nominal_step(q, v[ORDER]), step, atol=size)
    assert not planar.null_step(q, v).any() and planar.null_step(q, v).shape == q.shape

    steps = default_rng(3).uniform(-1, 1, q.shape)  # up to half a turn
    (start, end), (here, there) = (
        (chain.pose(q), chain.pose(q + steps)) for chain in both
    )
    expected = planar.displacement(start, end)[:, ORDER]

    assert_allclose(serial.displacement(here, there), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("joints", "tool", "words"),
    [
        (
            ["shoulder", "telescope", "elbow"],
            "flange",
            "three revolute joints with limits",
        ),
        (
            ["turret", "shoulder", "elbow"],
            "flange",
            "shoulder, elbow are not parallel to turret",
        ),
        (["shoulder", "elbow", "wrist"], "hand", "lie on one axis"),
    ],
)
def test_joints_that_are_no_planar_chain_are_named(tmp_path, joints, tool, words):
    file = tmp_path / "gantry.urdf"
    file.write_text(gantry())
    with pytest.raises(ConfigError, match=words) as refused:
        load_arm(file, joints, tool, {})
    assert refused.value.evidence["file"] == file
