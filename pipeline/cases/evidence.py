"""A model in one case: parameters, realisations, predictions of unseen takes; and the evidence of a
case under the names that the stages give it in a run, so that the same rules decide the claims.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from pipeline.cases.case import Camera, Choices, Takes
from pipeline.core.columns import matrices, members, values
from pipeline.core.errors import ModelDomainError, SingularJacobianError, SolverError
from pipeline.core.filters import MEMORY, NONE, models_of
from pipeline.core.rng import stream
from pipeline.filtering.linear import autocorrelated_filter
from pipeline.filtering.particle_filter import Posterior
from pipeline.models import kinds
from pipeline.models.closed_loop import ClosedLoopFit, closed_loop_of
from pipeline.models.draws import realize, realized_moments
from pipeline.models.kinds import estimate
from pipeline.models.model import MotionModel
from pipeline.models.noise import recorded_deviation, rest_covariance
from pipeline.models.prediction import modelled_noise
from pipeline.models.steps import Estimate, Recorded
from pipeline.recordings.commands import constant_speed
from pipeline.statistics import scores as scoring
from pipeline.statistics.curves import ModelledNoise, following_tests, spread_tables, std_scores
from pipeline.statistics.scores import Filtered, score_comparison

Evidence = dict[str, dict[str, float] | pd.DataFrame]
RESAMPLING_SEED = 20_170  # the same resamplings in every case
PAPER = "{}_paper"  # names of the estimates by the paper's estimator


@dataclass
class Outcome:
    """Fit, realisations and scores of a model; ``refusals`` say why some are missing."""

    model: MotionModel | None = None
    closed: ClosedLoopFit | None = None  # the model in a closed loop
    estimates: dict[str, float] = field(default_factory=dict)
    mean: np.ndarray | None = None  # (M+1, n) rad, of the realisations
    deviation: np.ndarray | None = None  # (M+1, n) rad
    # of all steps and of the moving ones, (takes,) nats
    log_score: dict[str, np.ndarray] = field(default_factory=dict)
    modelled: ModelledNoise | None = None  # at the recorded level, without its draws
    following: pd.DataFrame | None = None  # as of following_tests
    refusals: list[str] = field(default_factory=list)


def outcome(case: Choices, takes: Takes, realizations: int, rng: np.random.Generator) -> Outcome:
    """Fit, realise ``realizations`` times and score a model; a refusal is an outcome too."""
    fared, training = Outcome(), takes.training
    chain, v = training.chain, training.v
    try:
        fit = estimate(training, case.options)
        fared.model = fit.model
        fared.estimates = fit.estimates | _papers_estimates(case, training, fit)
        if case.closed:
            fared.closed, refused = closed_loop_of(training, case.options, fit)
            fared.refusals += [f"no closed loop: {refused}"] if refused else []
        fared.log_score = _log_scores(case, fit, takes)
        starts = np.resize(takes.poses, (realizations, *takes.poses.shape[1:]))
        realized, _, _ = realize(fared.model, chain, starts, v, case.mode, rng)
        fared.mean, fared.deviation, refused = realized_moments(
            fared.model, chain, starts, v, case.mode, realized
        )
        fared.refusals += [refused] if refused else []
        if case.mode == "one_step":
            noise, steady = modelled_noise(fared.model, training, rng), constant_speed(takes.poses)
            compare = (noise, training.noise, steady, training.joints, rng)
            fared.following = following_tests(*compare)
            fared.modelled = replace(noise, draws=noise.draws[:0])
    except (ModelDomainError, SingularJacobianError, SolverError) as error:
        fared.refusals.append(str(error))
    return fared


def _papers_estimates(case: Choices, recorded: Recorded, fit: Estimate) -> dict[str, float]:
    """Estimates by the paper's estimator, which its published parameters are compared with."""
    if (requested := kinds.compared(case.options).get(PAPER)) is None:
        return {}
    try:
        own = fit if requested == case.options else estimate(recorded, requested)
    except (ModelDomainError, SolverError):
        return {}
    estimates = {PAPER.format(name): value for name, value in own.estimates.items()}
    unbounded = own.diagnostics.get("u_unbounded")  # whether û is an estimate at all
    return estimates if unbounded is None else estimates | {"u_paper_unbounded": unbounded}


def _log_scores(case: Choices, fit: Estimate, takes: Takes) -> dict[str, np.ndarray]:
    """Mean log density over a held-out take's steps; without test takes, of each training take."""
    training, folds = takes.training, []
    if takes.test:
        folds.append((fit.model, training, np.stack(list(takes.test.values()))))
    else:
        for i in range(len(takes.poses)):
            others = training.subset(np.delete(np.arange(len(takes.poses)), i))
            folds.append((estimate(others, case.options).model, others, takes.poses[[i]]))
    density = np.concatenate([_log_density(*fold, case.measurement) for fold in folds])
    moving = np.any(training.v, axis=1)
    scores = {"moving": density[:, moving].mean(axis=1)}
    return scores if case.measurement == 0 else scores | {"all": density.mean(axis=1)}


def _log_density(
    model: MotionModel, training: Recorded, poses: np.ndarray, factor: float
) -> np.ndarray:
    """(takes, M) nats of the steps between ``poses`` (takes, M+1, n); NaN at rest without noise."""
    q, q_next = poses[:, :-1], poses[:, 1:]
    v = np.broadcast_to(training.v, (*q.shape[:-1], training.v.shape[-1]))
    if factor:
        return model.log_density(training.chain, q, v, q_next, factor * training.measurement)
    moving = np.any(v, axis=-1)
    density = np.full(moving.shape, np.nan)
    density[moving] = model.log_density(training.chain, q[moving], v[moving], q_next[moving])
    return density


def case_evidence(
    case: Choices,
    takes: Takes,
    outcomes: Mapping[str, Outcome],
    camera: Camera | None,
    posteriors: Mapping[str, Mapping[str, Posterior | str]],
    dt: float,
) -> tuple[Evidence, list[str]]:
    """Return all evidence of ``case``, and the refusals of its models and filters.
    ``outcomes`` by model. Without ``camera`` there is no evidence on sensor
    and filter. ``posteriors`` by filter, as :mod:`pipeline.core.filters` names them, and take, or
    why there is none: a filter that was lost on one take is no evidence. ``dt`` in s.
    """
    evidence = motion_evidence(outcomes, takes, case.mode)
    refusals = {f"{model}: {why}" for model, fared in outcomes.items() for why in fared.refusals}
    if camera is None:
        return evidence, sorted(refusals)
    noise = camera.noise[camera.noise["take"] == "none"]
    joints, count = members(noise, "b"), camera.noise["take"].nunique() - 1
    variance = np.diagonal(matrices(noise, "r", joints), axis1=1, axis2=2)
    scores = scoring.sensor_scores(values(noise, "b"), variance, count, joints)
    evidence["metrics/recordings"] = scores
    whole, tested = {}, []
    for model, by_take in posteriors.items():
        lost = {f"{model}: {own}" for own in by_take.values() if isinstance(own, str)}
        refusals |= lost
        if by_take and not lost:
            whole[model], tested = list(by_take.values()), list(by_take)
    if whole:
        truth = np.stack([takes.test[take] for take in tested])
        poses, linear = case.measurement * pose_covariances(takes), None
        if case.closed:
            frames, chain = [camera.takes[take] for take in tested], takes.training.chain
            known = (takes.poses, poses[0], frames, dt, chain)
            means, covariances, _ = autocorrelated_filter(*known)
            linear = Filtered(means - truth, covariances, poses[0])
        evidence |= filter_evidence(whole, linear, truth, takes, poses)
    return evidence, sorted(refusals)


def pose_covariances(takes: Takes) -> np.ndarray:
    """(2, n, n) rad², noise of a measured pose: half the covariance of steps at rest, for ω holds
    the noise of two poses, and for a closed loop the covariance of poses at rest; zero where the
    motion never rests.
    """
    try:
        held = rest_covariance(takes.poses, takes.training.v)
        return np.stack([takes.training.measurement / 2, held])
    except ModelDomainError:
        return np.zeros((2, *(takes.poses.shape[-1],) * 2))


def motion_evidence(outcomes: Mapping[str, Outcome], takes: Takes, mode: str) -> Evidence:
    """Evidence of fits, realisations and predictions; ``outcomes`` by model."""
    training, tables = takes.training, {}
    evidence: Evidence = {f"metrics/fit_{name}": dict(o.estimates) for name, o in outcomes.items()}
    realized = {name: each for name, each in outcomes.items() if each.mean is not None}
    modelled = {name: each.modelled for name, each in outcomes.items() if each.modelled}
    std = {"recorded": recorded_deviation(takes.poses, training.noise, mode)[1:]}
    if mode == "one_step":
        std |= {name: each.std for name, each in modelled.items()}
        following = {name: outcomes[name].following for name in modelled}
        spreads = spread_tables(modelled, following, training.noise, training.joints)
        evidence |= {f"tables/{name}": table for name, table in spreads.items()}
    else:  # at k = 0 nothing has moved yet
        std |= {name: each.deviation[1:] for name, each in realized.items()}
    middle = takes.poses.mean(axis=0)
    error = {x: np.linalg.norm(each.mean - middle, axis=1)[1:] for x, each in realized.items()}
    scores = std_scores(std, error, training.joints)
    limits = zip(training.joints, takes.variation_of_constant_noise, strict=True)
    limits = {f"recorded_std_{x}_variation_of_constant_noise": limit for x, limit in limits}
    evidence["metrics/motion"] = scores | limits
    for steps in ("all", "moving"):
        scored = {
            name: {"log_score": each.log_score[steps]}
            for name, each in outcomes.items()
            if steps in each.log_score
        }
        if scored:
            tables[steps] = score_comparison(scored, next(iter(scored)))
    if tables:
        evidence["tables/one_step_scores"] = pd.concat(tables, names=["steps"]).reset_index("steps")
    return evidence


def filter_evidence(
    posteriors: Mapping[str, list[Posterior]],
    linear: Filtered | None,
    truth: np.ndarray,
    takes: Takes,
    poses: np.ndarray,
) -> Evidence:
    """Evidence of the models' filters and the linear one against the measured poses, beside the
    training takes' mean and covariance.
    ``posteriors`` by filter, one a take; ``linear`` the autocorrelated filter, if any; ``truth``
    (takes, M+1, n) rad the measured poses; ``poses`` (2, n, n) rad² of :func:`pose_covariances`,
    which bounds and scores hold too.
    """
    opened, (pose, held), joints = models_of(posteriors), poses, takes.training.joints
    if not opened:
        return {}
    filters = {NONE: scoring.training_mean(takes.poses, truth)}
    filters |= {MEMORY: linear} if linear else {}
    for name, by_take in posteriors.items():
        error = np.stack([posterior.mean for posterior in by_take]) - truth
        covariance = np.stack([posterior.covariance for posterior in by_take])
        filters[name] = Filtered(error, covariance, pose if name in opened else held)
    rng = stream(RESAMPLING_SEED, "cases.resampling")
    tables, _ = scoring.filter_tables(filters, joints, rng)
    scores = scoring.filter_metrics(filters, joints, constant_speed(truth))
    return {"metrics/filter": scores} | {f"tables/{name}": table for name, table in tables.items()}
