"""The planar chain: its closed forms against linear algebra, finite differences and geometry; and
taken out of a URDF, against Pinocchio's kinematics of the whole robot in space and against the
serial chain of the same arm.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from pipeline.arm.chain import SINGULAR_SINE, PlanarChain
from pipeline.arm.model import arm_of, chain_of, load_arm
from pipeline.arm.serial import SerialChain
from pipeline.core.errors import ConfigError, SingularJacobianError
from pipeline.core.options.dataset import Robot
from tests.arm.arm_urdfs import JOINTS, LOCKED, UR5, YOUBOT, gantry, urdf


@pytest.fixture(scope="module", params=list(product((1.0, -1.0), repeat=3)), ids=str)
def chain(request) -> PlanarChain:
    """Links that point anywhere, for every combination of the joints' senses."""
    links = np.random.default_rng(3).uniform(-0.2, 0.2, (3, 2))
    limits = np.full(3, -2.0), np.full(3, 2.5), np.ones(3)
    return PlanarChain(np.array([0.1, 0.4]), links, np.array(request.param), *limits)


def bent(chain: PlanarChain, count: int = 200) -> np.ndarray:
    """Joint angles anywhere within the limits whose elbow is bent by 3 degrees at least."""
    q = np.random.default_rng(4).uniform(chain.lower, chain.upper, (4 * count, 3))
    return q[np.abs(np.sin(q[:, 1] - chain.straight)) > 0.05][:count]


def in_line(chain: PlanarChain) -> np.ndarray:
    """Joint angles that stretch the first two links into one line."""
    bend = np.arctan2(*chain.links[0]) - np.arctan2(*chain.links[1])
    return np.array([0.3, chain.signs[1] * bend, -0.2])


def test_jacobian_and_inverse_are_those_of_the_derivative_of_the_pose(chain):
    q, step = bent(chain), 1e-6
    columns = [
        (chain.pose(q + step * e) - chain.pose(q - step * e)) / (2 * step) for e in np.eye(3)
    ]
    np.testing.assert_allclose(chain.jacobian(q), np.stack(columns, axis=-1), atol=1e-9)
    inverse = np.linalg.inv(chain.jacobian(q))
    np.testing.assert_allclose(chain.inverse_jacobian(q), inverse, rtol=1e-9, atol=1e-9)


def test_segments_keep_their_lengths_and_point_along_their_headings(chain):
    q = bent(chain)
    psi, segments = chain.segment_headings(q), np.diff(chain.points(q), axis=1)
    directions = np.stack([np.sin(psi), np.cos(psi)], axis=-1)
    np.testing.assert_allclose(segments, chain.lengths[:, None] * directions, atol=1e-15)
    assert np.array_equal(chain.points(q)[:, 0], np.tile(chain.origin, (len(q), 1)))


def test_joints_come_back_from_segments_whatever_the_turns_nearest_to_the_middle_of_the_limits(
    chain,
):
    q = np.random.default_rng(5).uniform(chain.lower, chain.upper, (300, 3))
    turns = 2 * np.pi * np.random.default_rng(6).integers(-2, 3, (300, 3))
    back = chain.joints_from_segments(chain.segment_headings(q) + turns)
    np.testing.assert_allclose(back, q, atol=1e-12)
    middle = (chain.lower + chain.upper) / 2
    beyond = chain.joints_from_segments(chain.segment_headings(middle + np.array([3.1, -3.1, 3.2])))
    np.testing.assert_allclose(beyond - middle, [3.1, -3.1, 3.2 - 2 * np.pi], atol=1e-12)


def test_every_batch_shape_holds_what_single_poses_give(chain):
    q = bent(chain, 6)
    for name in ("pose", "points", "jacobian", "inverse_jacobian", "singular"):
        method = getattr(chain, name)
        alone = np.array([method(each) for each in q])
        for shape in ((6,), (2, 3), (1, 6, 1)):
            batch = method(q.reshape(*shape, 3))
            np.testing.assert_array_equal(batch, alone.reshape(*shape, *alone.shape[1:]))
        assert method(q[:0]).shape == (0, *alone.shape[1:])


def test_a_singular_pose_is_refused_with_its_place_in_the_batch(chain):
    q = bent(chain, 12).reshape(3, 4, 3)
    q[1, 2] = in_line(chain)
    with pytest.raises(SingularJacobianError, match=r"singular at 1 frame\(s\)") as refused:
        chain.inverse_jacobian(q, what="frame")
    evidence = refused.value.evidence
    assert evidence.pop("least_singular_value") < 1e-15
    assert evidence == {"index": (1, 2), "q": in_line(chain).round(4).tolist()}


def test_a_pose_is_singular_where_the_determinant_is_below_its_share(chain):
    # the second joint by up to twice the edge off a straight arm, stretched or folded
    rng = np.random.default_rng(5)
    q = in_line(chain) + rng.uniform(-1, 1, (4000, 3)) * [3.0, 2 * np.arcsin(SINGULAR_SINE), 3.0]
    q[::2, 1] += np.pi
    edge = SINGULAR_SINE * chain.lengths[0] * chain.lengths[1]
    flat = np.abs(np.linalg.det(chain.jacobian(q))) < edge
    assert 1500 < np.sum(flat) < 2500
    np.testing.assert_array_equal(chain.singular(q), flat)
    regular = q[~flat]
    product_of_both = chain.inverse_jacobian(regular) @ chain.jacobian(regular)
    np.testing.assert_allclose(product_of_both, np.tile(np.eye(3), (len(regular), 1, 1)), atol=1e-9)


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("broken", [np.nan, np.inf])
@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_pose_that_is_not_finite_is_singular_whichever_joint_it_is(chain, broken, joint):
    q = bent(chain, 3)
    q[2, joint] = broken
    assert chain.singular(q).tolist() == [False, False, True]
    with pytest.raises(SingularJacobianError, match="not finite") as refused:
        chain.inverse_jacobian(q)
    assert refused.value.evidence["index"] == (2,)


def test_limits_are_inside_and_a_single_joint_beyond_or_no_number_is_outside(chain):
    middle = (chain.lower + chain.upper) / 2
    assert chain.within_limits(np.stack([chain.lower, chain.upper, middle])).all()
    for joint, (bound, way) in product(range(3), ((chain.lower, -1), (chain.upper, 1))):
        for beyond in (np.nextafter(bound[joint], way * np.inf), np.nan):
            q = middle.copy()
            q[joint] = beyond
            assert not chain.within_limits(q)


ORDER = [1, 2, 0]  # of the rows z, phi, x, for which there are no closed forms
ARMS = ["youbot", "ur5", "oblique", "flat", "gantry"]


@pytest.fixture(scope="module", params=ARMS)
def options(request, tmp_path_factory) -> dict:
    """The youBot's, the UR5's, one in an oblique plane with a joint turned round, one that lies
    flat, and one with sliding and fixed joints below, within and beyond its planar chain.
    """
    file = tmp_path_factory.mktemp("urdf") / "robot.urdf"
    if request.param == "youbot":
        return {"urdf": str(YOUBOT), "joints": JOINTS, "tool": "arm_tool", "locked": LOCKED}
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


def in_space(options: dict, q: np.ndarray) -> tuple[pin.SE3, np.ndarray, np.ndarray]:
    """Placement of the tool, its Jacobian (6, 3) and the joints' places (3, 3), all in the root's
    axes and of the whole robot at joint angles ``q`` of the chain.
    """
    model = pin.buildModelFromUrdf(options["urdf"])
    data, full = model.createData(), pin.neutral(model)
    joints = [model.getJointId(name) for name in options["joints"]]
    held = {model.getJointId(n): value for n, value in options.get("locked", {}).items()}
    for joint, angle in {**held, **dict(zip(joints, q, strict=True))}.items():
        full[model.joints[joint].idx_q : model.joints[joint].idx_q + model.joints[joint].nq] = angle
    frame = model.getFrameId(options["tool"], pin.FrameType.BODY)
    jacobian = pin.computeFrameJacobian(model, data, full, frame, pin.LOCAL_WORLD_ALIGNED)
    pin.framesForwardKinematics(model, data, full)
    columns = [model.joints[joint].idx_v for joint in joints]
    places = np.array([data.oMi[joint].translation for joint in joints])
    return data.oMf[frame].copy(), jacobian[:, columns], places


def poses(chain: PlanarChain, count: int = 100) -> np.ndarray:
    q = np.random.default_rng(1).uniform(chain.lower, chain.upper, (4 * count, 3))
    return q[np.abs(np.sin(q[:, 1] - chain.straight)) > 0.05][:count]


def test_pose_joints_and_jacobian_are_the_whole_robots_seen_in_the_plane(options):
    arm = arm_of(Robot(**options, plane=True))
    # the plane's z axis is as far up as it can be
    up = 1 if abs(arm.rotation[2, 1]) > 0.99 else 2
    assert np.linalg.det(arm.rotation) > 0 and arm.rotation[up, 2] > 0.5
    assert abs(arm.rotation[up, 0]) < 1e-12
    start, _, _ = in_space(options, np.zeros(3))
    across = arm.to_plane(start.translation)[1]
    for q in poses(arm.chain, 20):
        tool, jacobian, places = in_space(options, q)
        x, z, phi = arm.chain.pose(q)
        place = arm.to_base(np.array([x, across, z]))
        np.testing.assert_allclose(place, tool.translation, atol=1e-12)
        turn = pin.AngleAxis(phi, arm.rotation[:, 1]).toRotationMatrix()
        np.testing.assert_allclose(turn @ start.rotation, tool.rotation, atol=1e-12)
        linear, angular = arm.rotation.T @ jacobian[:3], arm.rotation.T @ jacobian[3:]
        planar = np.vstack([linear[[0, 2]], angular[1]])
        np.testing.assert_allclose(arm.chain.jacobian(q), planar, atol=1e-12)
        # and nothing of the motion leaves the plane
        np.testing.assert_allclose(np.vstack([linear[1], angular[[0, 2]]]), 0, atol=1e-12)
        seen = arm.to_plane(places)[:, [0, 2]]
        np.testing.assert_allclose(arm.chain.points(q)[:3], seen, atol=1e-12)


def test_jacobians_inverses_and_steps_of_the_serial_chain_are_the_same(both):
    planar, serial = both
    for name in ("lower", "upper", "max_speed"):
        np.testing.assert_array_equal(*(getattr(chain, name) for chain in both))
    q, v = poses(planar), np.random.default_rng(2).normal(size=3)
    np.testing.assert_allclose(serial.jacobian(q), planar.jacobian(q)[:, ORDER], atol=1e-12)
    inverse = planar.inverse_jacobian(q)
    size = 1e-12 * np.abs(inverse).max()
    np.testing.assert_allclose(serial.inverse_jacobian(q), inverse[..., ORDER], atol=size)
    step = planar.nominal_step(q, v)
    np.testing.assert_allclose(serial.nominal_step(q, v[ORDER]), step, atol=size)
    assert not planar.null_step(q, v).any() and planar.null_step(q, v).shape == q.shape
    steps = np.random.default_rng(3).uniform(-1, 1, q.shape)  # up to half a turn
    (start, end), (here, there) = ((chain.pose(q), chain.pose(q + steps)) for chain in both)
    expected = planar.displacement(start, end)[:, ORDER]
    np.testing.assert_allclose(serial.displacement(here, there), expected, atol=1e-12)


def test_part_of_the_planes_task_is_redundant_and_a_length_multiplies_the_angle(options):
    whole, part = (chain_of(Robot(**options, plane=True, task=task)) for task in (None, ["x", "z"]))
    q = poses(whole)
    np.testing.assert_allclose(part.jacobian(q), whole.jacobian(q)[:, :2], atol=1e-12)
    rest = part.null_step(q, np.random.default_rng(4).normal(size=(len(q), 5)))
    moved = np.matvec(whole.jacobian(q), rest)
    np.testing.assert_allclose(moved[:, :2], 0, atol=1e-11)
    assert np.abs(moved[:, 2]).min() > 0
    longer = chain_of(Robot(**options, plane=True, length=0.25))
    expected = whole.jacobian(q) * np.array([1, 1, 0.25])[:, None]
    np.testing.assert_allclose(longer.jacobian(q), expected, atol=1e-12)


def test_a_held_joint_turns_the_plane_or_makes_a_link_longer(tmp_path):
    here, there = (
        load_arm(YOUBOT, JOINTS, "arm_tool", LOCKED | {"arm_joint_1": angle})
        for angle in (0.3, 1.3)
    )
    # joint 1 turns about −z
    turned = pin.AngleAxis(-1.0, np.array([0.0, 0.0, 1.0])).toRotationMatrix()
    np.testing.assert_allclose(there.rotation, turned @ here.rotation, atol=1e-12)
    np.testing.assert_allclose(there.chain.links, here.chain.links, atol=1e-12)
    file = tmp_path / "gantry.urdf"
    file.write_text(gantry())
    short, long = (
        load_arm(file, ["shoulder", "elbow", "wrist"], "flange", {"telescope": extent}).chain
        for extent in (0.0, 0.08)
    )
    longer = [np.hypot(0.01, 0.38) - np.hypot(0.01, 0.3), 0, 0]
    np.testing.assert_allclose(long.lengths - short.lengths, longer, atol=1e-12)


@pytest.mark.parametrize(
    ("joints", "tool", "words"),
    [
        (["shoulder", "telescope", "elbow"], "flange", "with limits, which telescope is not"),
        (["turret", "shoulder", "elbow"], "flange", "not parallel.*turret is shoulder, elbow"),
        (["shoulder", "elbow", "plate"], "flange", "no joint 'plate'"),
        (["elbow", "shoulder", "wrist"], "flange", "in the order of the chain"),
        (["shoulder", "elbow", "wrist"], "hand", "lie on one axis"),
    ],
)
def test_joints_that_are_no_planar_chain_are_named(tmp_path, joints, tool, words):
    file = tmp_path / "gantry.urdf"
    file.write_text(gantry())
    with pytest.raises(ConfigError, match=words) as refused:
        load_arm(file, joints, tool, {})
    assert refused.value.evidence["file"] == file
