"""Arms of one to eight revolute and prismatic joints: the angles that carry points where they were
seen come back, and are forgotten by joints that no point hangs on.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.arm.serial import SerialChain
from pipeline.core.task import SPACE
from pipeline.perception.space import Carried


def placements(count: int, rng: np.random.Generator) -> np.ndarray:
    turns = Rotation.random(count, rng=rng).as_matrix().reshape(-1, 9)
    return np.hstack([turns, rng.uniform(-0.3, 0.3, (count, 3))])


def arm(n: int, rng: np.random.Generator, points: int = 3) -> tuple[Carried, list[SerialChain]]:
    """An arm with ``points`` on a link beyond each of its joints, and the chains to these."""
    sliding = rng.random(n) < 0.3
    whole, ends, chains = placements(n, rng), placements(n, rng), []
    for j in range(n):
        to_link = np.vstack([whole[: j + 1], ends[j]])
        limits = np.full(j + 1, -2.0), np.full(j + 1, 2.0), np.ones(j + 1)
        chains.append(SerialChain(SPACE, 1.0, to_link, sliding[: j + 1], *limits))
    carried = Carried(
        chains=chains,
        sliding=sliding,
        lower=chains[-1].lower,
        upper=chains[-1].upper,
        owner=np.repeat(np.arange(n), points),
        places=rng.uniform(-0.1, 0.1, (n * points, 3)),
        bodies=np.zeros(n, bool),
        posture=None,
    )
    return carried, chains


def seen(carried: Carried, chains: list[SerialChain], q: np.ndarray) -> np.ndarray:
    """(P, 3) m, by the chain to each link."""
    result = np.empty_like(carried.places)
    for j, chain in enumerate(chains):
        pose, mine = chain.pose(q[: j + 1]), carried.owner == j
        result[mine] = pose[:3] + carried.places[mine] @ pose[3:].reshape(3, 3).T
    return result


@pytest.mark.parametrize("n", range(1, 9))
def test_points_give_back_the_joints_that_carry_them(n):
    rng = np.random.default_rng(n)
    for _ in range(10):
        carried, chains = arm(n, rng)
        q = rng.uniform(-1.5, 1.5, n)
        solution = carried.solve(seen(carried, chains, q), q + rng.uniform(-0.2, 0.2, n))
        np.testing.assert_allclose(solution.q, q, atol=1e-9)
        assert solution.decided and solution.residual < 1e-9


@pytest.mark.parametrize("n", [2, 5, 8])
def test_the_normal_matrix_is_that_of_finite_differences(n):
    rng = np.random.default_rng(n)
    carried, chains = arm(n, rng)
    q, step = rng.uniform(-1.5, 1.5, n), 1e-6
    jacobian = np.stack(
        [
            (seen(carried, chains, q + e) - seen(carried, chains, q - e)).ravel() / (2 * step)
            for e in step * np.eye(n)
        ],
        axis=1,
    )
    solution = carried.solve(seen(carried, chains, q), q)
    np.testing.assert_allclose(solution.normal, jacobian.T @ jacobian, atol=1e-7)


@pytest.mark.parametrize("n", [3, 7])
def test_a_joint_without_points_beyond_it_stays_where_it_was_and_is_told(n):
    rng = np.random.default_rng(n)
    carried, chains = arm(n, rng)
    q = rng.uniform(-1.5, 1.5, n)
    measured = seen(carried, chains, q)
    measured[carried.owner == n - 1] = np.nan
    start = q + 0.1
    solution = carried.solve(measured, start)
    assert not solution.decided and solution.q[-1] == start[-1]
    np.testing.assert_allclose(solution.q[:-1], q[:-1], atol=1e-9)
