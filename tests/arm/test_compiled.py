"""Sine and cosine without the C library, and the chain's closed forms in scalars."""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import from_python

from pipeline.arm.chain import PlanarChain
from pipeline.arm.compiled import joint_step, plane_of, segments, sine_cosine

SINE_COSINE = from_python(sine_cosine)


def test_sine_and_cosine_are_those_of_the_library_to_a_few_units_in_the_last_place():
    angles = np.concatenate(
        [
            np.linspace(-7, 7, 20_001),
            np.random.default_rng(1).uniform(-200, 200, 20_000),
            np.arange(-8, 9) * np.pi / 4,
        ]
    )
    result = np.array([SINE_COSINE(angle) for angle in angles])
    assert np.max(np.abs(result - np.stack([np.sin(angles), np.cos(angles)], axis=1))) < 3e-15
    assert SINE_COSINE(0.0) == (0.0, 1.0)


@pytest.mark.parametrize("angle", [np.inf, -np.inf, np.nan])
def test_of_what_is_no_angle_there_is_no_sine(angle):
    assert np.all(np.isnan(SINE_COSINE(angle)))


def test_segments_and_joint_steps_are_the_chains():
    links = np.array([[0.01, 0.155], [-0.02, 0.135], [0.03, 0.17]])
    ends = np.full(3, -3.0), np.full(3, 3.0), np.ones(3)
    chain = PlanarChain(np.zeros(2), links, np.array([1.0, -1.0, 1.0]), *ends)
    q = np.random.default_rng(0).uniform(-2, 2, (2000, 3))
    poses = q[np.abs(chain.determinant(q)) > 0.2 * chain.lengths[0] * chain.lengths[1]]
    v = np.array([0.004, -0.003, 0.03])
    arm = from_python(plane_of)(chain.numbers())
    shape_at, moved = from_python(segments), from_python(joint_step)
    shapes = [shape_at(arm, tuple(q)) for q in poses]
    expected = np.diff(chain.points(poses), axis=1).reshape(len(poses), 6)
    np.testing.assert_allclose(shapes, expected, atol=1e-15)
    steps = [moved(arm, shape, tuple(v)) for shape in shapes]
    np.testing.assert_allclose(
        steps, np.matvec(chain.inverse_jacobian(poses), v), rtol=1e-12, atol=1e-15
    )
