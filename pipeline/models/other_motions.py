"""Scores of the matrix models on held-out motions: every model is fitted to all motions but one and
scored on that one, for each motion in turn.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.arm.chain import Chain
from pipeline.core.errors import ModelDomainError, PipelineError
from pipeline.models import kinds
from pipeline.models.steps import Options, Recorded


class MotionSteps(NamedTuple):
    """Steps of all takes of one motion of n joints, with the rests before and after the motion."""

    name: str
    q: ndarray  # (takes, M, n) rad, measured pose before each step
    dq: ndarray  # (takes, M, n) rad, commanded step
    noise: ndarray  # (takes, M, n) rad, measured minus commanded step


def recorded_motions(
    chain: Chain,
    motions: Sequence[MotionSteps],
    joints: Sequence[str],
    pose_noise: float | None,
    least: int = 2,
) -> Recorded:
    """Join the ``motions`` with at least ``least`` takes into one, with the smallest of their
    numbers of takes. Raises SingularJacobianError at a singular pose, ModelDomainError if no motion
    has ``least`` takes.
    """
    motions = [motion for motion in motions if len(motion.q) >= least]
    if not motions:
        raise ModelDomainError("a matrix model needs two takes of a motion")
    takes = min(len(motion.q) for motion in motions)
    q = np.concatenate([motion.q[:takes] for motion in motions], axis=1)
    dq = np.concatenate([motion.dq[:takes] for motion in motions], axis=1)
    noise = np.concatenate([motion.noise[:takes] for motion in motions], axis=1)
    chain.require_regular(q, what="measured pose")
    command = dq.mean(axis=0)
    v = np.matvec(chain.jacobian(q.mean(axis=0)), command)
    if v.shape != command.shape:
        v = np.concatenate([v, command], axis=-1)
    v[~np.any(np.abs(command) > 0, axis=-1)] = 0.0
    omega = dq + noise - chain.nominal_step(q, v)
    measurement = None
    if pose_noise is not None:
        measurement = 2 * pose_noise**2 * np.eye(len(joints))
    return Recorded(chain, q, v, omega, tuple(joints), measurement)


def matrix_scores(
    motions: Sequence[MotionSteps],
    joints: Sequence[str],
    pose_noise: float | None,
    chain: Chain,
    matrix: Mapping[str, Options],
) -> pd.DataFrame:
    """Score the ``matrix`` models of the arm ``chain`` for one step of each held-out motion: model,
    motion, log score in nats a step, reason for a missing score; no row for a single motion.
    """
    held_out = motions if len(motions) > 1 else ()
    rows = []
    for (name, options), motion in product(matrix.items(), held_out):
        remaining = [rest for rest in motions if rest is not motion]
        try:
            fitted = recorded_motions(chain, remaining, joints, pose_noise)
            model = kinds.estimate(fitted, replace(options, closed_loop=False)).model
            scored = recorded_motions(chain, [motion], joints, pose_noise, least=1)
            steps = chain, scored.q, scored.v, scored.q_next
            log_density = model.log_density(*steps, fitted.measurement)
            score = float(log_density.mean())
            reason = ""
        except PipelineError as error:
            score = np.nan
            reason = error.message
        rows.append((name, motion.name, score, reason))
    table = pd.DataFrame(rows, columns=["model", "motion", "score", "reason"])
    return table.astype({"score": float})  # also without rows
