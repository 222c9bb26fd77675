"""The evidence of a case under the names that the stages give it in a run, so that the claims can
be decided by the same rules.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from pipeline.cases.case import Case
from pipeline.cases.fits import Outcome
from pipeline.cases.recordings import Camera, Takes
from pipeline.core.columns import matrices, members, values
from pipeline.core.errors import ModelDomainError
from pipeline.core.filters import MEMORY, NONE, models_of
from pipeline.core.rng import stream
from pipeline.filtering.memory import memory_filter
from pipeline.filtering.particle_filter import Posterior
from pipeline.models.noise import recorded_deviation, rest_covariance
from pipeline.recordings.commands import constant_speed
from pipeline.statistics.curves import spread_tables, std_scores
from pipeline.statistics.filters import (
    Filtered,
    filter_metrics,
    filter_tables,
    no_filter,
    sensor_scores,
)
from pipeline.statistics.scores import compared

Evidence = dict[str, dict[str, float] | pd.DataFrame]
RESAMPLING_SEED = 20_170  # the same resamplings in every case


def case_evidence(
    case: Case,
    takes: Takes,
    outcomes: Mapping[str, Outcome],
    camera: Camera | None,
    posteriors: Mapping[str, Mapping[str, Posterior | str]],
    dt: float,
) -> tuple[Evidence, list[str]]:
    """All evidence of ``case``, and what its models and filters refused.

    Args:
        case: whose evidence it is.
        takes: the recordings.
        outcomes: of the models, by name.
        camera: without one there is no evidence on sensor and filter.
        posteriors: by filter, as :mod:`pipeline.core.filters` names them, and take, or why there
            is none: a filter that was lost on one take is no evidence.
        dt: step of the motion in s.
    """
    evidence = motion_evidence(outcomes, takes, case.mode)
    refusals = {
        f"{model}: {refusal}" for model, outcome in outcomes.items() for refusal in outcome.refusals
    }
    if camera is not None:
        evidence |= sensor_evidence(camera.noise)
        lost = {
            (model, posterior)
            for model, by_take in posteriors.items()
            for posterior in by_take.values()
            if isinstance(posterior, str)
        }
        refusals |= {f"{model}: {refusal}" for model, refusal in lost}
        whole = {m: by_take for m, by_take in posteriors.items() if m not in dict(lost) and by_take}
        if whole:
            tested = list(next(iter(whole.values())))
            truth = np.stack([takes.test[take] for take in tested])
            filters = {name: list(by_take.values()) for name, by_take in whole.items()}
            poses = case.measurement * pose_covariances(takes)
            linear = None
            if case.closed:
                frames, chain = [camera.takes[take] for take in tested], takes.training.chain
                means, covariances, _ = memory_filter(takes.poses, poses[0], frames, dt, chain)
                linear = Filtered(means - truth, covariances, poses[0])
            evidence |= filter_evidence(filters, linear, truth, takes, poses)
    return evidence, sorted(refusals)


def pose_covariances(takes: Takes) -> np.ndarray:
    """(2, n, n) rad², noise of a measured pose: half the covariance of steps at rest, for ω holds
    the noise of two poses, and to a closed loop that of poses at rest; zero where the motion never
    rests.
    """
    try:
        held = rest_covariance(takes.poses, takes.training.v)
        return np.stack([takes.training.measurement / 2, held])
    except ModelDomainError:
        return np.zeros((2, *(takes.poses.shape[-1],) * 2))


def motion_evidence(outcomes: Mapping[str, Outcome], takes: Takes, mode: str) -> Evidence:
    """What fits, realisations and predictions say; ``outcomes`` by model."""
    evidence: Evidence = {
        f"metrics/fit_{model}": dict(outcome.estimates) for model, outcome in outcomes.items()
    }
    realized = {model: outcome for model, outcome in outcomes.items() if outcome.mean is not None}
    # at k = 0 nothing has moved yet
    std = {"recorded": recorded_deviation(takes.poses, takes.training.noise, mode)[1:]}
    std |= {model: outcome.deviation[1:] for model, outcome in realized.items()}
    middle = takes.poses.mean(axis=0)
    error = {
        model: np.linalg.norm(outcome.mean - middle, axis=1)[1:]
        for model, outcome in realized.items()
    }
    modelled = {name: each.modelled for name, each in outcomes.items() if each.modelled}
    if mode == "one_step":
        std = {"recorded": std["recorded"]} | {name: each.std for name, each in modelled.items()}
        following = {name: outcomes[name].following for name in modelled}
        training = takes.training
        spreads = spread_tables(modelled, following, training.noise, training.joints)
        evidence |= {f"tables/{name}": table for name, table in spreads.items()}
    steady = constant_speed(takes.poses)
    limits = zip(takes.training.joints, takes.variation_of_constant_noise, strict=True)
    evidence["metrics/motion"] = std_scores(std, error, takes.training.joints, steady) | {
        f"recorded_std_{joint}_variation_of_constant_noise": limit for joint, limit in limits
    }
    tables = {}
    for steps in ("all", "moving"):
        scored = {
            model: {"log_score": outcome.log_score[steps]}
            for model, outcome in outcomes.items()
            if steps in outcome.log_score
        }
        if scored:
            tables[steps] = compared(scored, next(iter(scored)))
    if tables:
        evidence["tables/one_step_scores"] = pd.concat(tables, names=["steps"]).reset_index("steps")
    return evidence


def sensor_evidence(noise: pd.DataFrame) -> Evidence:
    """What the depth camera's ``noise`` says, the table ``kinect_noise``."""
    everywhere, joints = noise[noise["take"] == "none"], members(noise, "b")
    variance = np.diagonal(matrices(everywhere, "r", joints), axis1=1, axis2=2)
    takes = noise["take"].nunique() - 1
    scores = sensor_scores(values(everywhere, "b"), variance, takes, joints)
    return {"metrics/recordings": scores}


def filter_evidence(
    posteriors: Mapping[str, list[Posterior]],
    linear: Filtered | None,
    truth: np.ndarray,
    takes: Takes,
    poses: np.ndarray,
) -> Evidence:
    """Evidence of the models' filters and the linear one against the measured poses, beside the
    training takes' mean and covariance.

    Args:
        posteriors: by filter, as :mod:`pipeline.core.filters` names them, one a take.
        linear: filter of the takes' own covariance and autocorrelation, if any.
        truth: (takes, M+1, n) rad, measured poses.
        takes: the training takes.
        poses: (2, n, n) rad² as by :func:`pose_covariances`, which bounds and scores hold too.
    """
    opened, (pose, held), joints = models_of(posteriors), poses, takes.training.joints
    filters = {NONE: no_filter(takes.poses, truth)} | ({MEMORY: linear} if linear else {})
    for name, by_take in posteriors.items():
        filters[name] = Filtered(
            np.stack([posterior.mean for posterior in by_take]) - truth,
            np.stack([posterior.covariance for posterior in by_take]),
            pose if name in opened else held,
        )
    if not opened:
        return {}
    rng = stream(RESAMPLING_SEED, "cases.resampling")
    tables, _ = filter_tables(filters, joints, constant_speed(truth), rng)
    scores = tables.pop("filter_scores")
    named = {f"tables/{name}": table for name, table in tables.items()}
    return {"metrics/filter": filter_metrics(scores)} | named
