"""Noise of a step of fixed duration in a controller's logs, joint by joint, without a Jacobian."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.models.joint_error.samples import JointRun

STEP = 0.01  # s, the paper's step


def step_noise(runs: Sequence[JointRun]) -> pd.DataFrame:
    """Return the table ``step_noise``: covariances, in rad², of the changes of the tracking errors
    within STEP, over all steps and over the slow and the fast half by the joint's commanded speed,
    and of successive changes. The errors are measured minus commanded angles, without the lag of
    each joint; joints whose command rests are left out.
    """
    noise, pace = [], []
    for run in runs:
        stride = max(round(STEP * run.rate), 1)
        error = (run.measured - run.command)[::stride]
        noise.append(np.diff(error, axis=0))
        pace.append(np.abs(np.diff(run.command[::stride], axis=0)))
    steps, speeds = np.concatenate(noise), np.concatenate(pace)
    before = np.concatenate([changes[:-1] for changes in noise])
    after = np.concatenate([changes[1:] for changes in noise])
    joints = runs[0].joints
    moving = np.flatnonzero(speeds.any(axis=0))
    rows = []
    for place, j in enumerate(moving):
        fast = speeds[:, j] > np.median(speeds[:, j])
        slow_steps, fast_steps = steps[~fast, j], steps[fast, j]
        pairs = {
            "slow": (slow_steps, slow_steps),
            "fast": (fast_steps, fast_steps),
            "successive": (before[:, j], after[:, j]),
        }
        for group, pair in pairs.items():
            rows.append((joints[j], joints[j], group, *_covariance(*pair)))
        for k in moving[place:]:
            shared = _covariance(steps[:, j], steps[:, k])
            rows.append((joints[j], joints[k], "all", *shared))
    columns = ["joint", "other", "steps", "covariance", "correlation"]
    return pd.DataFrame(rows, columns=columns)


def _covariance(first: np.ndarray, second: np.ndarray) -> tuple[float, float]:
    """Return covariance and correlation of two samples (N,)."""
    covariance = np.cov(first, second)
    scale = np.sqrt(covariance[0, 0] * covariance[1, 1])
    return float(covariance[0, 1]), float(covariance[0, 1] / scale)
