"""Takes of an arm in a closed loop whose correction NumPy computes, not the compiled loop."""

import numpy as np

from pipeline.models.closed_loop import MeanPath
from pipeline.models.draws import draw_steps


def takes_in_loop(
    model,
    path: MeanPath,
    share: float,
    start: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """(T, M + 1, n) rad, poses of takes of ``model`` that begin at ``start`` (T, n) and correct
    ``share`` κ of their deviation from the ``path`` at each step.
    """
    chain = path.chain
    rows = len(path.chain.task)
    poses = [start]
    for target, v in zip(path.poses[:-1], path.v, strict=True):
        deviation = chain.displacement(chain.pose(poses[-1]), chain.pose(target))
        commands = np.tile(v, (len(start), 1))
        commands[:, :rows] += share * deviation
        moved, _ = draw_steps(model, chain, poses[-1], commands, rng)
        poses.append(moved)
    return np.stack(poses, axis=1)
