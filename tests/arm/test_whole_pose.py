"""Steps of six and seven joints for one of the tip's whole pose against NumPy's pseudoinverse;
which arms have them, and at which poses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from compiled_calls import from_python
from space_arms import LWR4, UR5, revolute_arm

from pipeline.arm import seven_joints, six_joints, whole_pose
from pipeline.arm.middle import LEAST, middle_of
from pipeline.arm.model import chain_of
from pipeline.arm.serial import LEAST_SINGULAR, SerialChain
from pipeline.arm.serial_compiled import WIDTH

SOLVE = {6: from_python(six_joints.joint_steps), 7: from_python(seven_joints.joint_steps)}
ARMS = {
    "ur5": lambda: chain_of(replace(UR5, length=0.4)),
    "lwr4": lambda: chain_of(replace(LWR4, length=0.4)),
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
    step, mirror = (room[at : at + k, :count].T for at, k in ((whole_pose.STEP, n), (21, 6)))
    assert np.isnan(room[whole_pose.SPARE :]).all() and np.isnan(room[:, count:]).all()
    return step, mirror, regular


def poses(chain, count: int) -> np.ndarray:
    n = len(chain.lower)
    return np.random.default_rng(2).uniform(-2, 2, (count, n))


def test_the_steps_are_those_of_the_pseudoinverse_wherever_a_block_is_regular(chain):
    q = poses(chain, 400)
    v = np.random.default_rng(3).standard_normal((400, 6))
    jacobian = chain.jacobian(q)
    inverse = np.linalg.pinv(jacobian)
    regular = 0
    for k in range(400):
        (step,), (mirror,), good = solved(chain, q, v[k : k + 1], k)
        if not good:
            continue
        regular += 1
        if q.shape[1] == 7:
            # t is the reflection of the null vector, along which the step is any
            axis = np.append(mirror, 1.0)
            null = np.eye(7)[6] - 2 * axis / (axis @ axis)
            assert np.abs(jacobian[k] @ null).max() < 1e-12
            step = step - null * (null @ step)
        size = np.linalg.norm(inverse[k]) * np.linalg.norm(v[k])
        np.testing.assert_allclose(step / size, inverse[k] @ v[k] / size, atol=1e-12)
    assert regular > 100


def test_a_block_is_regular_only_while_every_pose_has_twice_the_least_singular_value(chain):
    q = poses(chain, 2000)
    least = np.linalg.svd(chain.jacobian(q), compute_uv=False)[:, -1]
    v = np.ones((1, 6))
    regular = np.array([solved(chain, q, v, k)[2] for k in range(len(q))])
    bound = LEAST_SINGULAR * chain.scale
    assert least[regular].min() > 2 * bound
    # the bound is one of all singular values: it is no wider than need be for most poses
    assert regular.mean() > 0.2
    good, bad = q[regular][:9], q[least < bound][:1]
    block, v = np.concatenate([good, bad]), np.ones((10, 6))
    assert solved(chain, block, v[:9])[2] and not solved(chain, block, v)[2]
    block[4, 3] = np.nan
    assert not solved(chain, block, v[:9])[2]


def test_a_part_of_a_block_has_the_numbers_of_the_whole(chain):
    q = poses(chain, 2000)
    regular = np.array([solved(chain, q, np.ones((1, 6)), k)[2] for k in range(len(q))])
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
