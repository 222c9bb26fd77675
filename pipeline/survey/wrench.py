"""The evidence of one condition of the wrench: the numerical study and the expected Σ_S of the paper's configurations.

The robots' forces on the transducer are left out, and with them the claims about measured forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import pandas as pd

from pipeline import rng
from pipeline.audit.claims import Claim
from pipeline.audit.evidence import Evidence
from pipeline.survey.conditions import WrenchCondition
from pipeline.wrench.bounds import Bounds
from pipeline.wrench.expectation import expected_sigma_s
from pipeline.wrench.study import estimate_sigma_s, run_study, sigma_s_rows


@dataclass(frozen=True)
class WrenchStudy:
    """What every condition of the wrench is decided with, before any factor."""

    bounds: Bounds  # of the numerical study
    configurations: dict[str, tuple[Bounds, int]]  # of the experiment: bounds and number of cables by name
    systems: int
    test_systems: int
    repeats: int


def scaled(bounds: Bounds, condition: WrenchCondition) -> Bounds:
    """``bounds`` with those of concentration and of the tensions' standard deviation times the condition's factors."""
    concentration = tuple(condition.kappa * value for value in bounds.concentration)
    return replace(bounds, concentration=concentration, tension_sd=tuple(condition.tension_std * value for value in bounds.tension_sd))


def wrench_evidence(condition: WrenchCondition, study: WrenchStudy) -> Evidence:
    """The condition's numbers by the names that claims refer to them by."""
    stream = rng.stream(condition.seed, "wrench.study")
    _, errors, spread = run_study(
        scaled(study.bounds, condition), condition.agents, study.systems, study.test_systems, study.repeats, stream
    )
    of_systems, of_repeats = errors.groupby("agents")["error"], spread.groupby("agents")["maximum"]
    metrics = {f"study_m{m}_mean_error": value for m, value in of_systems.mean().items()}
    metrics |= {f"study_m{m}_greatest_error": value for m, value in of_systems.max().items()}
    metrics |= {f"study_m{m}_greatest_error_median_over_repeats": value for m, value in of_repeats.median().items()}
    table = pd.DataFrame({"max_low": of_repeats.quantile(0.025), "max_high": of_repeats.quantile(0.975)}).reset_index()
    rows = []
    for number, (name, (bounds, agents)) in enumerate(study.configurations.items()):
        drawn, within = rng.stream(condition.seed, "wrench.configuration", number), scaled(bounds, condition)
        estimates = estimate_sigma_s(within, study.systems, agents, drawn)
        rows += sigma_s_rows(name, agents, estimates, expected_sigma_s(within, agents, drawn.spawn(1)[0]))
    return {"metrics/wrench": metrics, "tables/wrench_study": table, "tables/sigma_s": pd.DataFrame(rows)}


def asked_of(claims: Sequence[Claim], agents: Sequence[int]) -> list[Claim]:
    """``claims`` with those about an order over numbers of cables asked of ``agents``, in place of the paper's numbers."""
    return [replace(claim, each={"cables": list(agents)}) if claim.rule == "decreasing" else claim for claim in claims]
