"""A model in one case: its parameters, its realisations, and its predictions of takes that its fit has not seen."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.errors import ModelDomainError, SingularJacobianError, SolverError
from pipeline.motion.estimation import Estimate, Recorded, estimate
from pipeline.motion.model import MotionModel
from pipeline.motion.realizations import realize, realized_moments
from pipeline.sensitivity.variations import ModelCase


@dataclass(frozen=True)
class Takes:
    """The takes of the motion capture: those to fit to and, where there are any, those kept for testing."""

    training: Recorded
    poses: np.ndarray  # (takes, M+1, 3) rad, of the training takes
    test: dict[str, np.ndarray]  # take → (M+1, 3) rad


@dataclass
class Outcome:
    """How a model fared; what it does not have is missing, and ``refusals`` say why."""

    model: MotionModel | None = None
    estimates: dict[str, float] = field(default_factory=dict)
    mean: np.ndarray | None = None  # (M+1, 3) rad, of the realisations
    deviation: np.ndarray | None = None  # (M+1, 3) rad
    log_score: dict[str, np.ndarray] = field(default_factory=dict)  # of all steps and of the moving ones, (takes,) nats
    refusals: list[str] = field(default_factory=list)


def outcome(case: ModelCase, takes: Takes, realizations: int, rng: np.random.Generator) -> Outcome:
    """Fit, realise ``realizations`` times and score a model; a model that refuses any of it is an outcome too."""
    found = Outcome()
    try:
        fit = estimate(takes.training, case.options)
        found.model, found.estimates = fit.model, fit.estimates
        found.log_score = _log_scores(case, fit, takes)
        starts = np.resize(takes.poses, (realizations, *takes.poses.shape[1:]))
        chain, v = takes.training.chain, takes.training.v
        realized, _, _ = realize(found.model, chain, starts, v, case.mode, rng)
        found.mean, found.deviation, refused = realized_moments(found.model, chain, starts, v, case.mode, realized)
        if refused:
            found.refusals.append(refused)
    except (ModelDomainError, SingularJacobianError, SolverError) as error:
        found.refusals.append(str(error))
    return found


def _log_scores(case: ModelCase, fit: Estimate, takes: Takes) -> dict[str, np.ndarray]:
    """Mean log density over the steps of each held-out take; without test takes each training take, predicted by a fit to the others."""
    training = takes.training
    if takes.test:
        density = _log_density(fit.model, training, np.stack(list(takes.test.values())), case.measurement)
    else:
        folds = [(training.of(np.delete(np.arange(len(takes.poses)), i)), takes.poses[[i]]) for i in range(len(takes.poses))]
        density = np.concatenate(
            [_log_density(estimate(others, case.options).model, others, poses, case.measurement) for others, poses in folds]
        )
    moving = np.any(training.v, axis=1)
    scores = {"moving": density[:, moving].mean(axis=1)}
    return scores if case.measurement == 0 else scores | {"all": density.mean(axis=1)}


def _log_density(model: MotionModel, training: Recorded, poses: np.ndarray, factor: float) -> np.ndarray:
    """(takes, M) nats of the steps between ``poses`` (takes, M+1, 3); a gap at rest where no measurement noise is added."""
    q, q_next, v = poses[:, :-1], poses[:, 1:], np.broadcast_to(training.v, poses[:, 1:].shape)
    if factor:
        return model.log_density(training.chain, q, v, q_next, factor * training.measurement)
    moving = np.any(v, axis=-1)
    density = np.full(moving.shape, np.nan)
    density[moving] = model.log_density(training.chain, q[moving], v[moving], q_next[moving])
    return density
