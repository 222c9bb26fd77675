"""The youBot's URDF and how its chain is taken from it, and URDFs of other chains."""

from __future__ import annotations

from pathlib import Path

YOUBOT = Path("pipeline/arm/youbot.urdf")
JOINTS = ["arm_joint_2", "arm_joint_3", "arm_joint_4"]
# rad, away from the poses that the experiment holds them at
LOCKED = {"arm_joint_1": 2.4, "arm_joint_5": 0.7}


def urdf(
    axes: tuple[str, str, str],
    *,
    base: str = "0 0 0",
    kinds: tuple[str, str, str] = ("revolute",) * 3,
) -> str:
    """A chain a, b, c of three joints about ``axes`` on a base turned by ``base`` (roll, pitch,
    yaw), with a tool beyond.
    """
    lines = ['<robot name="test"><link name="root"/><link name="base"/>']
    lines += [
        '<joint name="foot" type="fixed"><parent link="root"/><child link="base"/><origin '
        f'xyz="0.1 -0.2 0.3" rpy="{base}"/></joint>'
    ]
    below = "base"
    for name, axis, kind, place in zip(
        "abc", axes, kinds, ("0.02 0.05 0.1", "0.1 0.03 0.2", "-0.05 0.02 0.15"), strict=True
    ):
        limit = (
            '<limit lower="-2" upper="1.5" velocity="1.2" effort="1"/>'
            if kind != "continuous"
            else ""
        )
        lines.append(
            f'<link name="link_{name}"/><joint name="{name}" type="{kind}"><parent '
            f'link="{below}"/><child link="link_{name}"/>'
            f'<origin xyz="{place}" rpy="0 0 0"/><axis xyz="{axis}"/>{limit}</joint>'
        )
        below = f"link_{name}"
    lines.append(
        '<link name="tool"/><joint name="grip" type="fixed"><parent link="link_c"/><child '
        'link="tool"/>'
    )
    lines.append('<origin xyz="0.1 -0.04 0.12" rpy="0.3 0 0"/></joint></robot>')
    return "\n".join(lines)
