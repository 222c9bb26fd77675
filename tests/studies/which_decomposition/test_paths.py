"""The paths keep the ranges of their prior, and no model decides which are kept."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.studies.which_decomposition.paths import (
    KINDS,
    TimeLaw,
    draw_paths,
    joint_angles,
    with_tool,
)

STILL = (0.0, 0.0)
CONSTANT = TimeLaw(320, 100.0, STILL, STILL, (1.0, 1.0), once=(0.1, 1.0))


@pytest.mark.parametrize("kind", KINDS)
def test_every_path_keeps_the_limits_and_the_bound(arm, stated, paths, kind):
    part = paths[kind]
    assert part.q.shape == part.step.shape == (40, 320, 3)
    assert np.all(arm.within_limits(part.q))
    assert np.abs(part.inverse @ arm.jacobian(part.q) - np.eye(3)).max() < 1e-8
    assert np.linalg.norm(part.inverse, axis=(2, 3)).max() < stated.u
    speed = np.abs(part.step * 100 / arm.max_speed).max(axis=(1, 2))
    np.testing.assert_allclose(speed, part.peak)
    assert 0.19 < speed.min() and speed.max() < 1.13 and speed.std() > 0.1
    np.testing.assert_allclose(np.diff(part.q, axis=1), part.step[:, :-1], atol=1e-12)


def test_lines_are_straight_and_loops_close(arm, paths):
    for kind, points in (("joint line", lambda q: q), ("task line", arm.pose)):
        q = points(paths[kind].q)
        middle = q[:, 150] - q[:, 0]
        off = np.cross(q - q[:, :1], middle[:, None]) / np.vecdot(middle, middle)[:, None, None]
        assert np.abs(off).max() < 1e-6
    loop = paths["loop"]
    np.testing.assert_allclose(loop.q[:, -1] + loop.step[:, -1], loop.q[:, 0], atol=1e-9)


def test_constant_speed_has_the_fastest_joint_at_its_limit(arm, stated):
    part = draw_paths(arm, CONSTANT, "joint line", stated.u, 10, np.random.default_rng(1))
    speed = np.abs(part.step * 100 / arm.max_speed).max(axis=2)
    np.testing.assert_allclose(speed, 1.0, rtol=1e-6)


def test_inverse_kinematics_returns_the_angles(arm):
    rng = np.random.default_rng(2)
    arm = with_tool(arm, 0.2)
    q = rng.uniform(arm.lower, arm.upper, (500, 3))
    back = joint_angles(arm, arm.pose(q), np.sign(arm.determinant(q)))
    whole_turns = np.round((back - q) / (2 * np.pi)) * 2 * np.pi
    np.testing.assert_allclose(back - whole_turns, q, atol=1e-9)
    np.testing.assert_allclose(arm.lengths[2], 0.2)
