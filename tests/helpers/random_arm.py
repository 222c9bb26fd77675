"""Arms of any number of revolute joints and task rows, and commands for them."""

from dataclasses import replace

import numpy as np
from space_arms import revolute_arm

from pipeline.arm.chain import SerialChain

SIZES = [
    (2, 1),
    (2, 2),
    (3, 2),
    (4, 4),
    (5, 3),
    (6, 6),
    (7, 6),
    (8, 3),
]  # of n joints and m rows


def random_arm(n: int, m: int) -> SerialChain:
    """An arm of ``n`` joints and ``m`` of the six rows; the plane's three parallel joints for
    (3, 2).
    """
    arm = revolute_arm(n)
    if (n, m) != (3, 2):
        rows = np.random.default_rng(100 * n + m).permutation(6)[:m]
        return replace(arm, task=tuple(arm.task[row] for row in rows))
    turns = np.tile(np.eye(3).ravel(), (4, 1))
    turns[0] = [1, 0, 0, 0, 0, 1, 0, -1, 0]  # the first joint's axis along y
    ways = [[0, 0, 0], [0, -0.155, 0], [0, -0.135, 0], [0, -0.17, 0]]
    return replace(arm, task=("x", "z"), placements=np.hstack([turns, ways]))


def motion(arm: SerialChain, steps: int, rest: int, size: float = 0.02) -> tuple:
    """(steps + 1, n) regular poses in rad of a slow motion, at rest over the first ``rest`` steps,
    and its commands (steps, m) or (steps, m + n).
    """
    n, m = len(arm.lower), len(arm.task)
    rng = np.random.default_rng(7)
    candidates = rng.uniform(-2, 2, (400, n))
    values = np.linalg.svd(arm.jacobian(candidates), compute_uv=False)
    phase = size * np.maximum(np.arange(steps + 1) - rest, 0)[:, None]
    wave = 0.4 * np.sin(phase * rng.uniform(0.7, 1.3, n) + rng.uniform(0, 6, n))
    best = candidates[(values[:, -1] / values[:, 0]).argsort()[-20:]]
    paths = best[:, None] + wave - wave[0]
    values = np.linalg.svd(arm.jacobian(paths), compute_uv=False)
    q = paths[(values[..., -1] / values[..., 0]).min(axis=1).argmax()]
    w = np.diff(q, axis=0)
    v = np.matvec(arm.jacobian(q[:-1]), w)
    return q, (v if m == n else np.concatenate([v, w], axis=1))
