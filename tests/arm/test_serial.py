"""Serial chains of any joints and tasks against Pinocchio and NumPy, pose by pose; arms of the
public collection example-robot-data, which ``make test-all`` installs; trajectories of commands.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import space_arms
from compiled_calls import from_python
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import LEAST_SINGULAR
from pipeline.arm.interface import trajectory_table
from pipeline.arm.inverse import cholesky, mark_singular
from pipeline.arm.kinematics import ArmConstants, add_displacement
from pipeline.arm.model import chain_of
from pipeline.arm.rotations import rotation_vector
from pipeline.arm.rows import JOINTS, ROTATION, WIDTH, block_rows
from pipeline.core.columns import values
from pipeline.core.options.dataset import Robot
from tests.arm.arm_urdfs import YOUBOT, by_pinocchio, jn, random_text

R = "revolute"
P = "prismatic"
KINDS = [
    [R],
    [P, R],
    [R, R, P],
    [R, P, R, R],
    [R] * 5,
    [P, P, P, R, R, R],
    [R] * 7,
    [R, P] * 4,
]
TASKS = [
    ["y"],
    ["rz", "x"],
    ["z", "x", "ry"],
    ["x", "y", "z", "rx"],
    ["rz", "ry", "rx", "z", "y"],
]
LENGTH = 0.4


PEERS = Path(__file__).parents[2] / ".venv-peers"
UNIVERSAL = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow")]
UNIVERSAL += [f"wrist_{j}_joint" for j in (1, 2, 3)]
PANDA, XARM = ([f"{name}{j}" for j in range(1, 8)] for name in ("panda_joint", "joint"))
KINOVA = [f"j2s6s200_joint_{j}" for j in range(1, 7)]  # three of them are continuous
# the torso slides
TIAGO = [
    "torso_lift_joint",
    *(f"arm_{j}_joint" for j in range(1, 8)),
]
TALOS = [
    "torso_1_joint",
    "torso_2_joint",
    *(f"arm_left_{j}_joint" for j in range(1, 7)),
]
PUBLIC = {  # URDF: joints, tip, base
    "ur_description/urdf/ur5_robot": (UNIVERSAL, "tool0", "base"),
    "ur_description/urdf/ur10_robot": (UNIVERSAL, "ee_link", "base_link"),
    "panda_description/urdf/panda": (PANDA, "panda_hand_tcp", None),
    "xarm_description/urdf/xarm7": (XARM, "link_eef", None),
    "kinova_description/robots/kinova": (KINOVA, "j2s6s200_end_effector", None),
    "tiago_description/robots/tiago": (TIAGO, "hand_tool_link", "base_link"),
    "talos_data/robots/talos_reduced": (TALOS, "arm_left_6_link", None),
}


def robot_of(name: str, file: Path) -> Robot:
    """The options of an arm; one of random joints is written to ``file``."""
    if name == "youbot":  # all five joints of the arm and the task that they can do
        joints = [f"arm_joint_{j}" for j in range(1, 6)]
        task = ["rx", "z", "y", "x", "rz"]
        return Robot(str(YOUBOT), joints, "arm_tool", task=task, length=LENGTH)
    if name in ("UR5", "LWR4"):
        return replace(getattr(space_arms, name), length=0.3)
    kinds = name.split("-")
    file.write_text(random_text(kinds, default_rng(len(kinds))))
    task = TASKS[len(kinds) - 1] if len(kinds) <= len(TASKS) else None
    return Robot(str(file), jn(len(kinds)), "tip", task=task, length=LENGTH)


OURS = ["youbot", "UR5", "LWR4", *("-".join(kinds) for kinds in KINDS)]


@pytest.fixture(scope="module", params=OURS)
def robot(request, tmp_path_factory) -> Robot:
    return robot_of(request.param, tmp_path_factory.mktemp("urdf") / "robot.urdf")


@pytest.fixture(scope="module")
def chain(robot):
    return chain_of(robot)


def poses(chain, count: int = 150) -> np.ndarray:
    """Poses within the limits, more than a block of them."""
    low, high = (np.clip(limit, -np.pi, np.pi) for limit in (chain.lower, chain.upper))
    return default_rng(1).uniform(low, high, (count, len(chain.lower)))


def regular(chain, count: int = 150) -> np.ndarray:
    """Those whose least singular value is ten times the least."""
    q = poses(chain, 4 * count)
    return q[least_scaled(chain, q) > 10 * LEAST_SINGULAR][:count]


def least_scaled(chain, q: np.ndarray) -> np.ndarray:
    """(P,) least singular values of the Jacobian without units at ``q`` (P, n)."""
    return np.linalg.svd(chain.scaled_jacobian(q), compute_uv=False)[:, -1]


def test_pose_and_jacobian_are_pinocchios_and_the_inverse_numpys_pseudoinverse(
    robot,
    chain,
):
    q = poses(chain)
    places, jacobians = by_pinocchio(robot, robot.tool, q)
    assert_allclose(chain.pose(q), places, rtol=0, atol=1e-12)
    assert_allclose(chain.jacobian(q), jacobians, rtol=0, atol=1e-12)

    q = regular(chain)
    assert len(q) > 50

    expected = np.linalg.pinv(chain.jacobian(q))
    size = np.linalg.norm(expected, axis=(-2, -1), keepdims=True)
    assert_allclose(
        chain.inverse_jacobian(q) / size,
        expected / size,
        atol=1e-12,
    )


@pytest.mark.slow
@pytest.mark.parametrize("urdf", PUBLIC)
def test_arms_of_the_public_collection_are_pinocchios(urdf):
    places = PEERS.glob(
        "lib/*/site-packages/cmeel.prefix/share/example-robot-data/robots",
    )
    if (collection := next(places, None)) is None:
        pytest.skip(
            "example-robot-data is absent; `make test-all` installs it in .venv-peers",
        )
    robot = Robot(str(collection / f"{urdf}.urdf"), *PUBLIC[urdf], length=0.3)
    test_pose_and_jacobian_are_pinocchios_and_the_inverse_numpys_pseudoinverse(
        robot,
        chain_of(robot),
    )


def test_compiled_code_marks_the_singular_poses_of_the_chain(chain, monkeypatch):
    q = poses(chain, WIDTH)
    m = len(chain.task)
    n = len(chain.lower)
    rows = block_rows(n, m)
    block = np.full((block_rows(n, m).size, WIDTH), np.nan)
    block[rows.jacobian : rows.lower] = chain.jacobian(q).reshape(WIDTH, m * n).T
    places = rows.jacobian, rows.lower, rows.inverse
    from_python(cholesky)(block, *places, m, n, 0.0, WIDTH)
    median = np.median(least_scaled(chain, q))
    for bound in (LEAST_SINGULAR, median):
        monkeypatch.setattr("pipeline.arm.chain.LEAST_SINGULAR", bound)
        bounded = replace(chain)  # a chain keeps its constants
        places = rows.jacobian, rows.lower, rows.spare, rows.singular
        marked = from_python(mark_singular)(block, bounded.constants, *places, WIDTH)
        flags = block[rows.singular] > 0 if marked else np.zeros(WIDTH, dtype=bool)
        assert_array_equal(flags, bounded.singular(q))

    assert 0.4 < flags.mean() < 0.6


def test_what_is_singular_is_so_by_the_least_singular_value(chain, monkeypatch):
    q = poses(chain, 1000)
    least = least_scaled(chain, q)
    for bound in (LEAST_SINGULAR, *np.quantile(least, [0.1004, 0.5004, 0.9004])):
        monkeypatch.setattr("pipeline.arm.chain.LEAST_SINGULAR", bound)
        assert_array_equal(chain.singular(q), least < bound)
    assert 850 < chain.singular(q).sum() < 950


@pytest.mark.parametrize("metre", [100.0, 1000.0])
def test_what_is_singular_does_not_depend_on_the_unit_of_length(chain, metre):
    """The chain in cm and in mm: links, lever of angular rows, coordinates of prismatic joints."""
    units = np.where(chain.sliding, metre, 1.0)
    scaled = replace(
        chain,
        placements=chain.placements * np.repeat([1.0, metre], [9, 3]),
        length=metre * chain.length,
    )
    q = poses(chain, WIDTH)

    assert not scaled.singular(units * regular(chain)).any()

    least = least_scaled(chain, q)
    assert_allclose(least_scaled(scaled, units * q), least, rtol=1e-9)


def test_a_step_does_the_task_and_the_rest_of_the_command_where_the_task_does_not_feel_it(
    chain,
):
    q = regular(chain)
    m = len(chain.task)
    command = default_rng(2).normal(size=(len(q), m + q.shape[1]))
    v = command[:, :m]
    w = command[:, m:]
    jacobian = chain.jacobian(q)
    back = np.linalg.pinv(chain.jacobian(q))
    rest = chain.null_step(q, command)

    assert_allclose(np.matvec(jacobian, rest), 0, atol=1e-11)
    assert_allclose(
        rest,
        w - np.matvec(back, np.matvec(jacobian, w)),
        atol=1e-10,
    )

    step = chain.nominal_step(q, command)
    assert_allclose(np.matvec(jacobian, step), v, atol=1e-10)
    assert_allclose(step - rest, chain.nominal_step(q, v), atol=1e-14)
    assert not chain.null_step(q, v).any()

    # the control: an arm of more joints than rows does more than its task
    assert (np.abs(rest).max() > 0.1) == (q.shape[1] > m)


def test_the_displacement_is_scipys_rotation_vector_times_the_length(robot, chain):
    start = chain.pose(poses(chain, 40))[None, :20]
    end = chain.pose(poses(chain, 40))[20:, None]
    result = chain.displacement(start, end)
    turns = [Rotation.from_matrix(x[..., 3:].reshape(-1, 3, 3)) for x in (start, end)]
    for i, j in np.ndindex(20, 20):
        way = end[i, 0, :3] - start[0, j, :3]
        turn = (turns[1][i] * turns[0][j].inv()).as_rotvec() * robot.length
        all_rows = dict(
            zip(("x", "y", "z", "rx", "ry", "rz"), [*way, *turn], strict=True),
        )
        expected = [all_rows[name] for name in chain.task]
        assert_allclose(result[i, j], expected, atol=1e-12)


@pytest.mark.parametrize("gap", [1.0, 0.1, 1e-3, 1e-6])
def test_compiled_displacements_lose_digits_as_the_turn_nears_half_a_turn(gap):
    rng = default_rng(1)
    axes = rng.normal(size=(WIDTH, 3))
    expected = (np.pi - gap) * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    turns = np.array([pin.exp3(vector) for vector in expected])
    target = pin.exp3(rng.normal(size=3))
    block = np.zeros((JOINTS + 12, WIDTH))
    block[ROTATION : ROTATION + 9] = (turns.swapaxes(1, 2) @ target).reshape(WIDTH, 9).T
    no_links = np.zeros(12), np.empty((0, 6)), 0.0
    constants = ArmConstants(*no_links, np.zeros(1), np.arange(6), np.ones(6), 1.0, 0.0)
    place = np.concatenate([np.zeros(3), target.ravel()])
    from_python(add_displacement)(constants, place, block, JOINTS + 6, 1.0, WIDTH)
    error = np.abs(block[JOINTS + 9 :].T - expected).max()

    assert error < 4e-15 / gap

    # by NumPy at any angle, and by Pinocchio
    tolerance = 1e-9 if gap < 1e-3 else 1e-12
    assert_allclose(rotation_vector(turns), expected, atol=tolerance)
    assert np.abs(pin.log3(turns[0]) - rotation_vector(turns[0])).max() < 1e-10


def test_every_batch_shape_holds_what_single_poses_give(chain):
    q = regular(chain, 6)
    m = len(chain.task)
    n = len(chain.lower)
    tails = {"pose": (12,), "jacobian": (m, n), "inverse_jacobian": (n, m)}
    tails |= {"singular": (), "within_limits": ()}
    for single in (q[0], q, q.reshape(2, 3, n), q[:0]):
        for method, tail in tails.items():
            batch = getattr(chain, method)(single)
            assert np.shape(batch) == (*single.shape[:-1], *tail)
            alone = [getattr(chain, method)(pose) for pose in single.reshape(-1, n)]
            assert_array_equal(batch, np.reshape(alone, np.shape(batch)))
    command = np.zeros((2, 1, m + n))

    assert chain.nominal_step(q[:3], command).shape == (2, 3, n)
    assert chain.null_step(q[:3], command[..., :m]).shape == (2, 3, n)


def test_each_step_of_a_trajectory_is_the_displacement_between_two_poses():
    arm = replace(space_arms.revolute_arm(7), length=0.5)
    t = np.maximum(np.arange(30) - 5, 0) / 20
    # at rest over five steps
    motion = 0.5 + np.sin(t)[:, None] * np.linspace(-1.2, 1.0, 7)
    table = trajectory_table(arm, motion, 50.0, tuple("abcdefg"))
    pose = arm.pose(motion)
    steps = values(table, "v") / 50.0
    places = values(table, "x")
    turns = Rotation.from_matrix(pose[:, 3:].reshape(-1, 3, 3))

    assert_allclose(steps[:-1, :3], np.diff(pose[:, :3], axis=0), atol=1e-12)

    expected = 0.5 * (turns[1:] * turns[:-1].inv()).as_rotvec()
    assert_allclose(steps[:-1, 3:], expected, atol=1e-12)

    expected = 0.5 * (turns * turns[0].inv()).as_rotvec()
    assert_allclose(places, np.hstack([pose[:, :3], expected]), atol=1e-12)
    assert not places[0, 3:].any() and not steps[:5].any() and not steps[-1].any()
