"""The conditions of a survey: what is varied, and the points of its grid.

A condition of the motion is a laboratory with its disturbances and the noise of its instruments
scaled, a trajectory and a number of particles; a condition of the wrench is a range of cable
systems and the numbers of cables compared. Every factor is 1 in the base condition, which has the
first trajectory, the first number of particles and the first numbers of cables.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from itertools import product

import numpy as np

from pipeline.laboratory.options import DynamicsOptions

DESIGNS = ("one_at_a_time", "factorial")
BASE = "base condition"


@dataclass(frozen=True)
class Factors:
    """Factors on the disturbances of :class:`pipeline.laboratory.options.DynamicsOptions` and on
    the standard deviations of the instruments.
    """

    disturbances: float = 1.0  # on the size of all of the next eight together
    sway_std: float = 1.0
    clearance: float = 1.0
    speed_error_std: float = 1.0
    encoder_ripple: float = 1.0
    encoder_offset_std: float = 1.0
    length_std: float = 1.0
    start_std: float = 1.0
    jitter_std: float = 1.0
    speed_exponent: float = 1.0  # 0: sway and rattling are the same at any speed
    lasting: float = 1.0  # on the lags of sway and rattling: how long a deviation lasts
    motion_capture: float = 1.0
    depth_camera: float = 1.0


FACTORS = tuple(each.name for each in fields(Factors))
SIZES = FACTORS[1:9]  # the disturbances that have a size
INSTRUMENTS = FACTORS[11:]  # what is no disturbance of the arm


def disturbed(dynamics: DynamicsOptions, factors: Factors) -> DynamicsOptions:
    """``dynamics`` with each disturbance, and how long it lasts, times its factor."""
    scaled = {
        name: np.multiply(
            getattr(dynamics, name), factors.disturbances * getattr(factors, name)
        ).tolist()
        for name in SIZES
    }
    return replace(
        dynamics,
        **scaled,
        speed_exponent=dynamics.speed_exponent * factors.speed_exponent,
        sway_time=dynamics.sway_time * factors.lasting,
        clearance_time=dynamics.clearance_time * factors.lasting,
    )


@dataclass(frozen=True, slots=True)  # there may be millions
class MotionCondition:
    """A point of the grid on which the claims about motion, depth camera and filter are decided."""

    seed: int
    trajectory: str
    particles: int
    factors: Factors = field(default_factory=Factors)


@dataclass(frozen=True, slots=True)
class WrenchCondition:
    """A point of the grid on which the claims about the wrench model are decided."""

    seed: int
    agents: tuple[int, ...]  # numbers of cables m that the study compares
    kappa: float = 1.0  # factor on the bounds of the directions' concentration
    tension_std: float = 1.0  # factor on the bounds of the tensions' standard deviation


Condition = MotionCondition | WrenchCondition


def designed(
    base: Mapping[str, object], levels: Mapping[str, list], design: str
) -> Iterator[dict[str, object]]:
    """The points over ``levels`` by name: ``base`` and each other level alone (one_at_a_time), or
    every combination (factorial).

    What has no levels is as in ``base``.
    """
    if design == "factorial":
        for values in product(*levels.values()):
            yield {**base, **dict(zip(levels, values, strict=True))}
        return
    yield dict(base)
    for name, values in levels.items():
        for value in values:
            if value != base[name]:
                yield {**base, name: value}


def physics(levels: Mapping[str, list[float]]) -> dict[str, Factors]:
    """The factors of every arm that a survey with ``levels`` knows when it varies one at a time, by
    name, the base condition's first; what it varies of the instruments is left out.
    """
    of_the_arm = {name: each for name, each in levels.items() if name not in INSTRUMENTS}
    points = designed(dict.fromkeys(FACTORS, 1.0), of_the_arm, "one_at_a_time")
    named = {}
    for point in points:
        changed = [f"{name} {value:g}" for name, value in point.items() if value != 1]
        named[" ".join(changed) or BASE] = Factors(**point)
    return named


def motion_conditions(
    seeds: list[int],
    trajectories: list[str],
    particles: list[int],
    factors: Mapping[str, list[float]],
    design: str,
) -> list[MotionCondition]:
    """The conditions of the motion, every one with each of ``seeds``."""
    base = {"trajectory": trajectories[0], "particles": particles[0]} | dict.fromkeys(FACTORS, 1.0)
    points = designed(base, {"trajectory": trajectories, "particles": particles, **factors}, design)
    factors_of = cache(Factors)  # equal ones are one, of which there are fewer by far
    conditions = []
    for point in points:
        scaled = factors_of(*(float(point[name]) for name in FACTORS))
        place = (point["trajectory"], point["particles"], scaled)
        conditions += [MotionCondition(seed, *place) for seed in seeds]
    return conditions


def wrench_conditions(
    seeds: list[int],
    agents: list[list[int]],
    kappa: list[float],
    tension_std: list[float],
    design: str,
) -> list[WrenchCondition]:
    """The conditions of the wrench, every one with each of ``seeds``."""
    base = {"agents": agents[0], "kappa": 1.0, "tension_std": 1.0}
    points = designed(base, {"agents": agents, "kappa": kappa, "tension_std": tension_std}, design)
    return [
        WrenchCondition(
            seed, tuple(point["agents"]), float(point["kappa"]), float(point["tension_std"])
        )
        for point in points
        for seed in seeds
    ]
