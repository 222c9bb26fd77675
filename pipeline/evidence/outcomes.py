"""Evaluation of cases: fits, realisations, scores and filters with the random numbers of the
stages, so that a case with the run's choices has the run's evidence. Common parts of cases are
evaluated once.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

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
from pipeline.evidence.forms import smoothness_evidence
from pipeline.evidence.instruments import camera_evidence
from pipeline.evidence.motion import (
    Outcome,
    dexterity_evidence,
    motion_evidence,
    noise_tests,
)
from pipeline.filtering.linear import autocorrelated_filter, linear_filter, white_steps
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterTrial, Start, take_posterior
from pipeline.models import kinds
from pipeline.models.closed_loop import Loop, closed_loop_of, loops_of
from pipeline.models.draws import realize_recorded
from pipeline.models.model import MotionModel
from pipeline.models.speed.fit import Options as SpeedOptions
from pipeline.models.steps import Estimate, Options, Recorded, measurement_covariance
from pipeline.recordings.commands import constant_speed
from pipeline.statistics.scores import Filtered, training_mean

# like the built-in map, with results in order
Run = Callable[[Callable, Sequence], Iterable]
PAPERS_ESTIMATE = "{}_paper"  # names of the estimates of the paper's estimator


class PosteriorMoments(NamedTuple):
    """Moments of the joint angles at the M+1 poses of a take, given its measurements."""

    mean: np.ndarray  # (M+1, n) rad
    covariance: np.ndarray  # (M+1, n, n) rad²


# by filter (a name of pipeline.core.filters) and take; a reason in place of a missing posterior
Posteriors = Mapping[str, Mapping[str, PosteriorMoments | str]]


class CaseEvidence(NamedTuple):
    """Evidence of a case, and what it is computed from."""

    evidence: pd.DataFrame
    refusals: list[str]  # reasons for missing fits, comparisons and filters
    filters: dict[str, Filtered]  # all compared filters; empty without a posterior
    against_mean: pd.DataFrame | None  # table filter_against_none


def evaluate(
    cases: Sequence[Choices],
    recordings: Recordings,
    run: Run,
) -> list[CaseEvidence]:
    """Return the evidence of every case; only models of the paper's kinds are filtered."""

    def map_trials(function: Callable, trials: Mapping[str, object]) -> dict:
        results = run(partial(function, recordings=recordings), list(trials.values()))
        return dict(zip(trials, results, strict=True))

    # options are not hashable; equal options have equal representations
    fits = {}
    for case in cases:
        for name in case.models:
            of_model = case.model_case(name)
            fits[repr(of_model)] = of_model
    outcomes = map_trials(outcome, fits)
    trials_of_cases = [_filter_trials(case, recordings, outcomes) for case in cases]
    trials = {}
    for by_filter in trials_of_cases:
        for by_take in by_filter.values():
            trials |= by_take
    moments = map_trials(_posterior_moments, trials)
    results = []
    for case, by_filter in zip(cases, trials_of_cases, strict=True):
        of_case = {name: outcomes[repr(case.model_case(name))] for name in case.models}
        posteriors = {}
        for name, by_take in by_filter.items():
            takes = {trial.measurements.take: key for key, trial in by_take.items()}
            posteriors[name] = {take: moments[key] for take, key in takes.items()}
        results.append(case_evidence(case, recordings, of_case, posteriors))
    return results


def _filter_trials(
    case: Choices,
    recordings: Recordings,
    outcomes: Mapping[str, Outcome],
) -> dict[str, dict[str, FilterTrial]]:
    """Return by filter the trials of ``case``, by a key that equal trials of all cases share."""
    camera = recordings.cameras.get(case.clock)
    takes = [] if camera is None else list(enumerate(camera.takes.values()))
    count = recordings.filtered
    batch = takes[case.batch * count : (case.batch + 1) * count]
    trials: dict[str, dict[str, FilterTrial]] = {}
    if len(batch) < count:
        return trials
    start = Start.of_takes(recordings.takes.training)
    for name, options in case.models.items():
        if options.kind not in KINDS:
            continue
        result = outcomes[repr(case.model_case(name))]
        for closed, loop in _loops(result, recordings).items():
            choices = repr(case.filter_case(name, closed))
            of_filter = {}
            for number, measured in batch:
                of_filter[f"{measured.take} {choices}"] = FilterTrial(
                    name,
                    loop,
                    closed,
                    measured,
                    number,
                    start,
                    case.filter,
                    case.draw,
                )
            trials[names.closed(name) if closed else name] = of_filter
    return trials


def _loops(result: Outcome, recordings: Recordings) -> dict[bool, Loop]:
    """Return the loops in which the fitted model of ``result`` is filtered."""
    closed = None
    if result.closed is not None:
        closed = result.closed.estimate.model, result.closed.share
    return loops_of(recordings.takes.training, result.model, closed)


def _posterior_moments(
    trial: FilterTrial,
    recordings: Recordings,
) -> PosteriorMoments | str:
    """Return the posterior's moments of one take, or the reason why there are none."""
    chain = recordings.takes.training.chain
    rate = recordings.rate
    seed = recordings.seed
    try:
        posterior = take_posterior(trial, chain, rate, seed)
    except (DegenerateFilterError, ModelDomainError, SingularJacobianError) as error:
        return str(error)
    return PosteriorMoments(posterior.mean, posterior.covariance)


def outcome(case: Choices, recordings: Recordings) -> Outcome:
    """Fit the only model of ``case``, realise it, and score it. The random numbers are the stages'
    in all cases, so that only the choices differ.
    """
    result = Outcome()
    takes = recordings.takes
    training = takes.training
    try:
        fit = kinds.estimate(training, case.options)
        result.model = fit.model
        papers = _papers_estimate(case.options, training, fit)
        result.estimates = dict(fit.determined)
        if papers is not None:
            result.estimates |= papers.named(PAPERS_ESTIMATE, {})
        if case.closed:
            result.closed, refused = closed_loop_of(training, case.options, fit)
            if refused:
                result.refusals.append(f"no closed loop: {refused}")
        result.log_score = _log_scores(case, fit, takes)
        drawn = recordings.generator(f"simulate.{case.name}", draw=case.draw)
        realized = realize_recorded(
            result.model,
            training,
            case.mode,
            recordings.realizations,
            drawn,
        )
        result.mean, result.deviation = realized.mean, realized.deviation
        if realized.refused:
            result.refusals.append(realized.refused)
    except (ModelDomainError, SingularJacobianError, SolverError) as error:
        result.refusals.append(str(error))
        return result
    if case.mode == "one_step":
        compare_noise(case.name, result, recordings, case.draw)
    return result


def compare_noise(
    model: str,
    result: Outcome,
    recordings: Recordings,
    draw: int = 0,
) -> None:
    """Add to ``result`` the noise of its ``model`` at the recorded total variance and its tests
    against the recordings, or the reason why there are none.
    """
    drawn = recordings.generator(f"score.following.{model}", draw=draw)
    try:
        tests = noise_tests(result.model, recordings.takes, drawn)
    except (ModelDomainError, SingularJacobianError, SolverError) as error:
        result.refusals.append(f"not at the recorded total variance: {error}")
        return
    result.modelled, result.following = tests


def _papers_estimate(
    options: Options,
    recorded: Recorded,
    fit: Estimate,
) -> Estimate | None:
    """Return the estimate of the paper's estimator, for comparison with the published parameters;
    None if the model has no such estimator or it fails.
    """
    requested = kinds.estimator_options(options).get(PAPERS_ESTIMATE)
    if requested is None or requested == options:
        return None if requested is None else fit
    try:
        return kinds.estimate(recorded, requested)
    except (ModelDomainError, SolverError):
        return None


def _log_scores(case: Choices, fit: Estimate, takes: Takes) -> dict[str, np.ndarray]:
    """Mean log density (takes,) of test takes, else of training takes under fits to the others."""
    training = takes.training
    densities = []
    if takes.test:
        poses = np.stack(list(takes.test.values()))
        densities.append(_log_density(fit.model, training, poses, case.measurement))
    else:
        numbers = np.arange(len(takes.poses))
        for i in numbers:
            rest = training.subset(np.delete(numbers, i))
            model = kinds.estimate(rest, case.options).model
            poses = takes.poses[[i]]
            densities.append(_log_density(model, rest, poses, case.measurement))
    density = np.concatenate(densities)
    moving = np.any(training.v, axis=1)
    scores = {"moving": density[:, moving].mean(axis=1)}
    if case.measurement != 0:
        scores["all"] = density.mean(axis=1)
    return scores


def _log_density(
    model: MotionModel,
    training: Recorded,
    poses: np.ndarray,
    factor: float,
) -> np.ndarray:
    """(takes, M) nats of the steps between ``poses`` (takes, M+1, n); NaN at rest without noise."""
    q = poses[:, :-1]
    q_next = poses[:, 1:]
    v = np.broadcast_to(training.v, (*q.shape[:-1], training.v.shape[-1]))
    if factor:
        return model.log_density(
            training.chain,
            q,
            v,
            q_next,
            factor * training.measurement,
        )
    moving = np.any(v, axis=-1)
    density = np.full(moving.shape, np.nan)
    density[moving] = model.log_density(
        training.chain,
        q[moving],
        v[moving],
        q_next[moving],
    )
    return density


def case_evidence(
    case: Choices,
    recordings: Recordings,
    outcomes: Mapping[str, Outcome],
    posteriors: Posteriors,
) -> CaseEvidence:
    """Return all evidence of ``case`` from the ``outcomes`` by model and the ``posteriors``. A
    filter without a posterior on one take has no evidence.
    """
    takes = recordings.takes
    limits = recordings.variation_limits
    outcomes = {**outcomes, **_speed_control(case, recordings, outcomes)}
    parts = [motion_evidence(outcomes, takes, case.mode, limits)]
    parts.append(dexterity_evidence(outcomes, takes, recordings.generator("dexterity")))
    parts.append(smoothness_evidence(outcomes, takes, recordings.generator))
    refusals = {
        f"{model}: {why}"
        for model, result in outcomes.items()
        for why in result.refusals
    }
    complete = {}
    for name, by_take in posteriors.items():
        reasons = {why for why in by_take.values() if isinstance(why, str)}
        refusals |= {f"{name}: {why}" for why in reasons}
        if by_take and not reasons:
            complete[name] = by_take
    camera = recordings.cameras.get(case.clock)
    filters = {}
    against_mean = None
    if camera is not None and names.models_of(complete):
        filters = _compared_filters(case, recordings, complete)
        evidence, against_mean, unscored = filter_evidence(
            filters,
            takes.training.joints,
            constant_speed(takes.poses),
            partial(recordings.generator, draw=case.draw),
        )
        parts.append(evidence)
        refusals |= {*unscored}
    if camera is not None and camera.noise is not None:
        parts.append(camera_evidence(camera.noise, camera.slopes))
    table = pd.concat(parts, ignore_index=True)
    return CaseEvidence(table, sorted(refusals), filters, against_mean)


def _speed_control(
    case: Choices,
    recordings: Recordings,
    outcomes: Mapping[str, Outcome],
) -> dict[str, Outcome]:
    """Return by name noise and log scores of the speed law, the control of the other models;
    {} without its fit, where it is among the models, and for free-running realisations.
    """
    law = recordings.takes.speed_law
    if law is None or names.SPEED in outcomes or case.mode != "one_step":
        return {}
    control = Outcome(model=law)
    compare_noise(names.SPEED, control, recordings, case.draw)
    if any(outcome.log_score for outcome in outcomes.values()):
        options = SpeedOptions(kind=names.SPEED)
        alone = replace(case, models={names.SPEED: options})
        fit = kinds.estimate(recordings.takes.training, options)
        control.log_score = _log_scores(alone, fit, recordings.takes)
    return {names.SPEED: control}


def _compared_filters(
    case: Choices,
    recordings: Recordings,
    posteriors: Mapping[str, Mapping[str, PosteriorMoments]],
) -> dict[str, Filtered]:
    """Return :func:`all_filters` of the takes that all ``posteriors`` have."""
    tested = list(next(iter(posteriors.values())))
    truth = np.stack([recordings.takes.test[take] for take in tested])
    stacked = {}
    for name, by_take in posteriors.items():
        moments = [by_take[take] for take in tested]
        means = np.stack([of_take.mean for of_take in moments])
        covariances = np.stack([of_take.covariance for of_take in moments])
        stacked[name] = (means, covariances)
    measured = None
    if case.closed:
        measured = [recordings.cameras[case.clock].takes[take] for take in tested]
    rate = recordings.rate
    factor = case.measurement
    return all_filters(recordings.takes, truth, stacked, measured, rate, factor)


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
        if takes.speed_law is not None and names.SPEED not in posteriors:
            posteriors[names.SPEED] = speed_filter(takes, measured, 1 / rate)
    for name, (mean, covariance) in posteriors.items():
        noise = poses[int(name.endswith(names.CLOSED))]
        filters[name] = Filtered(mean - truth, covariance, noise)
    return filters


def speed_filter(
    takes: Takes,
    measured: Sequence[Measurements],
    dt: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact posterior of the speed law as :func:`linear_filter`: its steps are the
    commanded ones, and their independent noise does not depend on the pose.
    """
    training = takes.training
    start = Start.of_takes(training)
    steps = training.chain.nominal_step(training.q, training.v).mean(axis=0)
    displacements = np.vstack([np.zeros_like(start.mean), np.cumsum(steps, axis=0)])
    path = start.mean + displacements
    law = white_steps(start.covariance, takes.speed_law.variances(steps))
    return linear_filter(path, law, measured, dt)


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
