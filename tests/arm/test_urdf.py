"""The arm that the options ask for: base and tip named or found; joints held, coupled, endless; one
message that says what to do for what is no arm, or no task of it; listed values of two arms.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from space_arms import LWR4, link_poses
from space_arms import UR5 as ARM

from pipeline.arm.model import chain_of, link_chains
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot
from tests.arm.arm_urdfs import (
    LIMIT,
    YOUBOT,
    by_pinocchio,
    jn,
    joint,
    origin,
    robot_text,
)

PLACE = origin(pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.5, 0.8), np.array([0.1, 0.2, 0.3])))
MIMIC = '<mimic joint="j1" multiplier="-2" offset="0.1"/>'
FINGER = MIMIC.replace("j1", "right")


def moving(
    name: str,
    kind: str,
    parent: str,
    child: str,
    axis: str = "0 0.6 0.8",
    more: str = "",
):
    limit = LIMIT if kind in ("revolute", "prismatic") else ""
    return joint(name, kind, parent, child, f'{PLACE}<axis xyz="{axis}"/>{limit}{more}')


@pytest.fixture
def file(tmp_path):
    """Writes a URDF and tells where."""

    def write(*joints: str, text: str = "") -> str:
        (tmp_path / "robot.urdf").write_text(text or robot_text(*joints))
        return str(tmp_path / "robot.urdf")

    return write


def agrees(robot: Robot, tip: str) -> bool:
    """True where the arm agrees with Pinocchio's model of the whole robot."""
    chain = chain_of(robot)
    low, high = (np.clip(limit, -4, 4) for limit in (chain.lower, chain.upper))
    q = default_rng(1).uniform(low, high, (20, len(low)))
    places, jacobians = by_pinocchio(robot, tip, q)
    return np.allclose(chain.pose(q), places, rtol=0, atol=1e-12) and np.allclose(
        chain.jacobian(q),
        jacobians,
        rtol=0,
        atol=1e-12,
    )


def test_locked_joints_before_between_and_behind_are_held_where_they_are_named():
    names = [f"arm_joint_{j}" for j in (1, 3, 4)]
    held = {"arm_joint_2": 1.1, "arm_joint_5": 0.4}
    assert agrees(
        Robot(str(YOUBOT), names, locked=held, task=["x", "y", "z"]),
        "arm_tool",
    )


def test_the_task_has_the_axes_of_the_base_that_is_named(file):
    urdf = file(
        joint("foot", "fixed", "l0", "plinth", PLACE),
        moving("j1", "revolute", "plinth", "l1"),
        moving("j2", "revolute", "l1", "l2", "1 0 0"),
        joint("side", "fixed", "l0", "desk", PLACE.replace("0.3", "0.4")),
    )

    for base in (None, "plinth", "desk"):
        assert agrees(Robot(urdf, jn(2), base=base, task=["y", "rz"]), "l2")


def test_the_tip_is_the_only_last_link_beyond_the_joints_or_the_one_that_is_named(file):
    urdf = file(
        moving("j1", "revolute", "l0", "l1"),
        moving("j2", "revolute", "l1", "l2", "1 0 0"),
        joint("hand", "fixed", "l2", "palm", PLACE),
        moving("finger", "prismatic", "palm", "nail"),
        joint("lamp", "fixed", "l1", "bulb", PLACE),
    )
    two = {"urdf": urdf, "joints": jn(2), "task": ["x", "rz"]}

    assert agrees(Robot(**two, locked={"finger": 0.3}), "nail")
    for tool in ("palm", "hand"):  # the link, or the joint that holds it
        assert agrees(Robot(**two, tool=tool), "palm")


@pytest.mark.parametrize(
    ("robot", "links"),
    [
        (ARM, ["shoulder", "forearm", "wrist_2", "flange"]),
        (LWR4, ["link_2", "link_5", "flange"]),
    ],
)
def test_a_links_frame_lies_where_pinocchio_has_it(robot, links):
    q = default_rng(1).uniform(-2, 2, (50, len(robot.joints)))
    for link, chain in link_chains(robot, links, "key").items():
        pose = chain.pose(q[:, : len(chain.lower)])
        rotation, position = link_poses(robot, link, q)
        assert_allclose(pose[:, :3], position, atol=1e-12)
        assert_allclose(pose[:, 3:].reshape(-1, 3, 3), rotation, atol=1e-12)

    with pytest.raises(ConfigError, match="no frame 'elbow'"):
        link_chains(robot, ["elbow"], "key")


@pytest.mark.parametrize(
    ("joints", "options", "tip"),
    [
        # a finger that follows another, behind the tip
        (
            [
                ("right", "prismatic", "l1", "r"),
                ("left", "prismatic", "l1", "l", FINGER),
            ],
            {"joints": ["j1"], "tool": "l1", "task": ["ry"]},
            "l1",
        ),
        # a fixed joint whose description says that it follows another
        (
            [("hand", "fixed", "l1", "l2", MIMIC)],
            {"joints": ["j1"], "task": ["x"]},
            "l2",
        ),
        # a tool whose name the next joint has too
        (
            [("l1", "revolute", "l1", "l2")],
            {"joints": ["j1"], "tool": "l1", "task": ["ry"]},
            "l1",
        ),
        # a continuous joint that is held
        (
            [("turn", "continuous", "l1", "l2"), ("j2", "revolute", "l2", "l3")],
            {"joints": ["j1", "j2"], "locked": {"turn": 0.7}},
            "l3",
        ),
        # a continuous joint of the arm
        ([("turn", "continuous", "l1", "l2")], {"joints": ["j1", "turn"]}, "l2"),
    ],
)
def test_joints_beside_and_within_the_arm_are_as_in_pinocchio(
    file,
    joints,
    options,
    tip,
):
    beside = []
    for name, kind, parent, child, *coupling in joints:
        beside.append(moving(name, kind, parent, child, "1 0 0", "".join(coupling)))
    urdf = file(moving("j1", "revolute", "l0", "l1"), *beside)
    robot = Robot(**({"urdf": urdf, "task": ["x", "rz"]} | options))

    assert agrees(robot, tip)

    chain = chain_of(robot)
    endless = [name == "turn" for name in robot.joints]
    for limit in (-chain.lower, chain.upper, chain.max_speed):
        assert np.isinf(limit).tolist() == endless


def test_coupled_joints_are_held_where_those_that_they_follow_are_held(file):
    urdf = file(
        moving("j1", "revolute", "l0", "l1"),
        moving("j2", "revolute", "l1", "l2", "1 0 0"),
        moving("coupled", "revolute", "l2", "l3", "0 1 0", MIMIC),
        moving("j3", "revolute", "l3", "l4", "1 0 0"),
    )
    held = chain_of(Robot(urdf, ["j2", "j3"], locked={"j1": 0.4}, task=["x", "rz"]))
    expected = Robot(
        urdf,
        ["j2", "j3"],
        locked={"j1": 0.4, "coupled": 0.1 - 0.8},
        task=["x", "rz"],
    )
    q = default_rng(1).uniform(-1, 1, (5, 2))

    assert_allclose(
        held.pose(q),
        by_pinocchio(expected, "l4", q)[0],
        atol=1e-12,
    )


def chain(count: int, *, kind: str = "revolute", inside: str = LIMIT) -> list[str]:
    """Joints j1 to j``count`` one behind the other, about z and x in turn."""
    axes = ('<axis xyz="0 0 1"/>', '<axis xyz="1 0 0"/>')
    place = '<origin xyz="0.1 0.2 0.3" rpy="0 0 0"/>'
    return [
        joint(f"j{i + 1}", kind, f"l{i}", f"l{i + 1}", place + axes[i % 2] + inside)
        for i in range(count)
    ]


TWO = chain(2)
HANDS = joint("a", "fixed", "l2", "left"), joint("b", "fixed", "l2", "right")
LOOP = '<joint name="back" type="fixed"><parent link="l2"/><child link="l0"/></joint>'
APART = (
    joint("c", "fixed", "shelf", "lamp"),
    joint("d", "fixed", "lamp", "shelf"),
)
LEANING = "".join(chain(2, kind="prismatic")).replace("0 0 1", "0.6 0.8 0")
COUPLED = robot_text(TWO[0], *chain(2, inside=LIMIT + '<mimic joint="j1"/>')[1:])
REFUSED = [  # URDF, options, words of the refusal
    ("<robot", {}, r"robot\.urdf: this is not a URDF file"),
    (
        f'<!DOCTYPE robot [<!ENTITY e "{"x" * 1000}">]><robot>{"&e;" * 1000}</robot>',
        {},
        "declares entities, which are not read: write their texts",
    ),
    ("<robot name='a'/>", {}, "No link elements found.*: check_urdf shows"),
    (
        "<?xml version='1.0' encoding='klingon'?><robot/>",
        {},
        "not a URDF file .unknown encoding",
    ),
    (
        "<robot><xacro:arm/></robot>",
        {},
        "a xacro: expand it with xacro robot.urdf > arm.urdf",
    ),
    (robot_text(*TWO).replace("0.1 0.2", "${x} 0.2"), {}, "a xacro: expand it"),
    (robot_text(*TWO, TWO[0]), {}, "link 'l1' is not unique; correct it"),
    (
        robot_text(*TWO).replace('"l0"/><child', '"foot"/><child'),
        {},
        r"parent link \[foot\] of joint \[j1\] not found",
    ),
    (
        robot_text(*TWO, '<link name="desk"/>'),
        {},
        r"Two root links.* \[desk\] and \[l0\]",
    ),
    (robot_text(*TWO, *APART), {}, "3 of its 5 links are below the root: connect all"),
    (
        robot_text(
            TWO[0],
            TWO[1].replace("/></joint>", '/><mimic joint="j1" offset="x"/></joint>'),
        ),
        {},
        r"offset value \(x\) is not a valid float",
    ),
    (robot_text(*TWO, LOOP), {"tool": "l2"}, "No root link found"),
    (
        robot_text(*TWO).replace('upper="2.5"', 'upper="nan"'),
        {},
        r"joint \[j1\]: upper value \(nan\) is not a valid float; correct it",
    ),
    (
        robot_text(*chain(2, inside="")),
        {},
        "joint j1 has no limits.*or the type continuous",
    ),
    (
        robot_text(*chain(2, inside='<limit velocity="1" effort="1"/>')),
        {},
        "j1 has no limits",
    ),
    (
        robot_text(*chain(2, inside=LIMIT.replace("-2.5", "x"))),
        {},
        r"joint \[j1\]: lower value \(x\) is not a valid float; correct it",
    ),
    (robot_text(*TWO).replace("0 0 1", "0 0 0"), {}, "the axis of j1 has length 0"),
    (robot_text(*TWO, *HANDS), {}, r"robot.tool: .* name one of \['left', 'right'\]"),
    (COUPLED, {}, "j2 is coupled to j1"),
    (
        robot_text(*TWO, joint("j3", "floating", "l2", "l3")),
        {},
        "j3 before the tip is floating",
    ),
    (
        robot_text(*TWO),
        {"joints": ["j1", "elbow"]},
        r"no joint 'elbow'.*it has \['j1', 'j2'\]",
    ),
    (
        robot_text(*TWO),
        {"joints": ["j2", "j1"]},
        r"one chain .*'l2' are \['j1', 'j2'\]: name them",
    ),
    (robot_text(*TWO), {"tool": "l1"}, r"one chain .*move 'l1' are \['j1'\]"),
    (robot_text(*TWO), {"tool": "hand"}, "robot.tool: no frame 'hand'"),
    (robot_text(*TWO), {"base": "floor"}, "robot.base: no frame 'floor'"),
    (robot_text(*TWO), {"base": "l1"}, "robot.base: 'l1' moves with j1"),
    (robot_text(*TWO), {"locked": {"j1": 0.0}}, "j1 cannot be locked"),
    (robot_text(*TWO), {"locked": {"elbow": 0.0}}, "robot.locked: no joint 'elbow'"),
    (
        robot_text(*TWO),
        {"urdf": "absent.urdf"},
        "No such file or directory.; state its path",
    ),
    # rows that the arm cannot move
    (
        robot_text(*TWO).replace("1 0 0", "0 0 1"),
        {"task": ["z", "x"]},
        "cannot move z; remove",
    ),
    (robot_text(LEANING.replace("1 0 0", "0.8 0.6 0")), {}, "cannot move z"),
]


@pytest.mark.parametrize(("text", "options", "words"), REFUSED, ids=range(len(REFUSED)))
def test_what_is_no_arm_is_refused(file, text, options, words):
    urdf = file(text=text)
    with pytest.raises(ConfigError, match=words) as refused:
        chain_of(
            Robot(**({"urdf": urdf, "joints": jn(2), "task": ["x", "z"]} | options)),
        )
    assert refused.value.evidence["file"] == Path(options.get("urdf", urdf))


@pytest.mark.parametrize(
    ("options", "key", "words"),
    [
        (
            {"task": ["x", "yaw"]},
            "task",
            "must name rows of x, y, z, rx, ry, rz, each once",
        ),
        ({"task": ["x", "y"], "plane": True}, "task", "must name rows of x, z, phi"),
        ({"joints": jn(5)}, "task", "6 rows are more than 5 joints"),
        ({"joints": ["j1"] * 6}, "joints", "must name each joint once"),
    ],
)
def test_options_that_no_arm_has_are_refused_by_their_key(options, key, words):
    with pytest.raises(ConfigError, match=words) as refused:
        Robot(**({"urdf": "robot.urdf", "joints": jn(6)} | options))
    assert refused.value.evidence["key"] == key


QUARTER = np.pi / 2
# Denavit-Hartenberg values, standard convention: d (m), a (m), twist (rad)
LISTED = {
    "ur5": (
        ARM.urdf,
        (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823),
        (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0),
        (QUARTER, 0.0, 0.0, QUARTER, -QUARTER, 0.0),
    ),
    "lwr4": (
        LWR4.urdf,
        (0.31, 0.0, 0.4, 0.0, 0.39, 0.0, 0.078),
        (0.0,) * 7,
        (QUARTER, -QUARTER, -QUARTER, QUARTER, QUARTER, -QUARTER, 0.0),
    ),
}


@pytest.mark.parametrize("arm", LISTED)
def test_the_flange_is_where_the_listed_values_put_it(arm):
    urdf, *listed = LISTED[arm]
    model = pin.buildModelFromUrdf(urdf)
    data = model.createData()
    for q in default_rng(5).uniform(-2, 2, (20, model.nq)):
        frame = np.eye(4)
        for angle, d, a, twist in zip(q, *listed, strict=True):
            c = np.cos(angle)
            s = np.sin(angle)
            ct = np.cos(twist)
            st = np.sin(twist)
            rows = [[c, -s * ct, s * st, a * c], [s, c * ct, -c * st, a * s]]
            frame = frame @ np.array([*rows, [0, st, ct, d], [0, 0, 0, 1]])
        pin.framesForwardKinematics(model, data, q)
        at = data.oMf[model.getFrameId("flange")].homogeneous
        assert_allclose(at, frame, atol=1e-12)
