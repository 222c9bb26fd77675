"""The evidence of one condition of the motion."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.cases.case import Case
from pipeline.cases.evaluate import Recordings, evaluate
from pipeline.cases.evidence import Evidence
from pipeline.core.errors import ModelDomainError, RecordingError, SingularJacobianError
from pipeline.filtering.particle_filter import FilterOptions
from pipeline.models.options import Options
from pipeline.studies.survey.conditions import MotionCondition
from pipeline.studies.survey.robots import Laboratory, observe


@dataclass(frozen=True)
class MotionStudy:
    """What every condition of the motion is decided with."""

    laboratory: Laboratory
    # those of the paper by kind, and further ones that are scored alone
    models: dict[str, Options]
    resampling: str
    threshold: float
    mode: str  # of the realisations
    training_takes: int
    test_takes: int
    realizations: int


def motion_evidence(condition: MotionCondition, study: MotionStudy) -> Evidence:
    """The condition's numbers by the names that claims refer to them by; none where its motion
    comes to a singular pose.
    """
    try:
        takes, camera = observe(
            study.laboratory,
            condition.trajectory,
            condition.factors,
            condition.seed,
            study.training_takes,
            study.test_takes,
        )
    except (SingularJacobianError, RecordingError, ModelDomainError):
        return {}
    recordings = Recordings(
        takes=takes,
        cameras={"aligned": camera},
        rate=study.laboratory.trajectories[condition.trajectory].rate,
        filtered=study.test_takes,
        realizations=study.realizations,
        # equal numbers in every condition of a seed, so that what differs is the condition's
        stream=(condition.seed, "survey"),
    )
    options = FilterOptions(condition.particles, study.resampling, study.threshold)
    case = Case(study.models, options, study.mode, closed=True)
    ((evidence, _),) = evaluate([case], recordings, map)
    return evidence
