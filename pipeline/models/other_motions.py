"""Held-out scores over other motions: every model is fitted to all motions but one and scored on
that one, each in turn. With a single motion the takes take the motions' place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pandas as pd

from pipeline.arm.interface import Chain
from pipeline.core.errors import ModelDomainError, PipelineError
from pipeline.models import kinds
from pipeline.models.joint_steps_fit import LEAST_SHARE, PLAIN, JointStepFit, fit_joint_steps
from pipeline.models.options import Options
from pipeline.models.steps import Recorded

MOST_TAKES = 10  # held out one by one where there is a single motion
QUANTILES = np.concatenate([[0.001, 0.005], np.linspace(0.01, 0.99, 49), [0.995, 0.999]])
SIGMAS = {"one": 1, "two": 2, "three": 3}
UNTOLD = ["parameter", "joint", "found", "required"]  # of a parameter without a number
EACH = "each"  # row of the mean over the held-out motions


@dataclass(frozen=True)
class MotionSteps:
    """Steps of the repetitions of one motion of n joints, with the rests around it."""

    name: str
    q: np.ndarray  # (takes, M, n) rad, measured pose before each step
    dq: np.ndarray  # (takes, M, n) rad, commanded step
    noise: np.ndarray  # (takes, M, n) rad, measured minus commanded step

    @property
    def flat(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, n) commanded steps and noise in rad of all takes together."""
        n = self.dq.shape[-1]
        return self.dq.reshape(-1, n), self.noise.reshape(-1, n)


@dataclass(frozen=True)
class OtherMotions:
    """Tables by name, and the plain models fitted to all motions."""

    tables: Mapping[str, pd.DataFrame]
    fits: Mapping[str, JointStepFit]


def pooled(chosen: Sequence[MotionSteps]) -> tuple[np.ndarray, np.ndarray]:
    """(N, n) commanded steps and noise in rad of the ``chosen`` motions together."""
    return tuple(np.concatenate(each) for each in zip(*(one.flat for one in chosen), strict=True))


def motion_of(recorded: Recorded) -> MotionSteps:
    """The one motion that the stages analyse."""
    dq = recorded.chain.nominal_step(recorded.q, recorded.v)
    return MotionSteps("1", recorded.q, np.broadcast_to(dq, recorded.q.shape), recorded.noise)


def recorded_motions(
    chain: Chain, chosen: Sequence[MotionSteps], joints: Sequence[str], pose_noise: float | None
) -> Recorded:
    """The ``chosen`` motions one behind the other, as many takes of each as the least repeated has,
    as an estimator of a matrix model takes them.

    Raises SingularJacobianError at a singular pose, ModelDomainError for a single take.
    """
    takes = min(len(motion.q) for motion in chosen)
    if takes < 2:
        raise ModelDomainError("a matrix model needs two takes of every motion", takes=takes)
    q, dq, noise = (
        np.concatenate([getattr(motion, name)[:takes] for motion in chosen], axis=1)
        for name in ("q", "dq", "noise")
    )
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
) -> OtherMotions:
    """Score the plain models, and the ``matrix`` models of the arm ``chain`` where there are two
    motions or more.

    Tables: ``other_motions`` (model, motion, log score in nats a step, reason where there is none),
    ``motion_spread`` (predicted and measured rms of a step by motion, joint and model), ``tails``
    (kurtosis and coverage of the held-out noise), ``noise_quantiles``, ``plain_parameters``,
    ``untold`` and ``motions``. Raises ModelDomainError without noise.
    """
    stated, parts = pose_noise or 0.0, _parts(motions)
    fits = {
        name: fit_joint_steps(name, *pooled(motions), joints, pose_noise=stated) for name in PLAIN
    }
    scores, spreads, standard = [], [], {}
    for name, part in product(PLAIN, parts):
        rest = pooled([other for other in parts if other is not part] or parts)
        try:
            start = fits[name].model
            model = fit_joint_steps(name, *rest, joints, pose_noise=stated, start=start).model
            dq, noise = part.flat
            score = float(model.noise_log_density(dq, noise).mean())
        except ModelDomainError as error:
            scores.append((name, part.name, np.nan, error.message))
            continue
        scores.append((name, part.name, score, ""))
        std = np.sqrt(np.diagonal(model.covariance_of_joint_step(dq), axis1=-2, axis2=-1))
        standard.setdefault(name, []).append(noise / std)
        rms = np.sqrt(np.mean(std**2, axis=0)), np.sqrt(np.mean(noise**2, axis=0))
        spreads += [(part.name, *row[:1], name, *row[1:]) for row in zip(joints, *rms, strict=True)]
    if chain is not None and len(motions) > 1:
        scores += _matrix_scores(motions, joints, pose_noise, chain, matrix or {})
    rows = pd.DataFrame(scores, columns=["model", "motion", "score", "reason"])
    means = rows.groupby("model", sort=False)["score"].agg(lambda each: each.mean(skipna=False))
    together = means.reset_index().assign(motion=EACH, reason="")
    untold = [(name, *row) for name, fit in fits.items() for row in fit.untold]
    tables = {
        "other_motions": pd.concat([rows, together[rows.columns]], ignore_index=True),
        "motion_spread": pd.DataFrame(
            spreads, columns=["motion", "joint", "model", "predicted_rad", "measured_rad"]
        ),
        **_tails({name: np.concatenate(z) for name, z in standard.items()}, joints),
        "plain_parameters": _parameters(fits),
        "untold": pd.DataFrame(
            untold, columns=["model", "parameter", "joint", "found", "required"]
        ),
        "motions": _listed(motions, joints),
        "motion_ranges": joint_ranges(motions, joints, rate),
    }
    return OtherMotions(tables, fits)


def _parts(motions: Sequence[MotionSteps]) -> list[MotionSteps]:
    """The motions that are held out one by one, or the takes of a single one."""
    if len(motions) > 1:
        return [*motions]
    only = motions[0]
    groups = np.array_split(np.arange(len(only.q)), min(MOST_TAKES, len(only.q)))
    return [
        MotionSteps(f"take {group[0] + 1}", only.q[group], only.dq[group], only.noise[group])
        for group in groups
    ]


def _matrix_scores(motions, joints, pose_noise, chain, matrix) -> list[tuple]:
    rows = []
    for (name, options), part in product(matrix.items(), motions):
        rest = [other for other in motions if other is not part]
        try:
            fitted = recorded_motions(chain, rest, joints, pose_noise)
            model = kinds.estimate(fitted, replace(options, closed_loop=False)).model
            scored = recorded_motions(chain, [part], joints, pose_noise)
            steps = chain, scored.q, scored.v, scored.q_next
            score, reason = float(model.log_density(*steps, fitted.measurement).mean()), ""
        except PipelineError as error:
            score, reason = np.nan, error.message
        rows.append((name, part.name, score, reason))
    return rows


def _tails(standard: Mapping[str, np.ndarray], joints: Sequence[str]) -> dict[str, pd.DataFrame]:
    from scipy.special import ndtri

    tails, quantiles = [], []
    for name, z in standard.items():
        square = np.mean(z**2, axis=0)
        kurtosis = np.mean(z**4, axis=0) / np.where(square > 0, square, 1.0) ** 2
        for j, joint in enumerate(joints):
            inside = [float(np.mean(np.abs(z[:, j]) <= sigma)) for sigma in SIGMAS.values()]
            tails.append((name, joint, float(kurtosis[j]), *inside))
            drawn = zip(ndtri(QUANTILES), np.quantile(z[:, j], QUANTILES), strict=True)
            quantiles += [(name, joint, *map(float, pair)) for pair in drawn]
    columns = ["model", "joint", "kurtosis", *(f"{each}_sigma" for each in SIGMAS)]
    return {
        "tails": pd.DataFrame(tails, columns=columns),
        "noise_quantiles": pd.DataFrame(quantiles, columns=["model", "joint", "normal", "noise"]),
    }


def _parameters(fits: Mapping[str, JointStepFit]) -> pd.DataFrame:
    """Parameters of the plain models; gaps where the steps cannot tell them."""
    rows = []
    for name, fit in fits.items():
        own, (scaled, student) = fit.model, PLAIN[name]
        unknown = {joint for what, joint, *_ in fit.untold if what == "degrees of freedom"}
        for j, joint in enumerate(own.joints):
            known = student and joint not in unknown and np.isfinite(own.degrees[j])
            rest = float(np.sqrt(own.resolution[j] ** 2 + own.floor[j]))
            share = float(np.sqrt(own.gain[j])) if scaled else np.nan
            nu = own.degrees[j] if known else np.nan
            rows.append((name, joint, rest, share, nu, float(own.reach[j])))
    columns = ["model", "joint", "at_rest_rad", "share_of_step", "degrees", "greatest_step_rad"]
    return pd.DataFrame(rows, columns=columns)


def _listed(motions: Sequence[MotionSteps], joints: Sequence[str]) -> pd.DataFrame:
    most = max(np.abs(motion.dq).max() for motion in motions)
    rows = []
    for motion in motions:
        moving = np.abs(motion.dq).max(axis=(0, 1)) >= LEAST_SHARE * most
        named = ", ".join(joint for joint, moves in zip(joints, moving, strict=True) if moves)
        rows.append((motion.name, len(motion.q), motion.q.shape[1], named or "none"))
    return pd.DataFrame(rows, columns=["motion", "takes", "steps", "moving"])


def joint_ranges(
    motions: Sequence[MotionSteps], joints: Sequence[str], rate: float
) -> pd.DataFrame:
    """Ends of the measured poses and of the commanded joint speeds over all ``motions``."""
    n = len(joints)
    poses = np.concatenate([motion.q.reshape(-1, n) for motion in motions])
    speeds = rate * pooled(motions)[0]
    rows = [
        (quantity, joint, unit, float(each.min()), float(each.max()))
        for quantity, unit, values in (("pose", "rad", poses), ("joint speed", "rad/s", speeds))
        for joint, each in zip(joints, values.T, strict=True)
    ]
    return pd.DataFrame(rows, columns=["quantity", "name", "unit", "least", "greatest"])
