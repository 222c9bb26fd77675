"""The kernels of serial chains: any part of a batch, poses on the edge of what is regular, and
displacements by any angle.
"""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import from_python
from scipy.spatial.transform import Rotation

from pipeline.arm.lq import invert, orthonormalise, too_singular
from pipeline.arm.model import chain_of
from pipeline.arm.serial_compiled import (
    WIDTH,
    displacement_rows,
    jacobian_at,
    lower_at,
    spare_at,
    task_jacobian,
    tip,
)
from pipeline.core.options.dataset import Robot
from tests.arm.serial_arms import UR5

TIP, JACOBIAN, DISPLACEMENT = (from_python(f) for f in (tip, task_jacobian, displacement_rows))
LQ, SINGULAR, INVERT = (from_python(f) for f in (orthonormalise, too_singular, invert))
M, N = 5, 7  # of the matrices that are factorised


@pytest.fixture(scope="module")
def chain():
    return chain_of(Robot(str(UR5), [f"joint_{j}" for j in range(1, 7)], "flange", length=0.3))


@pytest.mark.parametrize(("start", "count"), [(0, WIDTH), (3, 1), (17, WIDTH - 5)])
def test_a_room_holds_the_poses_that_were_asked_for_and_nothing_else_is_touched(
    chain, start, count
):
    q = np.random.default_rng(1).uniform(-3, 3, (6, 90))
    room = np.full((spare_at(6, 6), WIDTH), 7.0)
    TIP(chain.numbers(), q, start, count, room)
    JACOBIAN(chain.numbers(), room, count)
    block = q[:, start : start + count].T
    np.testing.assert_array_equal(room[:12, :count].T, chain.pose(block))
    entries = room[jacobian_at(6) : lower_at(6, 6), :count].T
    np.testing.assert_array_equal(entries.reshape(-1, 6, 6), chain.jacobian(block))
    assert (room[:, count:] == 7).all() and (room[lower_at(6, 6) :] == 7).all()


def factorised(matrices: np.ndarray) -> tuple[np.ndarray, int, int]:
    """A room with J = LQ of ``matrices`` (WIDTH, M, N), L after Q, and as many rows to spare."""
    room = np.full((M * N + 2 * M * M + 1, WIDTH), np.nan)
    room[: M * N] = matrices.reshape(WIDTH, M * N).T
    LQ(room, 0, M * N, M * N + M * M, M, N, WIDTH)
    return room, M * N, M * N + M * M


def with_singular_values(least: np.ndarray) -> np.ndarray:
    """(WIDTH, M, N) matrices of least singular values ``least`` (WIDTH,), of the others near 1."""
    rng = np.random.default_rng(3)
    left, right = (np.linalg.qr(rng.normal(size=(WIDTH, k, k)))[0] for k in (M, N))
    values = rng.uniform(0.5, 1, (WIDTH, M))
    values[:, 0] = least
    return (left * values[:, None]) @ right[:, :M]


@pytest.mark.parametrize("least", [0.5, 1e-3])
def test_the_factors_are_lower_and_orthonormal_and_give_the_pseudoinverse(least):
    matrices = with_singular_values(np.full(WIDTH, least))
    room, lower, _ = factorised(matrices)
    q = room[: M * N].T.reshape(-1, M, N)
    factor = room[lower : lower + M * M].T.reshape(-1, M, M)
    assert np.isnan(factor[:, *np.triu_indices(M, 1)]).all()  # not touched
    factor = np.tril(np.nan_to_num(factor))
    assert (np.diagonal(factor, axis1=1, axis2=2) > 0).all()
    np.testing.assert_allclose(factor @ q, matrices, atol=1e-14)
    np.testing.assert_allclose(
        q @ np.swapaxes(q, 1, 2), np.tile(np.eye(M), (WIDTH, 1, 1)), atol=1e-12
    )
    INVERT(room, 0, lower, M, N, WIDTH)
    back = np.swapaxes(room[: M * N].T.reshape(-1, M, N), 1, 2)
    np.testing.assert_allclose(back * least, np.linalg.pinv(matrices) * least, atol=1e-12)


def test_a_least_singular_value_is_told_from_the_bound_to_a_millionth_of_it():
    near = 1e-3 * (1 + 1e-6 * np.where(np.arange(WIDTH) % 2, 1, -1))
    room, lower, spare = factorised(with_singular_values(near))
    room[0, 5] = np.nan
    room[lower, 5] = np.nan
    SINGULAR(room, lower, spare, M, 1e-3, len(room) - 1, WIDTH)
    expected = near < 1e-3
    expected[5] = True
    np.testing.assert_array_equal(room[-1], expected)


@pytest.mark.parametrize(
    ("least", "greatest"),
    [(0, 1e-9), (0, 1e-3), (0, np.pi), (3.1, 3.14), (np.pi - 1e-6, np.pi - 1e-9)],
)
def test_a_displacement_is_exact_for_any_angle_below_half_a_turn(chain, least, greatest):
    rng = np.random.default_rng(4)
    axes = rng.normal(size=(WIDTH, 3))
    axes[:6] = [*np.eye(3), *-np.eye(3)]
    angles = rng.uniform(least, greatest, (WIDTH, 1))
    vectors = axes / np.linalg.norm(axes, axis=1, keepdims=True) * angles
    target = Rotation.random(rng=rng)
    starts = (Rotation.from_rotvec(-vectors) * target).as_matrix()
    room = np.zeros((12, WIDTH))
    room[3:] = starts.reshape(WIDTH, 9).T
    out = np.ones((6, WIDTH))
    goal = np.array([0.1, 0.2, -0.3, *target.as_matrix().ravel()])
    DISPLACEMENT(chain.numbers(), goal, np.vstack([room, np.zeros((3, WIDTH))]), WIDTH, out, 0.5)
    np.testing.assert_allclose(out[:3].T - 1, np.tile(goal[:3] / 2, (WIDTH, 1)), atol=1e-15)
    np.testing.assert_allclose((out[3:].T - 1) / 0.15, vectors, atol=1e-12)
