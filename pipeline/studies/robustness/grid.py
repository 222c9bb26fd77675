"""The grid of cases: the run's own options with one decision of the paper taken otherwise; and the
laboratory, its physics, trajectory, instruments, particles or cables changed one at a time.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.cases.case import Camera, Choices, Recordings, camera_of
from pipeline.cases.evidence import evaluate
from pipeline.cases.readings import claim_verdicts, readings
from pipeline.core import rng
from pipeline.core.errors import ModelDomainError, RecordingError, SingularJacobianError
from pipeline.core.options.analysis import Wrench
from pipeline.filtering.sampling import SCHEMES
from pipeline.laboratory.options import TrajectoryOptions
from pipeline.statistics.takes import wrench_summary
from pipeline.studies.simulated import Laboratory, PhysicsFactors, observe
from pipeline.verdicts.claims import Claim
from pipeline.verdicts.run import ArmNames, Evidence
from pipeline.wrench.study import run_study

CHANCE = "random numbers"
# the estimator of each of the paper's models that returns known parameters
CONSISTENT = {"additive": "shrinkage", "wishart": "likelihood", "gaussian": "likelihood"}
BASE = ""  # decision and level of the base case
Named = tuple[str, str, Choices]  # decision, level, case
LINEAR = ("x", "y", "z")  # rows of a task in m
CLOCKS = ("aligned", "not aligned", "a frame late", "a frame early", "nearest step")


def decision_cases(
    base: Choices, lever: float, task: Sequence[str], joints: Sequence[str], others: int
) -> list[Named]:
    """Return the base case, and after it every case in which one decision changes its options.

    ``lever`` in m is the distance at which the given decomposition, diag(lever, lever, 1) of the
    ``task`` x, z, φ, weighs an error in angle like one in position. ``others`` is the number of
    cases with other random numbers, and of cases with other test takes.
    """
    cases = _decisions(base, lever, task, joints, range(1, others + 1))
    return [(BASE, BASE, base), *(named for named in cases if named[2] != base)]


def _decisions(
    base: Choices, lever: float, task: Sequence[str], joints: Sequence[str], others: Sequence[int]
) -> Iterator[Named]:
    models = {
        kind: replace(model, estimator=CONSISTENT.get(kind, model.estimator))
        for kind, model in base.models.items()
    }
    yield "estimator", "likelihood", replace(base, models=models)
    if (wishart := base.models.get("wishart")) is not None:
        if wishart.estimator == "paper":
            for factor in (0.1, 0.3, 3.0, 10.0):
                changed = base.with_wishart(ratio_factor=factor * wishart.ratio_factor)
                yield "weights", f"× {factor:g}", changed
            for floor in (0.1, 0.3):
                yield "floor", f"{floor:g}", base.with_wishart(floor=floor)
        for name, case in readings(base, task, joints).items():
            yield "decomposition", name, case
        left = np.diag([lever if row in LINEAR else 1.0 for row in task]).tolist()
        yield "decomposition", "given", base.with_wishart(decomposition="given", left=left)
    for mode in ("one_step", "free_running"):
        yield "realisations", mode.replace("_", " "), replace(base, mode=mode)
    for factor in (0.0, 0.5, 2.0):
        yield "noise in scores", f"× {factor:g}", replace(base, measurement=factor)
    for clock in CLOCKS:
        yield "clock", clock, replace(base, clock=clock)
    chosen = base.filter
    for scheme in SCHEMES:
        yield "resampling", scheme, replace(base, filter=replace(chosen, resampling=scheme))
    for threshold in (0.25, 1.0):  # share of the particles; 1 resamples at every step
        changed = replace(base, filter=replace(chosen, threshold=threshold))
        yield "threshold", f"{threshold:g}", changed
    for factor in (0.1, 0.3, 3.0):
        count = max(1, round(factor * chosen.particles))
        yield "particles", f"{count}", replace(base, filter=replace(chosen, particles=count))
    yield from ((CHANCE, f"draws {n}", replace(base, draw=base.draw + n)) for n in others)
    yield from ((CHANCE, f"takes {n}", replace(base, batch=base.batch + n)) for n in others)


def without_camera(case: Choices, base: Choices) -> bool:
    """Return whether ``case`` decides nothing otherwise of camera and filter."""
    return (case.filter, case.clock, case.batch) == (base.filter, base.clock, base.batch)


def cameras(
    angles: pd.DataFrame,
    joints: pd.DataFrame,
    offsets: pd.Series,
    periods: tuple[float, float],
    window: int,
) -> Mapping[str, Camera]:
    """Return the depth camera on each of the CLOCKS, its noise estimated on that clock.

    ``angles`` has times by the estimated ``offsets`` in s of the takes' clocks; ``periods`` in s
    of a frame and of a step. The joint angles stay as they were articulated.
    """
    (frame, step), t = periods, angles["t"]
    times = (t, t - angles["take"].map(offsets), t + frame, t - frame, np.rint(t / step) * step)
    return {
        clock: camera_of(angles.assign(t=time), joints, window=window)
        for clock, time in zip(CLOCKS, times, strict=True)
    }


class Condition(NamedTuple):
    """``levels`` of factors by name, those that are not named as in the base condition."""

    study: str  # motion or wrench
    seed: int
    levels: tuple[tuple[str, float | str], ...] = ()

    def level(self, factor: str) -> float | str:
        """Level of ``factor``; 1 in the base condition."""
        return dict(self.levels).get(factor, 1.0)


class Common(NamedTuple):
    """Laboratory, case, claims, options of the study and of the wrench's, of all conditions."""

    laboratory: Laboratory
    case: Choices
    claims: tuple[Claim, ...]
    options: SimpleNamespace
    wrench: Wrench


def conditions(
    factors: Mapping[str, Sequence], seeds: Sequence[int], study: str, combined: Sequence[str] = ()
) -> Iterator[Condition]:
    """Yield the base condition, each level alone, then combinations of the factors ``combined``."""
    points = [(), *(((name, level),) for name, levels in factors.items() for level in levels)]
    chosen = {name: factors[name] for name in combined}
    for levels in product(*([1.0, *each] for each in chosen.values())):
        point = tuple((name, x) for name, x in zip(chosen, levels, strict=True) if x != 1.0)
        if len(point) > 1:
            points.append(point)
    for point in points:
        yield from (Condition(study, seed, point) for seed in seeds)


def trajectory(own: TrajectoryOptions, way: Mapping[str, object]) -> TrajectoryOptions:
    """Return ``own`` with other ends (rad), another rest (s; the motion between stays) and pace."""
    pace, rest = float(way.get("pace", 1.0)), float(way.get("rest", own.rest))
    ends = {key: tuple(way[key]) for key in ("folded", "extended") if key in way}
    duration = own.duration + 4 * (rest - own.rest)
    timing = {"duration": duration / pace, "rest": rest / pace, "ramp": own.ramp / pace}
    return replace(own, **ends, **timing)


def verdicts(condition: Condition, common: Common) -> pd.DataFrame:
    """Return the rows of :func:`pipeline.cases.readings.claim_verdicts` of one condition."""
    evaluated = motion_evidence if condition.study == "motion" else wrench_evidence
    arm = ArmNames(common.laboratory.joints, common.laboratory.chain.task)
    return claim_verdicts(common.claims, evaluated(condition, common), arm)


def motion_evidence(condition: Condition, common: Common) -> Evidence:
    """Return the evidence of a condition of the motion; none if it comes to a singular pose."""
    own, case, _, options, _ = common
    way = options.trajectories.get(str(condition.level("trajectory")), {})
    laboratory = replace(own, motion=trajectory(own.motion, way))
    levels = {k: float(v) for k, v in condition.levels if k not in ("trajectory", "particles")}
    sizes = (options.training_takes, options.test_takes)
    try:
        takes, camera = observe(laboratory, PhysicsFactors(**levels), condition.seed, *sizes)
    except (SingularJacobianError, RecordingError, ModelDomainError):
        return {}
    sizes = (laboratory.motion.rate, options.test_takes, options.realizations)
    # equal numbers in every condition of a seed, so that a difference is the condition's
    stream = (condition.seed, "robustness")
    recordings = Recordings(takes, {case.clock: camera}, *sizes, stream)
    count = max(1, round(float(condition.level("particles")) * case.filter.particles))
    case = replace(case, filter=replace(case.filter, particles=count))
    ((evidence, _),) = evaluate([case], recordings, map)
    return evidence


def wrench_evidence(condition: Condition, common: Common) -> Evidence:
    """Return the evidence of the numerical study of the wrench with other bounds."""
    scaled = {
        name: [float(condition.level(name)) * value for value in getattr(common.wrench, name)]
        for name in ("kappa", "tension_std")
    }
    stream = rng.stream(condition.seed, "robustness.wrench")
    _, errors, repeats = run_study(replace(common.wrench, **scaled), stream)
    summary, metrics = wrench_summary(errors, repeats), {}
    for m, median in repeats.groupby("agents")["maximum"].median().items():
        row, name = summary.set_index("agents").loc[m], f"study_m{m}_greatest_error"
        metrics |= {f"study_m{m}_mean_error": row["mean"], name: row["max"]}
        metrics[f"{name}_median_over_repeats"] = median
    return {"metrics/wrench": metrics, "tables/wrench_study": summary}
