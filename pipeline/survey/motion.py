"""The evidence of one condition of the motion: fits, realisations, predictions and filters by the functions of the stages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline import rng, schema
from pipeline.errors import DegenerateFilterError, ModelDomainError, RecordingError, SingularJacobianError
from pipeline.filtering.particle_filter import FilterOptions, Posterior, Start, particle_filter
from pipeline.sensitivity.cameras import Camera
from pipeline.sensitivity.evidence import Evidence, case_evidence
from pipeline.sensitivity.models import Outcome, Takes, outcome
from pipeline.sensitivity.variations import KINDS, Case
from pipeline.survey.conditions import MotionCondition
from pipeline.survey.laboratory import Laboratory, observe


@dataclass(frozen=True)
class MotionStudy:
    """What every condition of the motion is decided with."""

    laboratory: Laboratory
    models: dict[str, schema.Model]  # those of the paper by kind, and further ones that are scored alone
    resampling: str
    threshold: float
    mode: str  # of the realisations
    training_takes: int
    test_takes: int
    realizations: int


def motion_evidence(condition: MotionCondition, study: MotionStudy) -> Evidence:
    """The condition's numbers by the names that claims refer to them by; none where its motion comes to a singular pose."""
    try:
        takes, camera = observe(
            study.laboratory, condition.trajectory, condition.factors, condition.seed, study.training_takes, study.test_takes
        )
    except (SingularJacobianError, RecordingError, ModelDomainError):
        return {}
    case = Case(study.models, FilterOptions(condition.particles, study.resampling, study.threshold), study.mode)
    # equal numbers in every condition of a seed, so that what differs is the condition's
    outcomes = {
        name: outcome(case.of_model(name), takes, study.realizations, rng.stream(condition.seed, f"survey.{name}")) for name in case.models
    }
    rate = study.laboratory.trajectories[condition.trajectory].rate
    posteriors = {
        kind: _posteriors(kind, outcomes[kind], takes, camera, case.filter, rate, condition.seed)
        for kind in KINDS
        if kind in outcomes and outcomes[kind].model is not None
    }
    evidence, _ = case_evidence(case, takes, outcomes, camera, posteriors)
    return evidence


def _posteriors(
    kind: str, found: Outcome, takes: Takes, camera: Camera, options: FilterOptions, rate: float, seed: int
) -> dict[str, Posterior | str]:
    """By take the filter's posterior, or why there is none."""
    first, training = takes.poses[:, 0], takes.training
    start = Start(first.mean(axis=0), np.cov(first.T))
    posteriors: dict[str, Posterior | str] = {}
    for number, (take, seen) in enumerate(camera.takes.items()):
        stream = rng.stream(seed, f"survey.filter.{kind}", number)
        try:
            posteriors[take] = particle_filter(found.model, training.chain, training.v, 1 / rate, start, seen, options, stream)
        except (DegenerateFilterError, ModelDomainError, SingularJacobianError) as error:
            posteriors[take] = str(error)
    return posteriors
