"""What the paper leaves open: the case of the run's own options, and the same case with one
decision taken otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pipeline.arm.chain import TASK
from pipeline.cases.case import Case
from pipeline.cases.readings import readings
from pipeline.filtering.resampling import SCHEMES
from pipeline.studies.consistent import consistent
from pipeline.studies.sensitivity.clocks import CLOCKS

LINEAR = ("x", "y", "z")  # rows of a task in m
RATIO_FACTORS = (0.1, 0.3, 3.0, 10.0)  # on α₂/α₁
FLOORS = (0.1, 0.3)  # of B⁻¹
THRESHOLDS = (0.25, 1.0)  # share of the particles; 1 resamples at every step
PARTICLE_FACTORS = (0.1, 0.3, 3.0)
MEASUREMENT_FACTORS = (0.0, 0.5, 2.0)


class Variation(NamedTuple):
    """A case with the name of what is decided otherwise in it, and how; both are empty for the base
    case.
    """

    setting: str
    value: str
    case: Case


def variations(base: Case, lever: float, task: Sequence[str] = TASK) -> list[Variation]:
    """The base case and after it every variation of one decision that makes a difference to its
    options.

    ``lever`` in m is the distance at which the given decomposition, diag(lever, lever, 1) of the
    ``task`` x, z, φ, counts an error in angle like one in position.
    """
    return [
        Variation("", "", base),
        *(variation for variation in _all(base, lever, task) if variation.case != base),
    ]


def _all(base: Case, lever: float, task: Sequence[str]) -> Iterator[Variation]:
    yield Variation(
        "estimator",
        "likelihood",
        replace(base, models={kind: consistent(model) for kind, model in base.models.items()}),
    )
    wishart = base.models.get("wishart")
    if wishart is not None:
        if wishart.estimator == "paper":
            for factor in RATIO_FACTORS:
                yield Variation(
                    "weights",
                    f"× {factor:g}",
                    base.with_wishart(ratio_factor=factor * wishart.ratio_factor),
                )
            for floor in FLOORS:
                yield Variation("floor", f"{floor:g}", base.with_wishart(floor=floor))
        for name, case in readings(base, task).items():
            yield Variation("decomposition", name, case)
        left = np.diag([lever if row in LINEAR else 1.0 for row in task]).tolist()
        yield Variation(
            "decomposition",
            "given",
            base.with_wishart(decomposition="given", left=left),
        )
    for mode in ("one_step", "free_running"):
        yield Variation("realisations", mode.replace("_", " "), replace(base, mode=mode))
    for factor in MEASUREMENT_FACTORS:
        yield Variation("noise in scores", f"× {factor:g}", replace(base, measurement=factor))
    for clock in CLOCKS:
        yield Variation("clock", clock, replace(base, clock=clock))
    for scheme in SCHEMES:
        yield Variation(
            "resampling", scheme, replace(base, filter=replace(base.filter, resampling=scheme))
        )
    for threshold in THRESHOLDS:
        yield Variation(
            "threshold",
            f"{threshold:g}",
            replace(base, filter=replace(base.filter, threshold=threshold)),
        )
    for factor in PARTICLE_FACTORS:
        count = max(1, round(factor * base.filter.particles))
        yield Variation(
            "particles", f"{count}", replace(base, filter=replace(base.filter, particles=count))
        )
    yield Variation("chance", "other draws", replace(base, draw=base.draw + 1))
    yield Variation("chance", "other takes", replace(base, batch=base.batch + 1))
