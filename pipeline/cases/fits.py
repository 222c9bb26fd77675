"""A model in one case: its parameters, its realisations, and its predictions of unseen takes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from pipeline.cases.case import Choices, Takes
from pipeline.core.errors import ModelDomainError, SingularJacobianError, SolverError
from pipeline.models.closed_loop import ClosedLoopFit, closed_loop_of
from pipeline.models.kinds import compared, estimate
from pipeline.models.model import MotionModel
from pipeline.models.options import Options
from pipeline.models.prediction import modelled_noise
from pipeline.models.realizations import realize, realized_moments
from pipeline.models.steps import Estimate, Recorded
from pipeline.recordings.commands import constant_speed
from pipeline.statistics.curves import ModelledNoise, following_tests

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
    fared = Outcome()
    try:
        fit = estimate(takes.training, case.options)
        fared.model = fit.model
        fared.estimates = fit.estimates | _papers_estimates(takes.training, case.options, fit)
        if case.closed:
            fared.closed, refused = closed_loop_of(takes.training, case.options, fit)
            if refused:
                fared.refusals.append(f"no closed loop: {refused}")
        fared.log_score = _log_scores(case, fit, takes)
        starts = np.resize(takes.poses, (realizations, *takes.poses.shape[1:]))
        chain, v = takes.training.chain, takes.training.v
        realized, _, _ = realize(fared.model, chain, starts, v, case.mode, rng)
        fared.mean, fared.deviation, refused = realized_moments(
            fared.model, chain, starts, v, case.mode, realized
        )
        if refused:
            fared.refusals.append(refused)
        if case.mode == "one_step":
            noise, training = modelled_noise(fared.model, takes.training, rng), takes.training
            fared.following = following_tests(
                noise, training.noise, constant_speed(takes.poses), training.joints, rng
            )
            fared.modelled = replace(noise, draws=noise.draws[:0])
    except (ModelDomainError, SingularJacobianError, SolverError) as error:
        fared.refusals.append(str(error))
    return fared


def _papers_estimates(recorded: Recorded, options: Options, fit: Estimate) -> dict[str, float]:
    """Estimates by the paper's estimator, which its published parameters are compared with."""
    if (requested := compared(options).get(PAPER)) is None:
        return {}
    try:
        own = fit if requested == options else estimate(recorded, requested)
    except (ModelDomainError, SolverError):
        return {}
    estimates = {PAPER.format(name): value for name, value in own.estimates.items()}
    # whether û is an estimate at all
    unbounded = {"u_paper_unbounded": own.diagnostics.get("u_unbounded")}
    return estimates | {name: value for name, value in unbounded.items() if value is not None}


def _log_scores(case: Choices, fit: Estimate, takes: Takes) -> dict[str, np.ndarray]:
    """Mean log density over the steps of each held-out take; without test takes each training take,
    predicted by a fit to the others.
    """
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
    """(takes, M) nats of the steps between ``poses`` (takes, M+1, n); a gap at rest where no
    measurement noise is added.
    """
    q, q_next = poses[:, :-1], poses[:, 1:]
    v = np.broadcast_to(training.v, (*q.shape[:-1], training.v.shape[-1]))
    if factor:
        return model.log_density(training.chain, q, v, q_next, factor * training.measurement)
    moving = np.any(v, axis=-1)
    density = np.full(moving.shape, np.nan)
    density[moving] = model.log_density(training.chain, q[moving], v[moving], q_next[moving])
    return density
