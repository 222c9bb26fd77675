"""planning: is the motion that a model plans as the least uncertain really that? Plans of every
model on two arms of the laboratory, performed in every physics that the survey has.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import pandas as pd
from omegaconf import MISSING

from pipeline.core import config, contracts, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError, ModelDomainError
from pipeline.planning.problem import InfeasibleError
from pipeline.studies import page
from pipeline.studies.planning.bench import Bench, Rig, bench_of
from pipeline.studies.planning.motions import Terms, fitted, fixed_motions, planned
from pipeline.studies.planning.rows import (
    course_rows,
    order_rows,
    prediction_rows,
    realised,
    spread_rows,
)
from pipeline.studies.planning.words import TITLE, sections
from pipeline.studies.survey.conditions import BASE, Factors, disturbed, physics
from pipeline.studies.survey.options import read_survey

HERE, OUT = Path(__file__).parent, page.DATA / "planning"
SURVEY = HERE.parent / "survey"
Tables = dict[str, pd.DataFrame]


@dataclass
class Options:
    """``arms``: option of ``pipeline/conf/dataset`` → rows of the task that is planned, its own
    where none are named.
    """

    arms: dict[str, list[str]] = field(default_factory=dict)
    models: list[str] = MISSING  # options of pipeline/conf/model
    survey: str = MISSING  # whose physics
    takes: int = MISSING  # of a motion, and as many of training
    pace: float = MISSING  # at which the datasets' motions are performed
    margin: float = MISSING  # see pipeline.studies.planning.motions.Terms
    smoothness: float = MISSING  # likewise
    conditioned: float = MISSING  # likewise

    @property
    def terms(self) -> Terms:
        """On which motions are planned."""
        return Terms(self.margin, self.smoothness, self.conditioned)

    def __post_init__(self) -> None:
        if not self.takes > 1:
            raise ConfigError("a spread needs two takes at least", key="takes")
        if not self.pace > 0:
            raise ConfigError("the pace must be positive", key="pace")


def run() -> None:
    """Plan, perform and compare the motions of each arm in each physics, and write the page."""
    settings = config.sections("planning", HERE / "dvc.yaml")
    options = config.study_options(HERE, Options)
    named = physics(read_survey(SURVEY / f"{options.survey}.yaml").factors)
    benches = {
        arm: bench_of(config.CONF / f"dataset/{arm}.yaml", task, options.pace)
        for arm, task in options.arms.items()
    }
    compute = settings.compute
    prepare = partial(fixed_motions, terms=options.terms)
    known = run_trials(prepare, benches.values(), compute=compute, label="planning: arms")
    trial = partial(
        tables_of,
        benches=benches,
        known=dict(zip(benches, known, strict=True)),
        named=named,
        options=options,
        models=config.model_options(options.models),
        seed=settings.seed,
    )
    cases = [(arm, each) for each in named for arm in benches]
    parts = list(run_trials(trial, cases, compute=compute, label="planning: physics"))
    tables = {
        name: pd.concat([part[name] for part in parts if name in part], ignore_index=True)
        for name in parts[0]
    }
    with contracts.replacing(OUT) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder, HERE / "tables.yaml")
    page.draw_figures("planning", {}, compute)
    page.write_page("planning", TITLE, sections(tables, options.takes))


def tables_of(
    case: tuple[str, str],
    benches: dict[str, Bench],
    known: dict[str, dict],
    named: dict[str, Factors],
    options: Options,
    models: dict[str, object],
    seed: int,
) -> Tables:
    """The study's tables of one arm in one physics.

    Args:
        case: names of arm and physics.
        benches: by arm.
        known: motions that no physics changes by name, by arm.
        named: factors on the disturbances by physics.
        options: of the study.
        models: typed options by name.
        seed: of all random numbers.
    """
    arm, each = case
    bench = benches[arm]
    rig = Rig(bench, disturbed(bench.dynamics, named[each]), options.takes, seed)
    laws, refused = fitted(bench, rig.training(), models)
    motions = dict(known[arm])
    for name, law in laws.items():
        try:
            motions[name] = planned(bench, law, options.terms)
        except (InfeasibleError, ModelDomainError) as error:
            refused[name] = error.message
    sums, course = realised(rig, motions, rng.stream(seed, "planning.resampling"))
    predictions = prediction_rows(rig, laws, motions)
    tables = {
        "planning_spreads": spread_rows(sums, motions),
        "planning_predictions": predictions,
        "planning_orders": order_rows(sums, predictions),
        "planning_refused": pd.DataFrame(refused.items(), columns=["model", "reason"]),
    }
    tables = {name: rows.assign(arm=arm, physics=each) for name, rows in tables.items()}
    if each == BASE:
        tables["planning_courses"] = course_rows(rig, laws, motions, course).assign(arm=arm)
    return tables
