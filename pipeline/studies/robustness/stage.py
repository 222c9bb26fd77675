"""robustness: verdicts under other decisions, physics of the laboratory and random numbers."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.core import contracts
from pipeline.core.compute.trials import run_trials
from pipeline.evidence import outcomes
from pipeline.evidence.case import (
    Camera,
    Choices,
    Recordings,
    Takes,
    recorded_takes,
)
from pipeline.figures import style
from pipeline.studies.frame import MISSING, Tables, trials
from pipeline.studies.robustness import grid
from pipeline.studies.simulated import FACTORS, Laboratory, require_factors
from pipeline.verdicts.claims import Claim, read_claims
from pipeline.verdicts.decision import (
    FAILS,
    HOLDS,
    SPEED_LAW,
    UNKNOWN,
    claim_verdicts,
)
from pipeline.verdicts.run import ArmNames

HERE = Path(__file__).parent
TRACK = Path("data/track")
ARTICULATE = Path("data/articulate")
BOTH = "differs"  # verdicts of the seeds
PARTS = ("decisions", "laboratory")
SQUARE = {"marker": "s", "ms": 4.2, "mew": 0.5}
BASES = {  # look of the verdict of the base case
    HOLDS: {"marker": "o", "color": style.BLUE},
    FAILS: {"marker": "X", "color": style.BLACK},
    BOTH: {"marker": "D", "color": style.GREY},
    UNKNOWN: {"marker": "_", "color": style.GREY},
}
SQUARES = {  # look of a factor
    "same verdict": SQUARE | {"mfc": "none", "mec": style.LIGHT_GREY},
    "another verdict": SQUARE | {"mfc": style.BLUE, "mec": style.BLUE},
    "changed by chance": SQUARE | {"mfc": style.VERMILLION, "mec": style.VERMILLION},
}
NAMES = {
    "cause": "cause of the noise",
    "jitter_std": "wrong times of frames",
    "kappa": "concentration of cables",
    "tension_std": "tension std of cables",
}


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the table ``robustness``, verdicts by level; ConfigError for an unknown factor."""
    require_factors(options.factors, (*FACTORS, "particles"))
    takes = recorded_takes(settings.dataset.robot, settings.dataset.motion)
    common = settings, options, read_claims(HERE / "conclusions.yaml"), takes
    parts = list(decision_verdicts(*common))
    has_camera = contracts.exists("kinect_noise", ARTICULATE)
    if settings.dataset.laboratory is not None and has_camera:
        parts += laboratory_verdicts(*common)
    else:
        print(
            "robustness: no laboratory with a depth camera; its physics is not varied",
        )
    by_case = [cases.drop_duplicates("claim") for cases in parts]
    return {"robustness": counted_verdicts(pd.concat(by_case))}


def counted_verdicts(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the number of cases, and of those that hold and fail, by grid, factor, level and
    claim, without claims that no case of a grid decides.
    """
    # the rule holds where it holds for the speed law too
    holds = rows["verdict"].isin([HOLDS, SPEED_LAW])
    fails = rows["verdict"] == FAILS
    rows = rows.assign(cases=1, holds=holds, fails=fails)
    keys = ["grid", "factor", "level", "claim", "about"]
    counts = ["cases", "holds", "fails"]
    counted = rows.groupby(keys, sort=False)[counts].sum().reset_index()
    decided = counted.groupby(["grid", "claim"])[["holds", "fails"]]
    evident = decided.transform("sum").any(axis=1)
    return counted[evident].reset_index(drop=True)


def decision_verdicts(
    settings: SimpleNamespace,
    options: SimpleNamespace,
    claims: tuple[Claim, ...],
    takes: Takes,
) -> Iterator[pd.DataFrame]:
    """Yield the verdicts of the recordings under every decision that the paper leaves open."""
    dataset = settings.dataset
    base = Choices.of_run(settings)
    chain = takes.training.chain
    joints = takes.training.joints
    arm = ArmNames(tuple(joints), tuple(chain.task))
    cases = grid.decision_cases(base, chain.task, joints, options.others)
    seen = cameras_by_clock(settings)
    if not seen:
        print(
            "robustness: no depth camera; decisions on camera and filter are not varied",
        )
        cases = [named for named in cases if grid.without_camera(named[2], base)]
    sizes = (dataset.motion.rate, options.filtered, settings.simulation.realizations)
    recordings = Recordings(takes, seen, *sizes, settings.seed)
    run = partial(run_trials, compute=settings.compute, label="robustness: decisions")
    evidence = outcomes.evaluate([case for _, _, case in cases], recordings, run)
    for (factor, level, _), result in zip(cases, evidence, strict=True):
        for refusal in result.refusals:
            print(f"robustness: {factor} {level}: {refusal}")
        rows = claim_verdicts(claims, result.evidence, arm)
        yield rows.assign(grid="decisions", factor=factor, level=level)


def cameras_by_clock(settings: SimpleNamespace) -> Mapping[str, Camera]:
    """Return the depth camera of the run with the times by each clock, {} without a camera."""
    if not contracts.exists("angles", ARTICULATE):
        return {}
    dataset = settings.dataset
    quality = contracts.read("quality", TRACK)
    is_offset = quality["quantity"] == "clock_offset"
    offsets = quality[is_offset].set_index("take")["value"]
    angles = contracts.read("angles", ARTICULATE)
    joints = contracts.read("joints", TRACK)
    periods = (1 / dataset.depth.rate, 1 / dataset.motion.rate)
    window = settings.articulation.noise_window
    return grid.cameras(angles, joints, offsets, periods, window)


def laboratory_verdicts(
    settings: SimpleNamespace,
    options: SimpleNamespace,
    claims: tuple[Claim, ...],
    takes: Takes,
) -> Iterator[pd.DataFrame]:
    """Yield the verdicts in every condition of the laboratory."""
    noise = contracts.read("kinect_noise", ARTICULATE)
    laboratory = Laboratory.of_run(settings, takes.training, noise)
    common = {"laboratory": laboratory, "claims": claims, "options": options}
    common |= {
        "case": replace(Choices.of_run(settings), closed=True),
        "wrench": settings.wrench,
    }
    varied = {"trajectory": list(options.trajectories)} | options.factors
    conditions = grid.conditions(varied, options.seeds, "motion", options.combined)
    conditions += grid.cause_conditions(options.causes, options.seeds)
    conditions += grid.conditions(options.wrench, options.seeds, "wrench")
    label = "robustness: conditions"
    results = trials(settings, label, grid.verdicts, conditions, **common)
    for condition, rows in zip(conditions, results, strict=True):
        yield rows.assign(
            grid=condition.study,
            factor=condition.factor,
            level=condition.level,
        )


def verdict_of_cases(cases: int, holds: int, fails: int) -> str:
    """Return the verdict that all ``cases`` have, BOTH if they differ: in a case that neither holds
    nor fails the claim has no evidence.
    """
    if holds == cases:
        return HOLDS
    if fails == cases:
        return FAILS
    return UNKNOWN if holds == fails == 0 else BOTH


def changes(robustness: pd.DataFrame) -> pd.DataFrame:
    """Return the ``base`` verdict by part (decisions, laboratory), grid, factor and claim, and True
    if a level changes it.
    """
    verdicts = []
    for row in robustness.itertuples():
        verdicts.append(verdict_of_cases(row.cases, row.holds, row.fails))
    of_decisions = robustness["grid"] == "decisions"
    parts = robustness["grid"].where(of_decisions, "laboratory")
    rows = robustness.assign(verdict=verdicts, part=parts)
    is_base = rows["factor"] == grid.BASE
    base = rows.loc[is_base, ["grid", "claim", "verdict"]]
    base = base.rename(columns={"verdict": "base"})
    rows = rows.merge(base, on=["grid", "claim"], how="left")
    is_base = rows["factor"] == grid.BASE
    # the seeds of the laboratory are cases of one level
    lucky = rows[is_base & (rows["part"] == "laboratory")]
    lucky = lucky.assign(factor=grid.CHANCE, changed=lucky["verdict"] == BOTH)
    varied = rows[~is_base]
    varied = varied.assign(changed=varied["verdict"] != varied["base"])
    keys = ["part", "grid", "claim", "about", "base", "factor"]
    groups = pd.concat([varied, lucky]).groupby(keys, sort=False)
    return groups["changed"].any().reset_index()


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page."""
    rows = changes(tables["robustness"])
    by_chance = rows["factor"] == grid.CHANCE
    rows["cause"] = rows["part"].where(~by_chance, grid.CHANCE)
    changed = rows[rows["changed"]]
    flipped = {}
    for cause in (*PARTS, grid.CHANCE):
        of_cause = changed[changed["cause"] == cause]
        flipped[cause] = of_cause["claim"].unique()
    of_decisions = changed[changed["cause"] == "decisions"].groupby("factor")
    by_decision = of_decisions["claim"].nunique().sort_values(ascending=False)
    claims = rows["claim"].unique()
    unsteady = set(changed["claim"])
    steady = [claim for claim in claims if claim not in unsteady]
    cells = []
    for claim, of_claim in rows.groupby("claim", sort=False):
        if claim in unsteady:
            mark = " †" if claim in flipped[grid.CHANCE] else ""
            bases = ", ".join(of_claim["base"].unique())
            counts = [changed_of(of_claim, cause) for cause in PARTS]
            cells.append([claim + mark, bases, *counts])
    return {
        "claims": len(claims),
        "steady": len(steady),
        "decisions": len(flipped["decisions"]),
        "physical": len(flipped["laboratory"]),
        "lucky": len(flipped[grid.CHANCE]),
        "most": by_decision.head(1),
        "seeds": len(options.seeds),
        "cells": cells,
        "names": ", ".join(steady) or "none",
    }


def changed_of(rows: pd.DataFrame, cause: str) -> str:
    """Return how many of the factors of a ``cause`` change the verdict of the ``rows`` of a claim,
    as "2 of 5".
    """
    changed = rows.loc[rows["cause"] == cause, "changed"]
    return f"{changed.sum()} of {len(changed)}" if len(changed) else MISSING


def draw(robustness: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    rows = changes(robustness)
    parts = dict(list(rows.groupby("part", sort=False)))
    claims = rows.drop_duplicates("claim").set_index("claim")["about"]
    height = 1.9 + 0.135 * len(claims)
    widths = [1 + of_part["factor"].nunique() for of_part in parts.values()]
    figure, (panels,) = style.panels(
        style.TWO_COLUMNS,
        height,
        columns=len(parts),
        sharey=True,
        width_ratios=widths,
    )
    places = {claim: y for y, claim in enumerate(claims.index)}
    for axes, (title, of_part) in zip(panels, parts.items(), strict=True):
        draw_verdicts(axes, of_part, places)
        axes.set_title(title)
    labels = []
    for claim, about in claims.items():
        mark = "" if about == "method" else " *"
        labels.append(claim.replace("-", " ") + mark)
    panels[0].set_yticks(range(len(claims)), labels, fontsize=7)
    entries = []
    for name, look in (BASES | SQUARES).items():
        entries.append(Line2D([], [], label=name, ls="none", **look))
    figure.legend(
        handles=entries,
        loc="outside lower center",
        ncols=7,
        columnspacing=1.0,
    )
    return figure


def draw_verdicts(axes: Axes, rows: pd.DataFrame, places: Mapping[str, int]) -> None:
    """Draw the verdict of the base case and a square for each factor in the line of each claim, at
    the height of ``places``.
    """
    for row in rows.drop_duplicates("claim").itertuples():
        look = BASES[row.base] | {"ls": "none", "ms": 4.2}
        axes.plot([0], [places[row.claim]], **look)
    columns = {factor: x for x, factor in enumerate(rows["factor"].unique(), 1)}
    for row in rows.itertuples():
        word = "same verdict"
        if row.changed:
            by_chance = row.factor == grid.CHANCE
            word = "changed by chance" if by_chance else "another verdict"
        place = [columns[row.factor]], [places[row.claim]]
        axes.plot(*place, ls="none", **SQUARES[word])
    labels = ["base case"]
    for factor in columns:
        labels.append(NAMES.get(factor, factor.replace("_", " ")))
    axes.set_xticks(range(len(labels)), labels, rotation=90)
    axes.set(xlim=(-0.7, len(columns) + 0.7), ylim=(len(places) - 0.4, -0.6))
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
