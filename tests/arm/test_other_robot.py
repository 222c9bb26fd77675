"""A third robot: a gantry arm that turns about x, with sliding and fixed joints below, within and
beyond its planar chain.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from pipeline.arm.model import load_arm
from pipeline.core.errors import ConfigError

JOINTS = ["shoulder", "elbow", "wrist"]
LOCKED = {"carriage": 0.35, "telescope": 0.08, "turret": 0.9}  # m, m, rad


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    """Carriage (slides), turret (about z), shoulder (−x), telescope (slides), elbow (+x), plate
    (fixed), wrist (+x), finger and flange.
    """
    links = [
        "rail",
        "slide",
        "tower",
        "upper",
        "rod",
        "fore",
        "bracket",
        "hand",
        "finger",
        "flange",
    ]
    joints = [
        ("carriage", "prismatic", "rail", "slide", "0 0 0.2", "0 0 0", "0 1 0"),
        ("turret", "revolute", "slide", "tower", "0.1 0 0.3", "0 0 0", "0 0 1"),
        ("shoulder", "revolute", "tower", "upper", "0.05 0 0.1", "0.3 0 0", "-1 0 0"),
        ("telescope", "prismatic", "upper", "rod", "0.02 0 0.2", "0 0 0", "0 0 1"),
        ("elbow", "revolute", "rod", "fore", "-0.03 0.01 0.1", "0 0 0", "1 0 0"),
        ("plate", "fixed", "fore", "bracket", "0 0 0.15", "0 0 0", ""),
        ("wrist", "revolute", "bracket", "hand", "0 0 0.1", "-0.2 0 0", "1 0 0"),
        ("gripper", "prismatic", "hand", "finger", "0 0.02 0.1", "0 0 0", "0 1 0"),
        ("mount", "fixed", "hand", "flange", "0.04 0.03 0.12", "0 0.4 0", ""),
    ]
    lines = ['<robot name="gantry">', *(f'<link name="{link}"/>' for link in links)]
    for name, kind, parent, child, xyz, rpy, axis in joints:
        moving = (
            f'<axis xyz="{axis}"/><limit lower="-1.5" upper="1.4" velocity="1" effort="1"/>'
            if axis
            else ""
        )
        ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
        lines.append(f'<joint name="{name}" type="{kind}">{ends}{moving}</joint>')
    file = tmp_path_factory.mktemp("gantry") / "gantry.urdf"
    file.write_text("\n".join([*lines, "</robot>"]))
    return file


def test_the_chain_is_the_whole_robots_wherever_the_other_joints_are_held(urdf):
    arm = load_arm(urdf, JOINTS, "flange", LOCKED)
    model = pin.buildModelFromUrdf(str(urdf))
    data, frame = model.createData(), model.getFrameId("flange")
    assert arm.chain.signs.tolist() == [1, -1, -1]
    start = None
    for q in np.vstack([np.zeros(3), np.random.default_rng(4).uniform(-1.4, 1.4, (20, 3))]):
        full = pin.neutral(model)
        for name, value in [*LOCKED.items(), *zip(JOINTS, q, strict=True)]:
            full[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, full)
        place = data.oMf[frame].copy()
        start = start or place
        x, z, phi = arm.chain.pose(q)
        across = arm.to_plane(start.translation)[1]
        np.testing.assert_allclose(
            arm.to_base(np.array([x, across, z])), place.translation, atol=1e-12
        )
        turn = pin.AngleAxis(phi, arm.rotation[:, 1]).toRotationMatrix()
        np.testing.assert_allclose(turn @ start.rotation, place.rotation, atol=1e-12)


def test_a_held_sliding_joint_within_the_chain_makes_a_link_longer(urdf):
    short, long = (
        load_arm(urdf, JOINTS, "flange", LOCKED | {"telescope": extent}).chain.lengths
        for extent in (0.0, 0.08)
    )
    np.testing.assert_allclose(
        long - short, [np.hypot(0.01, 0.38) - np.hypot(0.01, 0.3), 0, 0], atol=1e-12
    )


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        (["shoulder", "telescope", "elbow"], "revolute joints with limits, which telescope is not"),
        (["turret", "shoulder", "elbow"], "not parallel.*not to that of turret is shoulder, elbow"),
        (["shoulder", "elbow", "plate"], "no joint 'plate'"),
        (["elbow", "shoulder", "wrist"], "in the order of the chain"),
    ],
)
def test_a_choice_that_is_no_planar_chain_names_the_joint(urdf, joints, said):
    locked = {name: value for name, value in LOCKED.items() if name not in joints}
    with pytest.raises(ConfigError, match=said):
        load_arm(urdf, joints, "flange", locked)
