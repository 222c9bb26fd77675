"""Arms of any number of revolute joints and task rows, and commands for them."""

from dataclasses import replace

import numpy as np
from numpy.random import default_rng
from space_arms import revolute_arm

from pipeline.arm.chain import SerialChain

# of n joints and m rows
SIZES = [(2, 1), (2, 2), (3, 2), (4, 4), (5, 3), (6, 6), (7, 6), (8, 3)]


# placements of three parallel joints: the first axis along y
PLANAR = np.array(
    [
        [1, 0, 0, 0, 0, 1, 0, -1, 0, 0, 0, 0],
        [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, -0.155, 0],
        [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, -0.135, 0],
        [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, -0.17, 0],
    ],
)


def random_arm(n: int, m: int) -> SerialChain:
    """An arm of ``n`` joints and ``m`` of the six rows; the plane's three parallel joints for
    (3, 2).
    """
    arm = revolute_arm(n)
    if (n, m) == (3, 2):
        return replace(arm, task=("x", "z"), placements=PLANAR)
    rows = default_rng(100 * n + m).permutation(6)[:m]
    return replace(arm, task=tuple(arm.task[row] for row in rows))


def regularity(arm: SerialChain, q: np.ndarray) -> np.ndarray:
    """(...) least over greatest singular value of J at poses ``q`` (..., n)."""
    values = np.linalg.svd(arm.jacobian(q), compute_uv=False)
    return values[..., -1] / values[..., 0]


def motion(arm: SerialChain, steps: int, rest: int, size: float = 0.02) -> tuple:
    """(steps + 1, n) regular poses in rad of a slow motion, at rest over the first ``rest`` steps,
    and its commands (steps, m) or (steps, m + n).
    """
    n = len(arm.lower)
    m = len(arm.task)
    rng = default_rng(7)
    candidates = rng.uniform(-2, 2, (400, n))
    starts = candidates[regularity(arm, candidates).argsort()[-20:]]

    moving = np.maximum(np.arange(steps + 1) - rest, 0)
    frequencies = rng.uniform(0.7, 1.3, n)
    phases = rng.uniform(0, 6, n)
    angles = size * moving[:, None] * frequencies + phases
    wave = 0.4 * np.sin(angles)
    paths = starts[:, None] + wave - wave[0]
    least_regular = regularity(arm, paths).min(axis=1)
    q = paths[least_regular.argmax()]

    w = np.diff(q, axis=0)
    v = np.matvec(arm.jacobian(q[:-1]), w)
    commands = v if m == n else np.concatenate([v, w], axis=1)
    return q, commands
