"""Scores on held-out motions: every model is fitted to all motions but one and scored on the
held-out motion, for each motion in turn. For a single motion, groups of takes are held out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray
from scipy.special import ndtri

from pipeline.arm.interface import Chain
from pipeline.core.errors import ModelDomainError, PipelineError
from pipeline.models import kinds
from pipeline.models.joint_steps import LEAST_SHARE, PLAIN, JointStepFit, fit_joint_steps
from pipeline.models.steps import Options, Recorded

MOST_TAKES = 10  # greatest number of held-out groups of takes of a single motion
QUANTILES = np.concatenate([[0.001, 0.005], np.linspace(0.01, 0.99, 49), [0.995, 0.999]])
SIGMAS = {"one": 1, "two": 2, "three": 3}
UNTOLD = ["parameter", "joint", "found", "required"]  # columns of a parameter without an estimate
EACH = "each"  # motion name in rows of the mean over the held-out motions
concat = partial(pd.concat, ignore_index=True)


class MotionSteps(NamedTuple):
    """Steps of all takes of one motion of n joints, with the rests before and after the motion."""

    name: str
    q: ndarray  # (takes, M, n) rad, measured pose before each step
    dq: ndarray  # (takes, M, n) rad, commanded step
    noise: ndarray  # (takes, M, n) rad, measured minus commanded step


def all_steps(motions: Sequence[MotionSteps]) -> tuple[ndarray, ndarray]:
    """Commanded steps and noise (N, n) in rad of all takes of the ``motions``."""
    n = motions[0].q.shape[-1]
    dq = np.concatenate([motion.dq.reshape(-1, n) for motion in motions])
    return dq, np.concatenate([motion.noise.reshape(-1, n) for motion in motions])


def motion_of(recorded: Recorded) -> MotionSteps:
    """Return the recorded steps as a motion named ``1``."""
    dq = recorded.chain.nominal_step(recorded.q, recorded.v)
    return MotionSteps("1", recorded.q, np.broadcast_to(dq, recorded.q.shape), recorded.noise)


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
    parts = zip(*([each[:takes] for each in motion[1:]] for motion in motions), strict=True)
    q, dq, noise = (np.concatenate(each, axis=1) for each in parts)
    chain.require_regular(q, what="measured pose")
    command = dq.mean(axis=0)
    v = np.matvec(chain.jacobian(q.mean(axis=0)), command)
    v = v if v.shape == command.shape else np.concatenate([v, command], axis=-1)
    v[~np.any(np.abs(command) > 0, axis=-1)] = 0.0
    omega = dq + noise - chain.nominal_step(q, v)
    known = None if pose_noise is None else 2 * pose_noise**2 * np.eye(len(joints))
    return Recorded(chain, q, v, omega, tuple(joints), known)


def other_motions(
    motions: Sequence[MotionSteps],
    joints: Sequence[str],
    rate: float,
    *,
    pose_noise: float | None = None,
    chain: Chain | None = None,
    matrix: Mapping[str, Options] | None = None,
) -> dict[str, pd.DataFrame]:
    """Score the plain models and, if there are at least two motions, the ``matrix`` models of the
    arm ``chain``; return tables by name.

    ``other_motions`` (model, motion, log score in nats a step, reason for a missing score),
    ``motion_spread`` (predicted and measured rms of a step by motion, joint and model), ``tails``
    (kurtosis and coverage of the held-out noise), ``noise_quantiles``, ``plain_parameters``,
    ``untold``, ``motions`` and ``motion_ranges``. Raises ModelDomainError without noise.
    """
    stated, parts = pose_noise or 0.0, motions
    if len(motions) == 1:
        takes = np.arange(len(motions[0].q))
        groups = np.array_split(takes, min(MOST_TAKES, len(takes)))
        parts = [
            MotionSteps(f"take {group[0] + 1}", *(each[group] for each in motions[0][1:]))
            for group in groups
        ]
    whole = all_steps(motions)
    fits = {name: fit_joint_steps(name, *whole, joints, pose_noise=stated) for name in PLAIN}
    scores, spreads, standard = [], [], {}
    for name, part in product(PLAIN, parts):
        others = all_steps([other for other in parts if other is not part] or parts)
        try:
            start, (dq, noise) = fits[name].model, all_steps([part])
            model = fit_joint_steps(name, *others, joints, pose_noise=stated, start=start).model
            scores.append((name, part.name, float(model.noise_log_density(dq, noise).mean()), ""))
        except ModelDomainError as error:
            scores.append((name, part.name, np.nan, error.message))
            continue
        std = np.sqrt(np.diagonal(model.covariance_of_joint_step(dq), axis1=-2, axis2=-1))
        standard.setdefault(name, []).append(noise / std)
        rms = [np.sqrt(np.mean(each**2, axis=0)) for each in (std, noise)]
        spread = {"predicted_rad": rms[0], "measured_rad": rms[1]}
        spreads.append(pd.DataFrame({"motion": part.name, "joint": joints, "model": name} | spread))
    if chain is not None and len(motions) > 1:
        scores += _matrix_scores(motions, joints, pose_noise, chain, matrix or {})
    rows = pd.DataFrame(scores, columns=["model", "motion", "score", "reason"])
    means = rows.groupby("model", sort=False)["score"].agg(lambda each: each.mean(skipna=False))
    together = means.reset_index().assign(motion=EACH, reason="")
    untold = [(name, *row) for name, fit in fits.items() for row in fit.untold]
    return {
        "other_motions": concat([rows, together[rows.columns]]),
        "motion_spread": concat(spreads),
        **_tails({name: np.concatenate(z) for name, z in standard.items()}, joints),
        "plain_parameters": concat([_parameters(name, fit) for name, fit in fits.items()]),
        "untold": pd.DataFrame(untold, columns=["model", *UNTOLD]),
        "motions": _motion_list(motions, joints),
        "motion_ranges": joint_ranges(motions, joints, rate),
    }


def _matrix_scores(motions, joints, pose_noise, chain, matrix) -> list[tuple]:
    rows = []
    for (name, options), part in product(matrix.items(), motions):
        others = [other for other in motions if other is not part]
        try:
            fitted = recorded_motions(chain, others, joints, pose_noise)
            model = kinds.estimate(fitted, replace(options, closed_loop=False)).model
            scored = recorded_motions(chain, [part], joints, pose_noise, least=1)
            steps = chain, scored.q, scored.v, scored.q_next
            score, reason = float(model.log_density(*steps, fitted.measurement).mean()), ""
        except PipelineError as error:
            score, reason = np.nan, error.message
        rows.append((name, part.name, score, reason))
    return rows


def _tails(standard: Mapping[str, ndarray], joints: Sequence[str]) -> dict[str, pd.DataFrame]:
    tails, quantiles = [], []
    for name, z in standard.items():
        square = np.mean(z**2, axis=0)
        kurtosis = np.mean(z**4, axis=0) / np.where(square > 0, square, 1.0) ** 2
        inside = {f"{each}_sigma": np.mean(np.abs(z) <= s, axis=0) for each, s in SIGMAS.items()}
        tails.append(pd.DataFrame({"model": name, "joint": joints, "kurtosis": kurtosis} | inside))
        columns = {"model": name, "joint": np.repeat(joints, len(QUANTILES))}
        columns |= {"normal": np.tile(ndtri(QUANTILES), len(joints))}
        drawn = np.quantile(z, QUANTILES, axis=0).T
        quantiles.append(pd.DataFrame(columns | {"noise": drawn.ravel()}))
    return {"tails": concat(tails), "noise_quantiles": concat(quantiles)}


def _parameters(name: str, fit: JointStepFit) -> pd.DataFrame:
    """Parameters of a plain model by joint; NaN for parameters that the steps do not determine."""
    model = fit.model
    unknown = [joint for what, joint, *_ in fit.untold if what == "degrees of freedom"]
    known = np.isfinite(model.degrees) & ~np.isin(model.joints, unknown)
    columns = {
        "at_rest_rad": np.sqrt(model.resolution**2 + model.floor),
        "share_of_step": np.sqrt(model.gain) if PLAIN[name][0] == 2 else np.nan,
        "per_angle_rad": model.gain if PLAIN[name][0] == 1 else np.nan,
        "degrees": np.where(known, model.degrees, np.nan),
        "greatest_step_rad": model.reach,
    }
    return pd.DataFrame({"model": name, "joint": model.joints} | columns)


def _motion_list(motions: Sequence[MotionSteps], joints: Sequence[str]) -> pd.DataFrame:
    greatest = np.array([np.abs(motion.dq).max(axis=(0, 1)) for motion in motions])
    rows = []
    for motion, moving in zip(motions, greatest >= LEAST_SHARE * greatest.max(), strict=True):
        named = ", ".join(np.array(joints)[moving]) or "none"
        rows.append((motion.name, *motion.q.shape[:2], named))
    return pd.DataFrame(rows, columns=["motion", "takes", "steps", "moving"])


def joint_ranges(
    motions: Sequence[MotionSteps], joints: Sequence[str], rate: float
) -> pd.DataFrame:
    """Ranges of the measured poses and of the commanded joint speeds over all ``motions``."""
    poses = np.concatenate([motion.q.reshape(-1, len(joints)) for motion in motions])
    ranges = ("pose", "rad", poses), ("joint speed", "rad/s", rate * all_steps(motions)[0])
    return concat(
        pd.DataFrame({"quantity": quantity, "name": joints, "unit": unit}).assign(
            least=values.min(axis=0), greatest=values.max(axis=0)
        )
        for quantity, unit, values in ranges
    )
