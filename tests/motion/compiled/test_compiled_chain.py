"""Sine, cosine and exponential without the C library, and the chain's closed forms in scalars."""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import from_python

from pipeline.motion.compiled.chain import arm_of, joint_step, segments, sine_cosine
from pipeline.motion.compiled.wishart import expm1

SINE_COSINE = from_python(sine_cosine)


def test_sine_and_cosine_are_those_of_the_library_to_a_few_units_in_the_last_place():
    angles = np.concatenate([np.linspace(-7, 7, 20_001), np.random.default_rng(1).uniform(-200, 200, 20_000), np.arange(-8, 9) * np.pi / 4])
    found = np.array([SINE_COSINE(angle) for angle in angles])
    assert np.max(np.abs(found - np.stack([np.sin(angles), np.cos(angles)], axis=1))) < 3e-15
    assert SINE_COSINE(0.0) == (0.0, 1.0)


@pytest.mark.parametrize("angle", [np.inf, -np.inf, np.nan])
def test_of_what_is_no_angle_there_is_no_sine(angle):
    assert np.all(np.isnan(SINE_COSINE(angle)))


def test_the_exponential_less_one_is_the_librarys():
    x = np.concatenate([[0.0, 1e-300, 1e-17], np.geomspace(1e-12, 87.9, 5000)])
    found = np.array(list(map(from_python(expm1), x)))
    np.testing.assert_allclose(found, np.expm1(x), rtol=2e-14, atol=0)


def test_segments_and_joint_steps_are_the_chains(chain, poses):
    v = np.array([0.004, -0.003, 0.03])
    arm = arm_of(chain)
    of_pose, moved = from_python(segments), from_python(joint_step)
    shapes = [of_pose(arm, *q) for q in poses]
    expected = np.diff(chain.points(poses), axis=1).reshape(len(poses), 6)
    np.testing.assert_allclose(shapes, expected, atol=1e-15)
    steps = [moved(arm, *shape, *v) for shape in shapes]
    np.testing.assert_allclose(steps, np.matvec(chain.inverse_jacobian(poses), v), rtol=1e-12)
