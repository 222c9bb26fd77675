"""The evidence of a case under the names that the stages give it in a run, so that the claims can be decided by the same rules."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from pipeline.errors import ModelDomainError
from pipeline.filtering.particle_filter import Posterior
from pipeline.motion.noise import recorded_deviation
from pipeline.sensitivity.cameras import Camera
from pipeline.sensitivity.models import Outcome, Takes
from pipeline.sensitivity.variations import Case
from pipeline.statistics.comparison import compared, filter_metrics, filter_scores, posterior_scores, sensor_scores, spread_scores

Evidence = dict[str, dict[str, float] | pd.DataFrame]
JOINTS = (1, 2, 3)


def case_evidence(
    case: Case,
    takes: Takes,
    outcomes: Mapping[str, Outcome],
    camera: Camera | None,
    posteriors: Mapping[str, Mapping[str, Posterior | str]],
) -> tuple[Evidence, list[str]]:
    """All evidence of ``case``, and what its models and filters refused.

    ``outcomes`` by model; without a ``camera`` there is none on sensor and filter. ``posteriors`` by model and take, or why there is none:
    a filter that was lost on one take is no evidence.
    """
    evidence = motion_evidence(outcomes, takes, case.mode)
    refusals = {f"{model}: {refusal}" for model, found in outcomes.items() for refusal in found.refusals}
    if camera is not None:
        evidence |= sensor_evidence(camera.noise)
        lost = {(model, found) for model, of_takes in posteriors.items() for found in of_takes.values() if isinstance(found, str)}
        refusals |= {f"{model}: {refusal}" for model, refusal in lost}
        whole = {model: of_takes for model, of_takes in posteriors.items() if model not in dict(lost)}
        if whole:
            truth = np.stack([takes.test[take] for take in next(iter(whole.values()))])
            of_pose = case.measurement * noise_of_a_pose(takes)
            evidence |= filter_evidence({model: list(of_takes.values()) for model, of_takes in whole.items()}, truth, of_pose)
    return evidence, sorted(refusals)


def noise_of_a_pose(takes: Takes) -> np.ndarray:
    """(3, 3) rad²: half the covariance at rest, for ω holds the noise of two poses; zero where the motion never rests."""
    try:
        return takes.training.measurement / 2
    except ModelDomainError:
        return np.zeros((3, 3))


def motion_evidence(outcomes: Mapping[str, Outcome], takes: Takes, mode: str) -> Evidence:
    """What fits, realisations and predictions say; ``outcomes`` by model."""
    evidence: Evidence = {f"metrics/fit_{model}": dict(found.estimates) for model, found in outcomes.items()}
    realized = {model: found for model, found in outcomes.items() if found.mean is not None}
    # at k = 0 nothing has moved yet
    std = {"recorded": recorded_deviation(takes.poses, takes.training.noise, mode)[1:]}
    std |= {model: found.deviation[1:] for model, found in realized.items()}
    middle = takes.poses.mean(axis=0)
    error = {model: np.linalg.norm(found.mean - middle, axis=1)[1:] for model, found in realized.items()}
    evidence["metrics/motion"] = spread_scores(std, error)
    scored = {model: found.log_score for model, found in outcomes.items() if found.log_score}
    tables = {}
    for steps in ("all", "moving"):
        of_steps = {model: {"log_score": scores[steps]} for model, scores in scored.items() if steps in scores}
        if of_steps:
            tables[steps] = compared(of_steps)
    if tables:
        evidence["tables/one_step_scores"] = pd.concat(tables, names=["steps"]).reset_index("steps")
    return evidence


def sensor_evidence(noise: pd.DataFrame) -> Evidence:
    """What the depth camera's ``noise`` says, a table as of :func:`pipeline.perception.depth_noise.leave_one_out`."""
    of_all = noise[noise["take"] == "none"]
    bias, variance = (of_all[[name.format(j) for j in JOINTS]].to_numpy() for name in ("b{0}", "r{0}{0}"))
    return {"metrics/recordings": sensor_scores(bias, variance, noise["take"].nunique() - 1)}


def filter_evidence(posteriors: Mapping[str, list[Posterior]], truth: np.ndarray, of_pose: np.ndarray) -> Evidence:
    """What the filters' ``posteriors`` by model, one a take, say against the measured poses ``truth`` (takes, M+1, 3) in rad.

    ``of_pose`` (3, 3) in rad² is the noise of a measured pose, that the scores of a posterior add to it.
    """
    error, covariance = (
        {model: np.stack([getattr(posterior, name) for posterior in of_model]) for model, of_model in posteriors.items()}
        for name in ("mean", "covariance")
    )
    error = {model: mean - truth for model, mean in error.items()}
    bound = {model: np.sqrt(np.diagonal(values, axis1=-2, axis2=-1)) for model, values in covariance.items()}
    scores = {model: posterior_scores(error[model], covariance[model] + of_pose)[0] for model in posteriors}
    return {"metrics/filter": filter_metrics(filter_scores(error, bound)), "tables/filter_comparison": compared(scores)}
