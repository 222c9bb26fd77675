"""robustness: the claims where something is decided otherwise: what the paper leaves open, the
laboratory's physics, the random numbers.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated

import pandas as pd
from joblib import Memory
from pydantic import Field

from pipeline.cases.case import Choices, Recordings, paper_models, recorded_takes
from pipeline.cases.evaluate import evaluate
from pipeline.cases.readings import FAILS, HOLDS, decided, read_claims
from pipeline.core import config, contracts
from pipeline.core.compiled import sources_hash
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Count
from pipeline.core.validation import options
from pipeline.filtering.particle_filter import FilterOptions
from pipeline.studies.frame import Study, Tables
from pipeline.studies.robustness.grid import (
    Common,
    Condition,
    cameras,
    conditions,
    decision_cases,
    verdicts,
    without_camera,
)
from pipeline.studies.robustness.page import draw, facts
from pipeline.studies.simulated import FACTORS, Laboratory
from pipeline.verdicts.claims import Claim
from pipeline.wrench.bounds import study_bounds

HERE = Path(__file__).parent
TRACK, ARTICULATE = Path("data/track"), Path("data/articulate")
BESIDE = "scaled_full"  # scored beside the paper's models in the laboratory
Levels = dict[str, list[Annotated[float, Field(ge=0)]]]
Verdicts = tuple[str, str, str, pd.DataFrame]  # grid, factor, level, rows of decided()


@options()
class Options:
    """Grid of cases; params.yaml describes each."""

    combined: list[str]
    filtered: Count
    others: Count
    seeds: Annotated[list[int], Field(min_length=1)]
    training_takes: Annotated[int, Field(ge=4)]
    test_takes: Annotated[int, Field(ge=4)]
    realizations: Annotated[int, Field(ge=2)]
    trajectories: dict[str, dict]
    factors: Levels
    wrench: Levels


def evaluate_grid(settings: SimpleNamespace, options: Options) -> Tables:
    """Return the table ``robustness``: verdicts by level; ConfigError for an unknown factor."""
    known = [*FACTORS, "particles"]
    if unknown := sorted(set(options.factors) - set(known)):
        message = f"no factor {', '.join(unknown)}; there are {', '.join(known)}"
        raise ConfigError(message, key="factors", file=HERE / "params.yaml")
    claims = read_claims(HERE / "conclusions.yaml")
    parts = list(decision_verdicts(settings, options, claims))
    if settings.dataset.laboratory is None or not contracts.exists("kinect_noise", ARTICULATE):
        print("robustness: no laboratory with a depth camera; its physics is not varied")
    else:
        parts += laboratory_verdicts(settings, options, claims)
    return {"robustness": counts(parts)}


def decision_verdicts(
    settings: SimpleNamespace, options: Options, claims: tuple[Claim, ...]
) -> Iterator[Verdicts]:
    """Yield the verdicts of the recordings under every decision that the paper leaves open."""
    dataset, f = settings.dataset, settings.filter
    takes = recorded_takes(dataset.robot, dataset.motion)
    chain, joints = takes.training.chain, takes.training.joints
    chosen = FilterOptions(f.particles, f.scheme, f.threshold)
    base = Choices(paper_models(settings.models), chosen, settings.simulation.mode)
    lever = float(chain.lengths.mean()) if hasattr(chain, "lengths") else 1.0
    cases = decision_cases(base, lever, chain.task, joints, options.others)
    seen = {}
    if contracts.exists("angles", ARTICULATE):
        quality = contracts.read("quality", TRACK)
        offsets = quality[quality["quantity"] == "clock_offset"].set_index("take")["value"]
        angles, q = contracts.read("angles", ARTICULATE), contracts.read("joints", TRACK)
        periods = (1 / dataset.depth.rate, 1 / dataset.motion.rate)
        seen = cameras(angles, q, offsets, periods, settings.articulation.noise_window)
    else:
        print("robustness: no depth camera; no decision on camera and filter is varied")
        cases = [named for named in cases if without_camera(named[2], base)]
    sizes = (dataset.motion.rate, options.filtered, settings.simulation.realizations)
    recordings = Recordings(takes, seen, *sizes, (settings.seed, "robustness"))
    run = partial(run_trials, compute=settings.compute, label="robustness: decisions")
    evidence = evaluate([case for _, _, case in cases], recordings, run)
    for (factor, level, _), (of_case, refusals) in zip(cases, evidence, strict=True):
        for refusal in refusals:
            print(f"robustness: {factor} {level}: {refusal}")
        yield "decisions", factor, level, decided(claims, of_case, takes.arm)


def laboratory_verdicts(
    settings: SimpleNamespace, options: Options, claims: tuple[Claim, ...]
) -> Iterator[Verdicts]:
    """Yield the verdicts in every condition of the laboratory.

    A run after one that was killed evaluates the remaining conditions only.
    """
    grid, common = laboratory_grid(settings, options, claims)
    folder = Path(".dvc/tmp/robustness", sources_hash()).absolute()
    trial = partial(Memory(folder, verbose=0).cache(verdicts), common=common)
    label = "robustness: conditions"
    results = run_trials(trial, grid, compute=settings.compute, label=label)
    for condition, rows in zip(grid, results, strict=True):
        factor = ", ".join(name for name, _ in condition.levels)
        level = ", ".join(f"{x:g}" if isinstance(x, float) else x for _, x in condition.levels)
        yield condition.study, factor, level, rows
    shutil.rmtree(folder.parent, ignore_errors=True)


def laboratory_grid(
    settings: SimpleNamespace, options: Options, claims: tuple[Claim, ...]
) -> tuple[list[Condition], Common]:
    """Return every condition of the laboratory, and what they have in common."""
    recorded = recorded_takes(settings.dataset.robot, settings.dataset.motion).training
    noise, f = contracts.read("kinect_noise", ARTICULATE), settings.filter
    study, chosen = settings.wrench, FilterOptions(f.particles, f.scheme, f.threshold)
    models = paper_models(settings.models) | config.model_options([BESIDE])
    common = Common(
        laboratory=Laboratory.of_run(settings, recorded, noise),
        ways=options.trajectories,
        case=Choices(models, chosen, settings.simulation.mode, closed=True),
        takes=(options.training_takes, options.test_takes),
        realizations=options.realizations,
        bounds=study_bounds(study),
        agents=study.agents,
        systems=(study.systems, study.test_systems, study.repeats),
        claims=claims,
    )
    varied = {"trajectory": list(options.trajectories)} | options.factors
    grid = [
        *conditions(varied, options.seeds, "motion", options.combined),
        *conditions(options.wrench, options.seeds, "wrench"),
    ]
    return grid, common


def counts(parts: Iterable[Verdicts]) -> pd.DataFrame:
    """Return the table ``robustness``, of claims with evidence in any case of a grid."""
    rows = pd.concat(
        cases.drop_duplicates("claim").assign(grid=grid, factor=factor, level=level)
        for grid, factor, level, cases in parts
    )
    rows = rows.assign(holds=rows["verdict"] == HOLDS, fails=rows["verdict"] == FAILS)
    keys = ["grid", "factor", "level", "claim", "about"]
    counted = rows.groupby(keys, sort=False)[["holds", "fails"]].sum().reset_index()
    known = counted[["holds", "fails"]].sum(axis=1).groupby([counted["grid"], counted["claim"]])
    return counted[known.transform("sum") > 0].reset_index(drop=True)


run = Study(Options, evaluate_grid, facts, draw).run
