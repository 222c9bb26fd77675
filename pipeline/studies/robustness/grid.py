"""Cases of the grid: decisions that the paper leaves open, and conditions of the laboratory."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core import rng
from pipeline.core.errors import ModelDomainError, RecordingError, SingularJacobianError
from pipeline.core.options.analysis import Wrench
from pipeline.evidence.case import Camera, Choices, Recordings, camera_of, readings
from pipeline.evidence.instruments import wrench_evidence as evidence_of
from pipeline.evidence.outcomes import evaluate
from pipeline.evidence.table import evidence_table
from pipeline.filtering.sampling import SCHEMES
from pipeline.laboratory.options import TrajectoryOptions
from pipeline.studies.simulated import Laboratory, dynamics_of_cause, observe
from pipeline.verdicts.claims import Claim
from pipeline.verdicts.decision import claim_verdicts
from pipeline.verdicts.run import ArmNames
from pipeline.wrench.study import run_study

CHANCE = "random numbers"
# consistent estimator of each of the paper's models
CONSISTENT = {
    "additive": "shrinkage",
    "wishart": "likelihood",
    "gaussian": "likelihood",
}
BASE = ""  # decision and level of the base case
NamedCase = tuple[str, str, Choices]  # decision, level, case
CLOCKS = ("aligned", "not aligned", "a frame late", "a frame early", "nearest step")


def decision_cases(
    base: Choices,
    task: Sequence[str],
    joints: Sequence[str],
    others: int,
) -> list[NamedCase]:
    """Return the base case, then every case in which one decision changes the options; ``others``
    is the number of cases with other random numbers, and the number with other test takes.
    """
    consistent = {}
    for kind, model in base.models.items():
        estimator = CONSISTENT.get(kind, model.estimator)
        consistent[kind] = replace(model, estimator=estimator)
    cases = [("estimator", "likelihood", replace(base, models=consistent))]
    for reading, case in readings(base, task, joints).items():
        cases.append(("decomposition", reading, case))
    for decision, levels in changed_options(base, others).items():
        for level, options in levels.items():
            cases.append((decision, level, replace(base, **options)))
    different = [named for named in cases if named[2] != base]
    return [(BASE, BASE, base), *different]


def changed_options(base: Choices, others: int) -> dict[str, dict[str, dict]]:
    """Return the options that differ from ``base`` by decision and level; ``others`` is as in
    :func:`decision_cases`.
    """

    def filtered(name: str, value: object) -> dict:
        return {"filter": replace(base.filter, **{name: value})}

    scaled = [round(factor * base.filter.particles) for factor in (0.1, 0.3, 3.0)]
    counts = [max(1, count) for count in scaled]
    numbers = range(1, others + 1)
    draws = {f"draws {n}": {"draw": base.draw + n} for n in numbers}
    takes = {f"takes {n}": {"batch": base.batch + n} for n in numbers}
    return {
        "realisations": {
            "one step": {"mode": "one_step"},
            "free running": {"mode": "free_running"},
        },
        "noise in scores": {f"× {x:g}": {"measurement": x} for x in (0.0, 0.5, 2.0)},
        "clock": {clock: {"clock": clock} for clock in CLOCKS},
        "resampling": {scheme: filtered("scheme", scheme) for scheme in SCHEMES},
        # share of the particles; 1 resamples at every step
        "threshold": {f"{x:g}": filtered("threshold", x) for x in (0.25, 1.0)},
        "particles": {f"{count}": filtered("particles", count) for count in counts},
        CHANCE: draws | takes,
    }


def without_camera(case: Choices, base: Choices) -> bool:
    """Return True if ``case`` has the options of ``base`` for camera and filter."""
    return (case.filter, case.clock, case.batch) == (
        base.filter,
        base.clock,
        base.batch,
    )


def cameras(
    angles: pd.DataFrame,
    joints: pd.DataFrame,
    offsets: pd.Series,
    periods: tuple[float, float],
    window: int,
) -> Mapping[str, Camera]:
    """Return the depth camera with times and noise for each of the CLOCKS.

    Times of ``angles`` are corrected by the estimated ``offsets`` in s of the takes' clocks;
    ``periods`` in s are the periods of a frame and of a step.
    """
    frame, step = periods
    t = angles["t"]
    corrected = t - angles["take"].map(offsets)
    nearest_step = np.rint(t / step) * step
    times = (t, corrected, t + frame, t - frame, nearest_step)
    seen = {}
    for clock, time in zip(CLOCKS, times, strict=True):
        timed = angles.assign(t=time)
        seen[clock] = camera_of(timed, joints, window=window)
    return seen


class Condition(NamedTuple):
    """Levels of factors by name; other factors have the level of the base condition."""

    study: str  # motion or wrench
    seed: int
    levels: tuple[tuple[str, float | str], ...] = ()
    cause: str = ""  # of the noise; empty: the run's
    size: float = 1.0  # factor on the disturbances that the cause sets

    @property
    def factor(self) -> str:
        """Name of what is changed; empty in the base condition."""
        return "cause" if self.cause else ", ".join(name for name, _ in self.levels)

    @property
    def level(self) -> str:
        """Changed values as text."""
        if self.cause:
            return f"{self.cause} × {self.size:g}"
        texts = []
        for _, value in self.levels:
            texts.append(f"{value:g}" if isinstance(value, float) else value)
        return ", ".join(texts)


def conditions(
    factors: Mapping[str, Sequence],
    seeds: Sequence[int],
    study: str,
    combined: Sequence[str] = (),
) -> list[Condition]:
    """Return the base condition, each level alone and all combinations of ``combined``, by seed."""
    points: list[tuple] = [()]
    for name, levels in factors.items():
        points += [((name, level),) for level in levels]
    with_base = [[1.0, *factors[name]] for name in combined]
    for levels in product(*with_base):
        pairs = zip(combined, levels, strict=True)
        changed = tuple(pair for pair in pairs if pair[1] != 1.0)
        if len(changed) > 1:
            points.append(changed)
    return [Condition(study, seed, point) for point in points for seed in seeds]


def cause_conditions(
    causes: Mapping[str, Sequence[float]],
    seeds: Sequence[int],
) -> list[Condition]:
    """Return the conditions of the motion under each of the ``causes`` at each of its sizes."""
    result = []
    for cause, sizes in causes.items():
        for size in sizes:
            result += [Condition("motion", s, cause=cause, size=size) for s in seeds]
    return result


def verdicts(
    condition: Condition,
    laboratory: Laboratory,
    case: Choices,
    claims: Sequence[Claim],
    options: SimpleNamespace,
    wrench: Wrench,
) -> pd.DataFrame:
    """Return the rows of :func:`pipeline.verdicts.decision.claim_verdicts` for one condition."""
    if condition.study == "motion":
        evidence = motion_evidence(condition, laboratory, case, options)
    else:
        evidence = wrench_evidence(condition, wrench)
    return claim_verdicts(
        claims,
        evidence,
        ArmNames(laboratory.joints, laboratory.chain.task),
    )


def motion_evidence(
    condition: Condition,
    laboratory: Laboratory,
    case: Choices,
    options: SimpleNamespace,
) -> pd.DataFrame:
    """Return the evidence of a condition of the motion; none if the motion has a singular pose."""
    levels = dict(condition.levels)
    way = options.trajectories.get(levels.pop("trajectory", None), {})
    particles = levels.pop("particles", 1.0) * case.filter.particles
    laboratory = laboratory_under(condition, laboratory, way)
    sizes = (options.training_takes, options.test_takes)
    try:
        takes, camera = observe(laboratory, levels, condition.seed, *sizes)
    except (SingularJacobianError, RecordingError, ModelDomainError):
        return evidence_table([])
    sizes = (laboratory.motion.rate, options.test_takes, options.realizations)
    # a seed has equal random numbers in every condition, so that only the condition differs
    recordings = Recordings(takes, {case.clock: camera}, *sizes, condition.seed)
    filtered = replace(case.filter, particles=max(1, round(particles)))
    case = replace(case, filter=filtered)
    (result,) = evaluate([case], recordings, map)
    return result.evidence


def laboratory_under(
    condition: Condition,
    laboratory: Laboratory,
    way: Mapping[str, object],
) -> Laboratory:
    """Return the ``laboratory`` with the motion changed by ``way`` and the cause of the noise."""
    laboratory = replace(laboratory, motion=changed_motion(laboratory.motion, way))
    if not condition.cause:
        return laboratory
    dynamics = dynamics_of_cause(condition.cause, condition.size)
    return replace(laboratory, dynamics=dynamics)


def changed_motion(
    motion: TrajectoryOptions,
    way: Mapping[str, object],
) -> TrajectoryOptions:
    """Return ``motion`` with the end poses in rad, the rest in s and the pace of ``way``. Another
    rest leaves the duration between the rests as it is.
    """
    pace = way.get("pace", 1.0)
    rest = way.get("rest", motion.rest)
    ends = {key: tuple(way[key]) for key in ("folded", "extended") if key in way}
    return replace(
        motion,
        **ends,
        duration=(motion.duration + 4 * (rest - motion.rest)) / pace,
        rest=rest / pace,
        ramp=motion.ramp / pace,
    )


def wrench_evidence(condition: Condition, study: Wrench) -> pd.DataFrame:
    """Return the evidence of the numerical ``study`` of the wrench with other bounds."""
    factors = dict(condition.levels)
    scaled = {}
    for name in ("kappa", "tension_std"):
        factor = factors.get(name, 1.0)
        scaled[name] = [factor * value for value in getattr(study, name)]
    stream = rng.stream(condition.seed, "wrench.study")
    _, errors, repeats = run_study(replace(study, **scaled), stream)
    return evidence_of({"wrench_errors": errors, "wrench_spread": repeats})
