"""Evaluation of cases: fits, realisations, scores and filters with the random numbers of the
stages, so that a case with the run's choices has the run's evidence. Common parts of cases are
evaluated once.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

import numpy as np
import pandas as pd

from pipeline.core import filters as names
from pipeline.core.errors import (
    DegenerateFilterError,
    ModelDomainError,
    SingularJacobianError,
    SolverError,
)
from pipeline.evidence.case import KINDS, Choices, Recordings, Takes
from pipeline.evidence.filters import filter_evidence
from pipeline.evidence.instruments import camera_evidence
from pipeline.evidence.motion import Outcome, motion_evidence, noise_tests
from pipeline.filtering.linear import autocorrelated_filter
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Posterior, particle_filter
from pipeline.models import kinds
from pipeline.models.closed_loop import FOLDER, closed_loop_of, mean_path
from pipeline.models.draws import realize, realized_moments
from pipeline.models.model import Commands, MotionModel, open_loop
from pipeline.models.steps import Estimate, Recorded, measurement_covariance
from pipeline.recordings.commands import constant_speed
from pipeline.statistics.scores import Filtered, training_mean

Loop = tuple[MotionModel, Commands]  # a fitted model and its commands
# number of the take, its part of the case, the loop, the take's measurements
Trial = tuple[int, Choices, Loop, Measurements]
Run = Callable[
    [Callable, Sequence], Iterable
]  # like the built-in map, with results in order
PAPERS_ESTIMATE = "{}_paper"  # names of the estimates of the paper's estimator


def evaluate(
    cases: Sequence[Choices], recordings: Recordings, run: Run
) -> list[tuple[pd.DataFrame, list[str]]]:
    """Return the evidence and refusals of every case; only the paper's models are filtered."""
    cameras, count = recordings.cameras, recordings.filtered
    takes = list(next(iter(cameras.values())).takes) if cameras else []

    def map_trials(function: Callable, trials: Mapping[str, object]) -> dict:
        results = run(partial(function, recordings=recordings), list(trials.values()))
        return dict(zip(trials, results, strict=True))

    # options are not hashable; equal options have equal representations
    models = {
        repr(part): part for case in cases for part in map(case.model_case, case.models)
    }
    outcomes = map_trials(outcome, models)
    loops = {key: _loops(result, recordings) for key, result in outcomes.items()}
    trials: dict[str, Trial] = {}
    keys: list[
        dict[str, dict[str, str]]
    ] = []  # filter → take → key of its trial, for each case
    for case in cases:
        keys.append({})
        batch = takes[case.batch * count : (case.batch + 1) * count]
        if len(batch) < count:
            continue
        for name in case.models:
            if case.models[name].kind not in KINDS:
                continue
            for closed, loop in loops[repr(case.model_case(name))].items():
                part = case.filter_case(name, closed)
                own = keys[-1][names.closed(name) if closed else name] = {}
                for take in batch:
                    own[take] = f"{take} {part!r}"
                    measured = cameras[case.clock].takes[take]
                    trials[own[take]] = (takes.index(take), part, loop, measured)
    posteriors = map_trials(_posterior, trials)
    results = []
    for case, filters in zip(cases, keys, strict=True):
        of_case = {name: outcomes[repr(case.model_case(name))] for name in case.models}
        found = {
            name: {take: posteriors[key] for take, key in own.items()}
            for name, own in filters.items()
        }
        results.append(case_evidence(case, recordings, of_case, found))
    return results


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
    (number, case, (model, commands), measured), takes = trial, recordings.takes
    name = f"filter.{case.name}"
    if case.closed:
        name += f".{FOLDER}"
    stream = recordings.generator(name, number, draw=case.draw)
    loop = (model, takes.training.chain, commands, 1 / recordings.rate)
    try:
        return particle_filter(*loop, takes.start, measured, case.filter, stream)
    except (DegenerateFilterError, ModelDomainError, SingularJacobianError) as error:
        return str(error)


def outcome(case: Choices, recordings: Recordings) -> Outcome:
    """Fit the only model of ``case``, realise it, and score it. The random numbers are the stages'
    in all cases, so that only the choices differ.
    """
    result, takes = Outcome(), recordings.takes
    training = takes.training
    try:
        fit = kinds.estimate(training, case.options)
        result.model = fit.model
        result.estimates = fit.determined | _papers_estimates(case, training, fit)
        if case.closed:
            result.closed, refused = closed_loop_of(training, case.options, fit)
            result.refusals += [f"no closed loop: {refused}"] if refused else []
        result.log_score = _log_scores(case, fit, takes)
        starts = np.resize(
            takes.poses, (recordings.realizations, *takes.poses.shape[1:])
        )
        course = (result.model, training.chain, starts, training.v, case.mode)
        drawn = recordings.generator(f"simulate.{case.name}", draw=case.draw)
        realized, _, _ = realize(*course, drawn)
        result.mean, result.deviation, refused = realized_moments(*course, realized)
        result.refusals += [refused] if refused else []
        if case.mode == "one_step":
            name = f"score.following.{case.name}"
            drawn = recordings.generator(name, draw=case.draw)
            tests = noise_tests(result.model, training, takes.poses, drawn)
            result.modelled, result.following = tests
    except (ModelDomainError, SingularJacobianError, SolverError) as error:
        result.refusals.append(str(error))
    return result


def _papers_estimates(
    case: Choices, recorded: Recorded, fit: Estimate
) -> dict[str, float]:
    """Return the paper's estimates, for comparison with the published parameters."""
    if (
        requested := kinds.estimator_options(case.options).get(PAPERS_ESTIMATE)
    ) is None:
        return {}
    try:
        papers = (
            fit if requested == case.options else kinds.estimate(recorded, requested)
        )
    except (ModelDomainError, SolverError):
        return {}
    estimates = {
        PAPERS_ESTIMATE.format(name): value for name, value in papers.determined.items()
    }
    unbounded = papers.diagnostics.get(
        "u_unbounded"
    )  # 1 where û is at the end of its search
    return (
        estimates if unbounded is None else estimates | {"u_paper_unbounded": unbounded}
    )


def _log_scores(case: Choices, fit: Estimate, takes: Takes) -> dict[str, np.ndarray]:
    """Mean log density (takes,) of test takes, else of training takes under fits to the others."""
    training, count, folds = takes.training, len(takes.poses), []
    if takes.test:
        folds.append((fit.model, training, np.stack(list(takes.test.values()))))
    for i in range(0 if takes.test else count):
        others = training.subset(np.delete(np.arange(count), i))
        folds.append(
            (kinds.estimate(others, case.options).model, others, takes.poses[[i]])
        )
    density = np.concatenate([_log_density(*fold, case.measurement) for fold in folds])
    scores = {"moving": density[:, np.any(training.v, axis=1)].mean(axis=1)}
    return scores if case.measurement == 0 else scores | {"all": density.mean(axis=1)}


def _log_density(
    model: MotionModel, training: Recorded, poses: np.ndarray, factor: float
) -> np.ndarray:
    """(takes, M) nats of the steps between ``poses`` (takes, M+1, n); NaN at rest without noise."""
    q, q_next = poses[:, :-1], poses[:, 1:]
    v = np.broadcast_to(training.v, (*q.shape[:-1], training.v.shape[-1]))
    if factor:
        return model.log_density(
            training.chain, q, v, q_next, factor * training.measurement
        )
    moving = np.any(v, axis=-1)
    density = np.full(moving.shape, np.nan)
    density[moving] = model.log_density(
        training.chain, q[moving], v[moving], q_next[moving]
    )
    return density


def case_evidence(
    case: Choices,
    recordings: Recordings,
    outcomes: Mapping[str, Outcome],
    posteriors: Mapping[str, Mapping[str, Posterior | str]],
) -> tuple[pd.DataFrame, list[str]]:
    """Return all evidence of ``case``, and the refusals of its models and filters.

    ``outcomes`` by model; ``posteriors`` by filter (a name of :mod:`pipeline.core.filters`) and
    take, or the reason why there is none. A filter without a posterior on one take has no evidence.
    """
    takes, limits = recordings.takes, recordings.variation_limits
    tables = [motion_evidence(outcomes, takes, case.mode, limits)]
    refusals = {
        f"{model}: {why}"
        for model, result in outcomes.items()
        for why in result.refusals
    }
    if (camera := recordings.cameras.get(case.clock)) is None:
        return tables[0], sorted(refusals)
    tables += [] if camera.noise is None else [camera_evidence(camera.noise)]
    complete, tested = {}, []
    for model, by_take in posteriors.items():
        lost = {
            f"{model}: {reason}"
            for reason in by_take.values()
            if isinstance(reason, str)
        }
        refusals |= lost
        if by_take and not lost:
            moments = ((own.mean, own.covariance) for own in by_take.values())
            complete[model], tested = (
                tuple(map(np.stack, zip(*moments, strict=True))),
                [*by_take],
            )
    if names.models_of(complete):
        measured = [camera.takes[take] for take in tested] if case.closed else None
        truth = np.stack([takes.test[take] for take in tested])
        filters = all_filters(
            takes, truth, complete, measured, recordings.rate, case.measurement
        )
        steady = constant_speed(takes.poses)
        generator = partial(recordings.generator, draw=case.draw)
        evidence, _, _ = filter_evidence(
            filters, takes.training.joints, steady, generator
        )
        tables.append(evidence)
    return pd.concat(tables, ignore_index=True), sorted(refusals)


def all_filters(
    takes: Takes,
    truth: np.ndarray,
    posteriors: Mapping[str, tuple[np.ndarray, np.ndarray]],
    measured: Sequence[Measurements] | None,
    rate: float,
    factor: float = 1.0,
) -> dict[str, Filtered]:
    """Return the training mean, the linear filter of the takes ``measured`` at ``rate`` in 1/s, if
    any, and the filters with ``posteriors``: mean (takes, M+1, n) rad and covariance (takes, M+1,
    n, n) rad², all beside ``truth`` (takes, M+1, n) rad; ``factor`` is on the noise of a pose.
    """
    poses = factor * pose_covariances(takes.training, takes.poses)
    filters = {names.NONE: training_mean(takes.poses, truth)}
    if measured is not None:
        posterior = autocorrelated_filter(takes.poses, poses[0], measured, 1 / rate)
        posteriors = {names.MEMORY: posterior} | {**posteriors}
    for name, (mean, covariance) in posteriors.items():
        noise = poses[int(name.endswith(names.CLOSED))]
        filters[name] = Filtered(mean - truth, covariance, noise)
    return filters


def pose_covariances(training: Recorded, poses: np.ndarray) -> np.ndarray:
    """Return the noise covariance (2, n, n) rad² of a measured pose, for open and closed loop.

    The open loop has half the covariance of ω at rest, as ω has the noise of two poses. The closed
    loop has the covariance of ``poses`` (takes, M+1, n) rad at rest, which contains the constant
    deviation of a take. Without rest both are zero.
    """
    try:
        if training.known_measurement is not None:
            return np.stack([training.known_measurement / 2] * 2)
        at_rest = measurement_covariance(poses[:, :-1], training.v)
        return np.stack([training.measurement / 2, at_rest])
    except ModelDomainError:
        return np.zeros((2, *(poses.shape[-1],) * 2))
