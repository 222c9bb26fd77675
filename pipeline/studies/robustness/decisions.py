"""Decisions that the paper leaves open: the case of the run's own options, and the same case with
one decision taken otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from pipeline.cases.case import Camera, Choices, camera_of
from pipeline.cases.readings import readings
from pipeline.filtering.resampling import SCHEMES

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
    cases, numbers = [*_decisions(base, lever, task, joints)], range(1, others + 1)
    cases += [(CHANCE, f"draws {n}", replace(base, draw=base.draw + n)) for n in numbers]
    cases += [(CHANCE, f"takes {n}", replace(base, batch=base.batch + n)) for n in numbers]
    return [(BASE, BASE, base), *(named for named in cases if named[2] != base)]


def _decisions(
    base: Choices, lever: float, task: Sequence[str], joints: Sequence[str]
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
    are those of a frame and of a step. The joint angles stay as they were articulated.
    """
    (frame, step), t = periods, angles["t"]
    times = (t, t - angles["take"].map(offsets), t + frame, t - frame, np.rint(t / step) * step)
    return {
        clock: camera_of(angles.assign(t=time), joints, window=window)
        for clock, time in zip(CLOCKS, times, strict=True)
    }
