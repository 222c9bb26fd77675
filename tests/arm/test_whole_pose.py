"""Steps of six and seven joints for one of the tip's whole pose against NumPy's pseudoinverse;
which arms have them, and at which poses.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numba
import numpy as np
import pytest
from compiled_calls import from_python
from numba import int64, types
from space_arms import LWR4, UR5, revolute_arm

from pipeline.arm import seven_joints, six_joints, whole_pose
from pipeline.arm.compiled import ARM
from pipeline.arm.middle import LEAST, middle_of
from pipeline.arm.model import chain_of
from pipeline.arm.serial import LEAST_SINGULAR, SerialChain
from pipeline.arm.serial_compiled import WIDTH
from pipeline.core.compiled import MATRIX, VECTOR

SOLVE = {6: from_python(six_joints.joint_steps), 7: from_python(seven_joints.joint_steps)}
ARMS = {
    "ur5": lambda: chain_of(replace(UR5, length=0.4)),
    "lwr4": lambda: chain_of(replace(LWR4, length=0.4)),
    "six": lambda: revolute_arm(6),
    "seven": lambda: revolute_arm(7),
}


@pytest.fixture(scope="module", params=ARMS)
def chain(request) -> SerialChain:
    return ARMS[request.param]()


def solved(chain, q, v, start: int = 0) -> tuple[np.ndarray, np.ndarray, bool]:
    """Of a block of the poses ``q`` (N, n) from ``start`` on with steps ``v`` (count, 6) of the
    tip: steps of the joints (count, n), t (count, 6) of the reflection, whether all are regular.
    """
    n, count = q.shape[1], len(v)
    room, command = np.full((40, WIDTH), np.nan), np.zeros((6, WIDTH))
    command[:, :count] = v.T
    columns, numbers = np.ascontiguousarray(q.T), chain.numbers()
    regular = SOLVE[n](numbers, middle_of(chain), columns, start, count, command, room)
    assert np.isnan(room[whole_pose.SPARE :]).all() and np.isnan(room[:, count:]).all()
    step, mirror = room[whole_pose.STEP :][:n], room[whole_pose.MIRROR :][:6]
    return step[:, :count].T, mirror[:, :count].T, regular


def poses(chain) -> tuple[np.ndarray, np.ndarray]:
    """Poses (1000, n), and whether a block of the one alone is regular."""
    n, v = len(chain.lower), np.ones((1, 6))
    q = np.random.default_rng(2).uniform(-2, 2, (1000, n))
    return q, np.array([solved(chain, q, v, k)[2] for k in range(len(q))])


def test_the_steps_of_regular_poses_are_those_of_the_pseudoinverse(chain):
    q, regular = poses(chain)
    q = q[regular][:320]
    v = np.random.default_rng(3).standard_normal((len(q), 6))
    jacobian = chain.jacobian(q)
    inverse = np.linalg.pinv(jacobian)
    blocks = [solved(chain, q, v[k : k + WIDTH], k) for k in range(0, len(q), WIDTH)]
    step, mirror = (np.concatenate([block[k] for block in blocks]) for k in (0, 1))
    assert all(block[2] for block in blocks)
    if q.shape[1] == 7:
        # t is the reflection of the null vector, along which the step is any
        axis = np.hstack([mirror, np.ones((len(q), 1))])
        null = np.eye(7)[6] - 2 * axis / np.vecdot(axis, axis)[:, None]
        np.testing.assert_allclose(np.matvec(jacobian, null), 0, atol=1e-12)
        step = step - null * np.vecdot(null, step)[:, None]
    size = np.linalg.norm(inverse, axis=(1, 2)) * np.linalg.norm(v, axis=1)
    expected = np.matvec(inverse, v)
    np.testing.assert_allclose(step / size[:, None], expected / size[:, None], atol=1e-12)


def test_no_block_with_a_nearly_singular_pose_is_regular_and_few_others_are_not(chain):
    q, regular = poses(chain)
    least = np.linalg.svd(chain.jacobian(q), compute_uv=False)[:, -1] / chain.scale
    assert least[regular].min() > LEAST_SINGULAR
    assert regular[least > 40 * LEAST_SINGULAR].all()
    good, bad = q[regular][:9], q[least.argsort()][:1]
    block, v = np.concatenate([good, bad]), np.ones((10, 6))
    assert solved(chain, block, v[:9])[2] and not solved(chain, block, v)[2]
    block[4, 3] = np.nan
    assert not solved(chain, block, v[:9])[2]


def test_a_part_of_a_block_has_the_numbers_of_the_whole(chain):
    q, regular = poses(chain)
    q = q[regular][: WIDTH + 9]
    v = np.random.default_rng(4).standard_normal((WIDTH, 6))
    whole, _, _ = solved(chain, q, v, 9)
    for start, count in ((9, 5), (9, WIDTH - 1)):
        part, _, _ = solved(chain, q, v[:count], start)
        np.testing.assert_array_equal(part, whole[:count])


def test_other_arms_are_left_to_the_general_way():
    six = revolute_arm(6)
    assert middle_of(six)[LEAST] > 0
    sliding = np.arange(6) == 2
    assert middle_of(replace(six, sliding=sliding)) is None
    assert middle_of(replace(six, task=("y", "x", "z", "rx", "ry", "rz"))) is None
    assert middle_of(replace(six, task=("x", "y", "z", "rx", "ry"))) is None
    assert middle_of(revolute_arm(8)) is None
    # the fourth joint about the axis of the third
    placements = six.placements.copy()
    placements[3] = [*np.eye(3).ravel(), 0.0, 0.0, 0.2]
    assert middle_of(replace(six, placements=placements)) is None


@pytest.mark.slow
@pytest.mark.parametrize("joints", [six_joints, seven_joints])
def test_the_steps_of_several_poses_are_computed_at_once(joints):
    block = types.boolean(ARM, VECTOR, MATRIX, int64, int64, MATRIX, MATRIX)
    solve = numba.njit(block, error_model="numpy")(joints.joint_steps.py_func)
    wide = re.findall(r"call <\d+ x double> @llvm\.fma", solve.inspect_llvm(solve.signatures[0]))
    # a few are those of the sines; if one pose were taken at a time there would be no others
    assert len(wide) > 200
