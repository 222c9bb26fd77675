"""Conditions of the laboratory: its physics, its trajectory, its instruments, the filter's
particles and the cables of the wrench study, one changed at a time or several combined.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import pandas as pd

from pipeline.cases.case import Choices, Recordings
from pipeline.cases.evaluate import evaluate
from pipeline.cases.evidence import Evidence
from pipeline.cases.readings import decided
from pipeline.core import rng
from pipeline.core.errors import ModelDomainError, RecordingError, SingularJacobianError
from pipeline.laboratory.options import TrajectoryOptions
from pipeline.statistics.takes import wrench_summary
from pipeline.studies.simulated import Laboratory, PhysicsFactors, observe
from pipeline.verdicts.claims import Claim
from pipeline.verdicts.reference import ArmNames
from pipeline.wrench.bounds import Bounds
from pipeline.wrench.study import run_study


class Condition(NamedTuple):
    """``levels`` of factors by name, those that are not named as in the base condition."""

    study: str  # motion or wrench
    seed: int
    levels: tuple[tuple[str, float | str], ...] = ()

    def level(self, factor: str) -> float | str:
        """Level of ``factor``; 1 in the base condition."""
        return dict(self.levels).get(factor, 1.0)


@dataclass(frozen=True)
class Common:
    """Laboratory, case, claims and sizes of all conditions."""

    laboratory: Laboratory
    ways: Mapping[str, Mapping[str, object]]  # trajectories by name: changes of the dataset's own
    case: Choices
    takes: tuple[int, int]  # of training and test
    realizations: int
    bounds: Bounds  # of the wrench study
    agents: Sequence[int]  # numbers of cables
    systems: tuple[int, int, int]  # that Σ_S is averaged over, fresh ones, repeats
    claims: tuple[Claim, ...]


def conditions(
    factors: Mapping[str, Sequence], seeds: Sequence[int], study: str, combined: Sequence[str] = ()
) -> Iterator[Condition]:
    """Yield the base condition and each level alone, with every seed; after them every combination
    of two and more levels of the factors ``combined``.
    """
    points = [(), *(((name, level),) for name, levels in factors.items() for level in levels)]
    chosen = {name: factors[name] for name in combined}
    for levels in product(*([1.0, *each] for each in chosen.values())):
        point = tuple((name, x) for name, x in zip(chosen, levels, strict=True) if x != 1.0)
        if len(point) > 1:
            points.append(point)
    for point in points:
        yield from (Condition(study, seed, point) for seed in seeds)


def trajectory(own: TrajectoryOptions, way: Mapping[str, object]) -> TrajectoryOptions:
    """Return ``own`` with other ends ``folded`` and ``extended`` (rad), another ``rest`` (s; the
    motion between the four rests stays) and at another ``pace``.
    """
    pace, rest = float(way.get("pace", 1.0)), float(way.get("rest", own.rest))
    ends = {key: tuple(way[key]) for key in ("folded", "extended") if key in way}
    duration = own.duration + 4 * (rest - own.rest)
    timing = {"duration": duration / pace, "rest": rest / pace, "ramp": own.ramp / pace}
    return replace(own, **ends, **timing)


def verdicts(condition: Condition, common: Common) -> pd.DataFrame:
    """Return the rows of :func:`pipeline.cases.readings.decided` of one condition."""
    evaluated = motion_evidence if condition.study == "motion" else wrench_evidence
    arm = ArmNames(common.laboratory.joints, common.laboratory.chain.task)
    return decided(common.claims, evaluated(condition, common), arm)


def motion_evidence(condition: Condition, common: Common) -> Evidence:
    """Return the evidence of a condition of the motion; none if it comes to a singular pose."""
    way = common.ways.get(str(condition.level("trajectory")), {})
    laboratory = replace(common.laboratory, motion=trajectory(common.laboratory.motion, way))
    levels = {k: float(v) for k, v in condition.levels if k not in ("trajectory", "particles")}
    try:
        takes, camera = observe(laboratory, PhysicsFactors(**levels), condition.seed, *common.takes)
    except (SingularJacobianError, RecordingError, ModelDomainError):
        return {}
    cameras, rate, filtered = {common.case.clock: camera}, laboratory.motion.rate, common.takes[1]
    # equal numbers in every condition of a seed, so that a difference is the condition's
    stream = (condition.seed, "robustness")
    recordings = Recordings(takes, cameras, rate, filtered, common.realizations, stream)
    chosen = common.case.filter
    count = max(1, round(float(condition.level("particles")) * chosen.particles))
    case = replace(common.case, filter=replace(chosen, particles=count))
    ((evidence, _),) = evaluate([case], recordings, map)
    return evidence


def wrench_evidence(condition: Condition, common: Common) -> Evidence:
    """Return the evidence of the numerical study of the wrench with other bounds."""
    own = {"concentration": condition.level("kappa"), "tension_sd": condition.level("tension_std")}
    scaled = {
        name: tuple(float(factor) * value for value in getattr(common.bounds, name))
        for name, factor in own.items()
    }
    stream = rng.stream(condition.seed, "robustness.wrench")
    bounds, sizes = replace(common.bounds, **scaled), common.systems
    _, errors, repeats = run_study(bounds, common.agents, *sizes, stream)
    study, metrics = wrench_summary(errors, repeats), {}
    for m, median in repeats.groupby("agents")["maximum"].median().items():
        own, name = study.set_index("agents").loc[m], f"study_m{m}_greatest_error"
        metrics |= {f"study_m{m}_mean_error": own["mean"], name: own["max"]}
        metrics[f"{name}_median_over_repeats"] = median
    return {"metrics/wrench": metrics, "tables/wrench_study": study}
