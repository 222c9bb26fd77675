"""The evidence of one condition of the wrench: the numerical study, the expected Σ_S of the paper's
configurations, and the force of the synthetic robots on the transducer, measured against modelled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline.core import rng
from pipeline.laboratory.force import Cables, record_force
from pipeline.laboratory.options import Robots, Transducer
from pipeline.recordings.tare import remove_bias
from pipeline.studies.survey.conditions import WrenchCondition
from pipeline.verdicts.claims import Claim
from pipeline.verdicts.reference import Evidence
from pipeline.wrench.bounds import Bounds
from pipeline.wrench.expectation import expected_sigma_s
from pipeline.wrench.measured_force import (
    force_moments,
    force_test,
    modelled_wrenches,
    rows_of,
)
from pipeline.wrench.parametric import CableSystem
from pipeline.wrench.study import estimate_sigma_s, run_study, sigma_s_rows


@dataclass(frozen=True)
class Configuration:
    """A configuration of the experiment: the bounds of its class of systems, and what the model is
    given of the robots.
    """

    bounds: Bounds
    tension: list[float]  # N, mean of each cable
    direction: list[float]  # rad, likewise
    tension_sd: list[float]  # N


@dataclass(frozen=True)
class ForceRig:
    """The robots, the transducer that they pull at, and how long for."""

    robots: Robots
    transducer: Transducer
    tare: float  # s, without load
    duration: float  # s, under load


@dataclass(frozen=True)
class WrenchStudy:
    """What every condition of the wrench is decided with, before any factor."""

    bounds: Bounds  # of the numerical study
    configurations: dict[str, Configuration]
    rig: ForceRig
    systems: int
    test_systems: int
    repeats: int


def scaled(bounds: Bounds, condition: WrenchCondition) -> Bounds:
    """``bounds`` with those of concentration and of the tensions' standard deviation times the
    condition's factors.
    """
    concentration = tuple(condition.kappa * value for value in bounds.concentration)
    return replace(
        bounds,
        concentration=concentration,
        tension_sd=tuple(condition.tension_std * value for value in bounds.tension_sd),
    )


def wrench_evidence(condition: WrenchCondition, study: WrenchStudy) -> Evidence:
    """The condition's numbers by the names that claims refer to them by."""
    stream = rng.stream(condition.seed, "wrench.study")
    _, errors, spread = run_study(
        scaled(study.bounds, condition),
        condition.agents,
        study.systems,
        study.test_systems,
        study.repeats,
        stream,
    )
    by_system, by_repeat = errors.groupby("agents")["error"], spread.groupby("agents")["maximum"]
    metrics = {f"study_m{m}_mean_error": value for m, value in by_system.mean().items()}
    metrics |= {f"study_m{m}_greatest_error": value for m, value in by_system.max().items()}
    metrics |= {
        f"study_m{m}_greatest_error_median_over_repeats": value
        for m, value in by_repeat.median().items()
    }
    table = pd.DataFrame(
        {"max_low": by_repeat.quantile(0.025), "max_high": by_repeat.quantile(0.975)}
    ).reset_index()
    rows, moments, tests = [], [], []
    for number, (name, configuration) in enumerate(study.configurations.items()):
        drawn, within = (
            rng.stream(condition.seed, "wrench.configuration", number),
            scaled(configuration.bounds, condition),
        )
        agents = len(configuration.tension)
        estimates = estimate_sigma_s(within, study.systems, agents, drawn)
        rows += sigma_s_rows(
            name, agents, estimates, expected_sigma_s(within, agents, drawn.spawn(1)[0])
        )
        measured = _measured(
            configuration, study.rig, condition, rng.stream(condition.seed, "record.force", number)
        )
        # as the stage wrench has it: the concentration is given and does not enter the matrix model
        stated = CableSystem.from_angles(
            np.array(configuration.tension),
            np.array(configuration.direction),
            condition.tension_std * np.array(configuration.tension_sd),
            np.full(agents, within.concentration[0]),
        )
        sigma_s = estimates["diagonal"].mean
        moments.append(
            force_moments(
                name,
                {
                    "measured": measured,
                    "modelled": modelled_wrenches(stated, sigma_s, len(measured), drawn),
                },
                rows_of(stated),
            )
        )
        tests.append(
            {"configuration": name, "form": "diagonal"}
            | force_test(measured, stated, sigma_s, drawn)
        )
    return {
        "metrics/wrench": metrics,
        "tables/wrench_study": table,
        "tables/sigma_s": pd.DataFrame(rows),
        "tables/force_moments": pd.concat(moments, ignore_index=True),
        "tables/force_test": pd.DataFrame(tests),
    }


def _measured(
    configuration: Configuration,
    rig: ForceRig,
    condition: WrenchCondition,
    stream: np.random.Generator,
) -> np.ndarray:
    """(N, 2) N the force of the robots, whose own spreads have the condition's factors too, as the
    transducer gives it after the tare.
    """
    robots = replace(
        rig.robots,
        tension_sd=tuple(condition.tension_std * value for value in rig.robots.tension_sd),
        concentration=tuple(condition.kappa * value for value in rig.robots.concentration),
    )
    felt = record_force(
        Cables(configuration.tension, configuration.direction),
        robots,
        rig.transducer,
        rig.tare,
        rig.duration,
        stream,
    )
    return remove_bias(felt.time, felt.force, rig.tare).wrench[:, :2]


def claims_for(claims: Sequence[Claim], agents: Sequence[int]) -> list[Claim]:
    """``claims`` with those about an order over numbers of cables asked of ``agents``, in place of
    the paper's numbers.
    """
    return [
        replace(claim, each={"cables": list(agents)}) if claim.rule == "decreasing" else claim
        for claim in claims
    ]
