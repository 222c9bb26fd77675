"""The chain by NumPy alone is the compiled one."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from pipeline.arm.model import chain_of
from pipeline.arm.serial import PlainChain
from pipeline.core.errors import SingularJacobianError
from pipeline.core.options.dataset import Robot
from tests.arm.serial_arms import UR5, jn, random_text

KINDS = {
    "ur5": None,
    "redundant": ["revolute"] * 7,
    "sliding": ["prismatic", "revolute", "revolute", "prismatic"],
}


@pytest.fixture(params=KINDS)
def chains(request, tmp_path):
    """The compiled chain and the plain one of an arm."""
    robot = Robot(str(UR5), [f"joint_{j}" for j in range(1, 7)], "flange", length=0.3)
    if kinds := KINDS[request.param]:
        (tmp_path / "robot.urdf").write_text(random_text(kinds, np.random.default_rng(5)))
        task = ["x", "rz"] if len(kinds) < 6 else None
        robot = Robot(str(tmp_path / "robot.urdf"), jn(len(kinds)), task=task, length=0.3)
    chain = chain_of(robot)
    return chain, PlainChain(**{each.name: getattr(chain, each.name) for each in fields(chain)})


def test_pose_jacobian_inverse_and_displacement_are_those_of_the_compiled_chain(chains):
    compiled, plain = chains
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (5, 40, len(compiled.lower)))
    assert np.array_equal(plain.singular(q), compiled.singular(q))
    q = q[~compiled.singular(q)]
    np.testing.assert_allclose(plain.pose(q), compiled.pose(q), atol=1e-12)
    np.testing.assert_allclose(plain.jacobian(q), compiled.jacobian(q), atol=1e-12)
    inverse = compiled.inverse_jacobian(q)
    np.testing.assert_allclose(plain.inverse_jacobian(q), inverse, atol=1e-10 * inverse.max())
    start, end = (compiled.pose(x) for x in (q, q + 0.1))
    np.testing.assert_allclose(
        plain.displacement(start, end), compiled.displacement(start, end), atol=1e-12
    )
    assert not plain.displacement(start, start).any()
    assert plain.jacobian(q[0]).shape == compiled.jacobian(q[0]).shape


def test_a_singular_pose_is_refused_by_both(chains):
    compiled, plain = chains
    q = np.full(len(compiled.lower), np.nan)
    for chain in (compiled, plain):
        with pytest.raises(SingularJacobianError):
            chain.inverse_jacobian(q)
