"""Evaluation of cases: fits, realisations, scores and filters. The evidence has the names of the
stages' output, so that the same rules decide the claims. Common parts of cases are evaluated once.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pandas as pd

from pipeline.cases.case import KINDS, Choices, Recordings, Takes
from pipeline.core import filters as names
from pipeline.core import rng
from pipeline.core.columns import matrices, members, values
from pipeline.core.errors import (
    DegenerateFilterError,
    ModelDomainError,
    SingularJacobianError,
    SolverError,
)
from pipeline.filtering.linear import autocorrelated_filter
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Posterior, particle_filter
from pipeline.models import kinds
from pipeline.models.closed_loop import ClosedLoopFit, closed_loop_of, mean_path
from pipeline.models.draws import realize, realized_moments
from pipeline.models.model import Commands, MotionModel, open_loop
from pipeline.models.prediction import modelled_noise
from pipeline.models.steps import Estimate, Recorded, recorded_deviation, rest_covariance
from pipeline.recordings.commands import constant_speed
from pipeline.statistics import scores as scoring
from pipeline.statistics.curves import ModelledNoise, following_tests, spread_tables, std_scores
from pipeline.statistics.scores import Filtered, score_comparison

Evidence = dict[str, dict[str, float] | pd.DataFrame]
Loop = tuple[MotionModel, Commands]  # a fitted model and its commands
# number of the take, its part of the case, the loop, the take's measurements
Trial = tuple[int, Choices, Loop, Measurements]
Run = Callable[[Callable, Sequence], Iterable]  # like the built-in map, with results in order
RESAMPLING_SEED = 20_170  # equal resamplings in all cases
PAPER = "{}_paper"  # names of the estimates of the paper's estimator


@dataclass
class Outcome:
    """Fit, realisations and scores of a model; ``refusals`` are the reasons for missing ones."""

    model: MotionModel | None = None
    closed: ClosedLoopFit | None = None  # the model in a closed loop
    estimates: dict[str, float] = field(default_factory=dict)
    mean: np.ndarray | None = None  # (M+1, n) rad, of the realisations
    deviation: np.ndarray | None = None  # (M+1, n) rad
    # (takes,) nats, of all steps and of the moving steps
    log_score: dict[str, np.ndarray] = field(default_factory=dict)
    modelled: ModelledNoise | None = None  # at the recorded total variance, without its draws
    following: pd.DataFrame | None = None  # of following_tests
    refusals: list[str] = field(default_factory=list)


def evaluate(
    cases: Sequence[Choices], recordings: Recordings, run: Run
) -> list[tuple[Evidence, list[str]]]:
    """Return the evidence and refusals of every case; only the paper's models are filtered."""
    cameras, count = recordings.cameras, recordings.filtered
    takes = list(next(iter(cameras.values())).takes) if cameras else []

    def map_trials(function: Callable, trials: Mapping[str, object]) -> dict:
        results = run(partial(function, recordings=recordings), list(trials.values()))
        return dict(zip(trials, results, strict=True))

    # options are not hashable; equal options have equal representations
    models = {repr(part): part for case in cases for part in map(case.model_case, case.models)}
    outcomes = map_trials(_outcome, models)
    loops = {key: _loops(result, recordings) for key, result in outcomes.items()}
    trials: dict[str, Trial] = {}
    wanted: list[tuple[int, str, str, str]] = []  # number of the case, filter, take, key of a trial
    for number, case in enumerate(cases):
        batch = takes[case.batch * count : (case.batch + 1) * count]
        for name in filter(KINDS.__contains__, case.models):
            for closed, loop in loops[repr(case.model_case(name))].items():
                part = case.filter_case(name, closed)
                for take in batch if len(batch) == count else []:
                    measured = cameras[case.clock].takes[take]
                    trials[key := f"{take} {part!r}"] = (takes.index(take), part, loop, measured)
                    wanted.append((number, names.closed(name) if closed else name, take, key))
    posteriors = map_trials(_posterior, trials)
    filtered = [{} for _ in cases]
    for number, name, take, key in wanted:
        filtered[number].setdefault(name, {})[take] = posteriors[key]
    results = []
    for case, by_filter in zip(cases, filtered, strict=True):
        of_case = {name: outcomes[repr(case.model_case(name))] for name in case.models}
        results.append(case_evidence(case, recordings, of_case, by_filter))
    return results


def _outcome(case: Choices, recordings: Recordings) -> Outcome:
    # equal draws in all cases, so that only the choices differ
    seed, name = recordings.stream
    stream = rng.stream(seed, f"{name}.{case.options.kind}", case.draw)
    return outcome(case, recordings.takes, recordings.realizations, stream)


def _loops(result: Outcome, recordings: Recordings) -> dict[bool, Loop]:
    """Return the loops in which a model is filtered, with the key True for the closed loop."""
    recorded, loops = recordings.takes.training, {}
    if result.model is not None:
        loops[False] = (result.model, open_loop(recorded.v))
    if result.closed is not None:
        commands = mean_path(recorded).commands(result.closed.share)
        loops[True] = (result.closed.estimate.model, commands)
    return loops


def _posterior(trial: Trial, recordings: Recordings) -> Posterior | str:
    """Return the filter's posterior on one take, or the reason why there is none."""
    (number, case, (model, commands), measured), (seed, name) = trial, recordings.stream
    kind, takes = case.options.kind, recordings.takes
    filtered = names.closed(kind) if case.closed else kind
    stream = rng.stream(seed, f"{name}.filter.{filtered}", case.draw, number)
    loop = (model, takes.training.chain, commands, 1 / recordings.rate)
    try:
        return particle_filter(*loop, takes.start, measured, case.filter, stream)
    except (DegenerateFilterError, ModelDomainError, SingularJacobianError) as error:
        return str(error)


def outcome(case: Choices, takes: Takes, realizations: int, rng: np.random.Generator) -> Outcome:
    """Fit the only model of ``case``, realise it ``realizations`` times, and score it."""
    result, training = Outcome(), takes.training
    try:
        fit = kinds.estimate(training, case.options)
        result.model = fit.model
        result.estimates = fit.estimates | _papers_estimates(case, training, fit)
        if case.closed:
            result.closed, refused = closed_loop_of(training, case.options, fit)
            result.refusals += [f"no closed loop: {refused}"] if refused else []
        result.log_score = _log_scores(case, fit, takes)
        starts = np.resize(takes.poses, (realizations, *takes.poses.shape[1:]))
        course = (result.model, training.chain, starts, training.v, case.mode)
        realized, _, _ = realize(*course, rng)
        result.mean, result.deviation, refused = realized_moments(*course, realized)
        result.refusals += [refused] if refused else []
        if case.mode == "one_step":
            noise, result.following = noise_tests(result.model, training, takes.poses, rng)
            result.modelled = replace(noise, draws=noise.draws[:0])
    except (ModelDomainError, SingularJacobianError, SolverError) as error:
        result.refusals.append(str(error))
    return result


def _papers_estimates(case: Choices, recorded: Recorded, fit: Estimate) -> dict[str, float]:
    """Return the paper's estimates, for comparison with the published parameters."""
    if (requested := kinds.estimator_options(case.options).get(PAPER)) is None:
        return {}
    try:
        papers = fit if requested == case.options else kinds.estimate(recorded, requested)
    except (ModelDomainError, SolverError):
        return {}
    estimates = {PAPER.format(name): value for name, value in papers.estimates.items()}
    unbounded = papers.diagnostics.get("u_unbounded")  # 1 where û is at the end of its search
    return estimates if unbounded is None else estimates | {"u_paper_unbounded": unbounded}


def noise_tests(
    model: MotionModel, training: Recorded, poses: np.ndarray, rng: np.random.Generator
) -> tuple[ModelledNoise, pd.DataFrame]:
    """Return the noise of ``model`` at the recorded total variance, and the :func:`following_tests`
    of the recorded standard deviations. ``poses`` (takes, M+1, n) rad are the training takes.
    """
    noise = modelled_noise(model, training, rng)
    test = (noise, training.noise, constant_speed(poses), training.joints, rng)
    return noise, following_tests(*test)


def _log_scores(case: Choices, fit: Estimate, takes: Takes) -> dict[str, np.ndarray]:
    """Mean log density (takes,) of test takes, else of training takes under fits to the others."""
    training, folds = takes.training, []
    if takes.test:
        folds.append((fit.model, training, np.stack(list(takes.test.values()))))
    else:
        for i in range(len(takes.poses)):
            others = training.subset(np.delete(np.arange(len(takes.poses)), i))
            model = kinds.estimate(others, case.options).model
            folds.append((model, others, takes.poses[[i]]))
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
    recordings: Recordings,
    outcomes: Mapping[str, Outcome],
    posteriors: Mapping[str, Mapping[str, Posterior | str]],
) -> tuple[Evidence, list[str]]:
    """Return all evidence of ``case``, and the refusals of its models and filters.

    ``outcomes`` by model; ``posteriors`` by filter (a name of :mod:`pipeline.core.filters`) and
    take, or the reason why there is none. A filter without a posterior on one take has no evidence.
    """
    takes = recordings.takes
    evidence = motion_evidence(outcomes, takes, case.mode)
    refusals = {f"{model}: {why}" for model, result in outcomes.items() for why in result.refusals}
    if (camera := recordings.cameras.get(case.clock)) is None:
        return evidence, sorted(refusals)
    evidence["metrics/recordings"] = camera_scores(camera.noise)
    complete, tested = {}, []
    for model, by_take in posteriors.items():
        lost = {f"{model}: {reason}" for reason in by_take.values() if isinstance(reason, str)}
        refusals |= lost
        if by_take and not lost:
            complete[model], tested = list(by_take.values()), list(by_take)
    if complete:
        truth = np.stack([takes.test[take] for take in tested])
        poses = case.measurement * pose_covariances(takes.training, takes.poses)
        linear = None
        if case.closed:
            frames = [camera.takes[take] for take in tested]
            known = (takes.poses, poses[0], frames, 1 / recordings.rate)
            means, covariances, _ = autocorrelated_filter(*known)
            linear = Filtered(means - truth, covariances, poses[0])
        evidence |= filter_evidence(complete, linear, truth, takes, poses)
    return evidence, sorted(refusals)


def camera_scores(noise: pd.DataFrame) -> dict[str, float]:
    """Return the :func:`sensor_scores` of the depth camera from the table ``kinect_noise``."""
    of_all = noise[noise["take"] == "none"]
    joints, count = members(of_all, "b"), noise["take"].nunique() - 1
    variance = np.diagonal(matrices(of_all, "r", joints), axis1=1, axis2=2)
    return scoring.sensor_scores(values(of_all, "b"), variance, count, joints)


def pose_covariances(training: Recorded, poses: np.ndarray) -> np.ndarray:
    """Return the noise covariance (2, n, n) rad² of a measured pose, for open and closed loop.

    The open loop has half the covariance of ω at rest, as ω has the noise of two poses. The closed
    loop has the covariance of ``poses`` (takes, M+1, n) rad at rest. Without rest both are zero.
    """
    try:
        if training.known_measurement is not None:
            return np.stack([training.known_measurement / 2] * 2)
        return np.stack([training.measurement / 2, rest_covariance(poses, training.v)])
    except ModelDomainError:
        return np.zeros((2, *(poses.shape[-1],) * 2))


def motion_evidence(outcomes: Mapping[str, Outcome], takes: Takes, mode: str) -> Evidence:
    """Return the evidence of fits, realisations and predictions; ``outcomes`` by model."""
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
    else:  # without k = 0, before the first step
        std |= {name: each.deviation[1:] for name, each in realized.items()}
    middle = takes.poses.mean(axis=0)
    error = {x: np.linalg.norm(each.mean - middle, axis=1)[1:] for x, each in realized.items()}
    limits = zip(training.joints, takes.variation_of_constant_noise, strict=True)
    limits = {f"recorded_std_{x}_variation_of_constant_noise": limit for x, limit in limits}
    evidence["metrics/motion"] = std_scores(std, error, training.joints) | limits
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
    """Return the evidence of the filters and the training mean against the measured poses ``truth``
    (takes, M+1, n) rad.

    ``posteriors`` are by filter, one per take; ``linear`` is the autocorrelated filter, if any.
    Bounds and scores include ``poses`` (2, n, n) rad², result of :func:`pose_covariances`.
    """
    open_models, joints = names.models_of(posteriors), takes.training.joints
    if not open_models:
        return {}
    filters = {names.NONE: scoring.training_mean(takes.poses, truth)}
    filters |= {names.MEMORY: linear} if linear else {}
    for name, by_take in posteriors.items():
        error = np.stack([posterior.mean for posterior in by_take]) - truth
        covariance = np.stack([posterior.covariance for posterior in by_take])
        filters[name] = Filtered(error, covariance, poses[0 if name in open_models else 1])
    stream = rng.stream(RESAMPLING_SEED, "cases.resampling")
    tables, _ = scoring.filter_tables(filters, joints, stream)
    scores = scoring.filter_metrics(filters, joints, constant_speed(truth))
    return {"metrics/filter": scores} | {f"tables/{name}": table for name, table in tables.items()}
