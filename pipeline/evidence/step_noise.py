"""Noise of a step of fixed duration in a controller's logs, joint by joint, without a Jacobian."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.evidence.table import (
    RECORDED,
    difference_row,
    evidence_row,
    evidence_table,
)
from pipeline.models.joint_error.samples import JointRun
from pipeline.statistics.curves import VARYING
from pipeline.statistics.single_run import least_variation, speed_effect

STEP = 0.01  # s, the paper's step
MARGIN = np.log(1.0 + VARYING)  # ln of the least relevant ratio of standard deviations


class StepChanges(NamedTuple):
    """Changes within STEP of the tracking errors, and of the commands without their sign, (M, n) in
    rad, of each run; ``moving`` are the places of the joints whose command does not rest.
    """

    noise: list[ndarray]
    pace: list[ndarray]
    moving: ndarray


def step_changes(runs: Sequence[JointRun]) -> StepChanges:
    """Return the changes of the tracking errors, which are measured minus commanded angles without
    the lag of each joint.
    """
    noise = []
    pace = []
    for run in runs:
        stride = max(round(STEP * run.rate), 1)
        command = run.command[::stride]
        error = run.measured[::stride] - command
        steps = np.diff(command, axis=0)
        noise.append(np.diff(error, axis=0))
        pace.append(np.abs(steps))
    moves = np.concatenate(pace).any(axis=0)
    return StepChanges(noise, pace, np.flatnonzero(moves))


def step_noise(runs: Sequence[JointRun]) -> pd.DataFrame:
    """Return the table ``step_noise``: covariances, in rad², of the changes of the tracking errors
    within STEP, over all steps and over the slow and the fast half by the joint's commanded speed,
    and of successive changes. Joints whose command rests are left out.
    """
    noise, pace, moving = step_changes(runs)
    steps = np.concatenate(noise)
    speeds = np.concatenate(pace)
    before = np.concatenate([changes[:-1] for changes in noise])
    after = np.concatenate([changes[1:] for changes in noise])
    joints = runs[0].joints
    rows = []

    def add(j: int, k: int, group: str, first: ndarray, second: ndarray) -> None:
        rows.append((joints[j], joints[k], group, *_covariance(first, second)))

    for place, j in enumerate(moving):
        of_joint = steps[:, j]
        fast = speeds[:, j] > np.median(speeds[:, j])
        slow_steps = of_joint[~fast]
        fast_steps = of_joint[fast]
        add(j, j, "slow", slow_steps, slow_steps)
        add(j, j, "fast", fast_steps, fast_steps)
        add(j, j, "successive", before[:, j], after[:, j])
        for k in moving[place:]:
            add(j, k, "all", of_joint, steps[:, k])
    columns = ["joint", "other", "steps", "covariance", "correlation"]
    return pd.DataFrame(rows, columns=columns)


def noise_by_speed(runs: Sequence[JointRun]) -> pd.DataFrame:
    """Return the table ``noise_by_speed``: the effect of each joint's commanded speed on the noise
    of a step within the ``runs`` one after another (:mod:`pipeline.statistics.single_run`).
    """
    noise, pace, moving = step_changes(runs)
    steps = np.concatenate(noise)
    speeds = np.concatenate(pace)
    rows = []
    for j in moving:
        effect = speed_effect(steps[:, j], speeds[:, j], MARGIN)
        row = {"joint": runs[0].joints[j], "steps": len(steps), "blocks": effect.blocks}
        row |= effect.difference._asdict()
        row |= {"power": effect.power, "variation": effect.variation}
        row["least_variation"] = least_variation(len(moving))
        rows.append(row)
    return pd.DataFrame(rows)


def run_evidence(by_speed: pd.DataFrame) -> pd.DataFrame:
    """Return the evidence within a run from the table ``noise_by_speed``. There is no upper limit
    of the variation over the run: what happened once may be a disturbance, not the motion.
    """
    share = "share_of_variance_between_recordings"
    rows = [evidence_row(share, 0.0, model=RECORDED)]
    for row in by_speed.itertuples():
        keys = {"model": RECORDED, "joint": row.joint}
        limits = VARYING, row.least_variation
        rows.append(evidence_row("std_variation", row.variation, **keys))
        rows.append(evidence_row("std_variation_limits", *limits, **keys))
        rows.append(difference_row("ln_std_by_speed", row, **keys))
        rows.append(evidence_row("ln_std_by_speed_power", row.power, **keys))
    return evidence_table(rows)


def _covariance(first: np.ndarray, second: np.ndarray) -> tuple[float, float]:
    """Return covariance and correlation of two samples (N,)."""
    covariance = np.cov(first, second)
    scale = np.sqrt(covariance[0, 0] * covariance[1, 1])
    return float(covariance[0, 1]), float(covariance[0, 1] / scale)
