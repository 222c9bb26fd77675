"""A planar arm is the same arm as a serial chain in its plane; and a plane's task may be a part."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import SINGULAR_SINE, PlanarChain
from pipeline.arm.model import arm_of, chain_of
from pipeline.arm.serial import SerialChain
from pipeline.core.options.dataset import Robot
from tests.arm.example_urdf import JOINTS, LOCKED, YOUBOT, urdf
from tests.arm.serial_arms import UR5

OTHER_ORDER = ["z", "phi", "x"]  # for which there are no closed forms
ORDER = [1, 2, 0]


@pytest.fixture(scope="module", params=["youbot", "ur5", "oblique"])
def options(request, tmp_path_factory) -> dict:
    if request.param == "youbot":
        return {"urdf": str(YOUBOT), "joints": JOINTS, "tool": "arm_tool", "locked": LOCKED}
    if request.param == "ur5":
        return {
            "urdf": str(UR5),
            "joints": ["joint_2", "joint_3", "joint_4"],
            "tool": "wrist_centre",
        }
    file = tmp_path_factory.mktemp("urdf") / "oblique.urdf"
    file.write_text(urdf(("0 1 0", "0 -1 0", "0 1 0"), base="0.4 0.2 -0.3"))
    return {"urdf": str(file), "joints": ["a", "b", "c"]}


@pytest.fixture(scope="module")
def both(options) -> tuple[PlanarChain, SerialChain]:
    planar = chain_of(Robot(**options, plane=True))
    serial = chain_of(Robot(**options, plane=True, task=OTHER_ORDER))
    assert isinstance(planar, PlanarChain) and isinstance(serial, SerialChain)
    return planar, serial


def poses(chain: PlanarChain, count: int = 100) -> np.ndarray:
    q = np.random.default_rng(1).uniform(chain.lower, chain.upper, (4 * count, 3))
    return q[np.abs(np.sin(q[:, 1] - chain.straight)) > 0.05][:count]


def test_limits_are_the_same_and_the_planar_chain_is_the_arms(options, both):
    for name in ("lower", "upper", "max_speed"):
        np.testing.assert_array_equal(*(getattr(chain, name) for chain in both))
    np.testing.assert_array_equal(arm_of(Robot(**options, plane=True)).chain.links, both[0].links)


def test_poses_are_the_same(both):
    planar, serial = both
    q = poses(planar)
    x, z, phi = planar.pose(q).T
    place = serial.pose(q)
    np.testing.assert_allclose(place[:, [0, 2]], np.stack([x, z], axis=1), atol=1e-12)
    assert np.ptp(place[:, 1]) < 1e-12
    start = Rotation.from_matrix(serial.pose(np.zeros(3))[3:].reshape(3, 3))
    turned = (Rotation.from_rotvec(np.outer(phi, [0, 1, 0])) * start).as_matrix()
    np.testing.assert_allclose(place[:, 3:], turned.reshape(-1, 9), atol=1e-12)


def test_jacobians_inverses_and_steps_are_the_same(both):
    planar, serial = both
    q, v = poses(planar), np.random.default_rng(2).normal(size=3)
    np.testing.assert_allclose(serial.jacobian(q), planar.jacobian(q)[:, ORDER], atol=1e-12)
    inverse = planar.inverse_jacobian(q)
    np.testing.assert_allclose(
        serial.inverse_jacobian(q), inverse[..., ORDER], atol=1e-12 * np.abs(inverse).max()
    )
    step = planar.nominal_step(q, v)
    np.testing.assert_allclose(step, np.matvec(inverse, v), atol=1e-12 * np.abs(step).max())
    np.testing.assert_allclose(
        serial.nominal_step(q, v[ORDER]), step, atol=1e-12 * np.abs(step).max()
    )
    assert not planar.null_step(q, v).any() and planar.null_step(q, v).shape == q.shape


def test_displacements_are_the_same_up_to_half_a_turn(both):
    planar, serial = both
    q = poses(planar)
    steps = np.random.default_rng(3).uniform(-1, 1, q.shape)
    (start, end), (here, there) = ((chain.pose(q), chain.pose(q + steps)) for chain in both)
    expected = planar.displacement(start, end)
    np.testing.assert_allclose(expected, end - start, atol=0)
    np.testing.assert_allclose(serial.displacement(here, there), expected[:, ORDER], atol=1e-12)


def test_the_same_poses_are_singular_but_for_those_near_the_edge(both):
    planar, serial = both
    near = np.array([0.3, planar.straight, -0.2])
    sines = np.geomspace(1e-5, 1, 40)[:, None]
    q = near + np.arcsin(sines) * np.array([0, 1, 0])
    least = np.linalg.svd(serial.jacobian(q), compute_uv=False)[:, -1]
    np.testing.assert_array_equal(serial.singular(q), least < serial.numbers().least)
    for chain in both:
        assert chain.singular(q)[0] and not chain.singular(q)[-1]
    assert planar.singular(q).sum() == (sines < SINGULAR_SINE).sum()


def test_the_numbers_are_the_links_signs_and_origin(both):
    planar = both[0]
    expected = [*planar.links[0], *planar.links[1], *planar.links[2], *planar.signs, *planar.origin]
    assert planar.numbers().plane.tolist() == expected


def test_part_of_the_planes_task_is_redundant_and_its_rows_are_the_planes(options):
    whole, part = (chain_of(Robot(**options, plane=True, task=task)) for task in (None, ["x", "z"]))
    q = poses(whole)
    np.testing.assert_allclose(part.jacobian(q), whole.jacobian(q)[:, :2], atol=1e-12)
    command = np.random.default_rng(4).normal(size=(len(q), 5))
    rest = part.null_step(q, command)
    np.testing.assert_allclose(np.matvec(whole.jacobian(q), rest)[:, :2], 0, atol=1e-11)
    assert np.abs(np.matvec(whole.jacobian(q), rest)[:, 2]).min() > 0


def test_a_length_of_a_plane_multiplies_the_angle(options):
    plain, longer = (chain_of(Robot(**options, plane=True, length=size)) for size in (1.0, 0.25))
    q = poses(plain)
    expected = plain.jacobian(q) * np.array([1, 1, 0.25])[:, None]
    np.testing.assert_allclose(longer.jacobian(q), expected, atol=1e-12)
