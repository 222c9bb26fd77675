"""robustness: verdicts under other decisions, physics of the laboratory and random numbers."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.core import contracts
from pipeline.core.compute.trials import run_trials
from pipeline.evidence import outcomes
from pipeline.evidence.case import Choices, Recordings, Takes, recorded_takes
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
TRACK, ARTICULATE = Path("data/track"), Path("data/articulate")
BOTH = "differs"  # verdicts of the seeds
PARTS = ("decisions", "laboratory")
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
    if settings.dataset.laboratory is None or not contracts.exists(
        "kinect_noise", ARTICULATE
    ):
        print(
            "robustness: no laboratory with a depth camera; its physics is not varied"
        )
    else:
        parts += laboratory_verdicts(*common)
    rows = pd.concat(cases.drop_duplicates("claim") for cases in parts)
    # the rule holds where it holds for the speed law too
    rows = rows.assign(
        cases=1,
        holds=rows["verdict"].isin([HOLDS, SPEED_LAW]),
        fails=rows["verdict"] == FAILS,
    )
    keys = ["grid", "factor", "level", "claim", "about"]
    counts = ["cases", "holds", "fails"]
    counted = rows.groupby(keys, sort=False)[counts].sum().reset_index()
    decided = counted.groupby(["grid", "claim"])[["holds", "fails"]]
    evident = decided.transform("sum").any(axis=1)
    return {"robustness": counted[evident].reset_index(drop=True)}


def decision_verdicts(
    settings: SimpleNamespace,
    options: SimpleNamespace,
    claims: tuple[Claim, ...],
    takes: Takes,
) -> Iterator[pd.DataFrame]:
    """Yield the verdicts of the recordings under every decision that the paper leaves open."""
    dataset, base = settings.dataset, Choices.of_run(settings)
    chain, joints = takes.training.chain, takes.training.joints
    arm = ArmNames(tuple(joints), tuple(chain.task))
    cases = grid.decision_cases(base, chain.task, joints, options.others)
    seen = {}
    if contracts.exists("angles", ARTICULATE):
        quality = contracts.read("quality", TRACK)
        offsets = quality[quality["quantity"] == "clock_offset"].set_index("take")[
            "value"
        ]
        angles, q = (
            contracts.read("angles", ARTICULATE),
            contracts.read("joints", TRACK),
        )
        periods = (1 / dataset.depth.rate, 1 / dataset.motion.rate)
        seen = grid.cameras(
            angles, q, offsets, periods, settings.articulation.noise_window
        )
    else:
        print(
            "robustness: no depth camera; decisions on camera and filter are not varied"
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
            grid=condition.study, factor=condition.factor, level=condition.level
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
    words = []
    for row in robustness.itertuples():
        words.append(verdict_of_cases(row.cases, row.holds, row.fails))
    decisions = robustness["grid"] == "decisions"
    rows = robustness.assign(verdict=words)
    rows = rows.assign(part=rows["grid"].where(decisions, "laboratory"))
    first = rows.loc[rows["factor"] == grid.BASE, ["grid", "claim", "verdict"]]
    rows = rows.merge(
        first, on=["grid", "claim"], how="left", suffixes=("", "_of_base")
    )
    rows = rows.rename(columns={"verdict_of_base": "base"})
    base = rows["factor"] == grid.BASE
    rows["changed"] = (rows["verdict"] != rows["base"]).where(
        ~base, rows["verdict"] == BOTH
    )
    lucky = rows[base & (rows["part"] == "laboratory")].assign(factor=grid.CHANCE)
    keys = ["part", "grid", "claim", "about", "base", "factor"]
    varied = pd.concat([rows[~base], lucky])
    return varied.groupby(keys, sort=False)["changed"].any().reset_index()


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page."""
    changed = changes(tables["robustness"])
    claims = changed["claim"]
    part = changed["part"].where(changed["factor"] != grid.CHANCE, grid.CHANCE)
    flipped = {
        name: changed[changed["changed"] & (part == name)]
        for name in (*PARTS, grid.CHANCE)
    }
    counts = {name: len(rows["claim"].unique()) for name, rows in flipped.items()}
    most = (
        flipped["decisions"]
        .groupby("factor")["claim"]
        .nunique()
        .sort_values(ascending=False)
    )
    lucky, unsteady = (
        set(flipped[grid.CHANCE]["claim"]),
        set(claims[changed["changed"]]),
    )
    steady, cells = [claim for claim in claims.unique() if claim not in unsteady], []
    for claim, rows in changed[claims.isin(unsteady)].groupby("claim", sort=False):
        varied = (rows.loc[part[rows.index] == name, "changed"] for name in PARTS)
        of = [
            f"{some.sum()} of {len(some)}" if len(some) else MISSING for some in varied
        ]
        cells.append(
            [claim + " †" * (claim in lucky), ", ".join(rows["base"].unique()), *of]
        )
    return {
        "claims": claims.nunique(),
        "steady": len(steady),
        "decisions": counts["decisions"],
        "physical": counts["laboratory"],
        "lucky": counts[grid.CHANCE],
        "most": most.head(1),
        "seeds": len(options.seeds),
        "cells": cells,
        "names": ", ".join(steady) or "none",
    }


def draw(robustness: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    bases = {
        HOLDS: {"marker": "o", "color": style.BLUE},
        FAILS: {"marker": "X", "color": style.BLACK},
        BOTH: {"marker": "D", "color": style.GREY},
        UNKNOWN: {"marker": "_", "color": style.GREY},
    }
    square = {"marker": "s", "ls": "none", "ms": 4.2, "mew": 0.5}
    fills = {
        "same verdict": {"mfc": "none", "mec": style.LIGHT_GREY},
        "another verdict": {"mfc": style.BLUE, "mec": style.BLUE},
        "changed by chance": {"mfc": style.VERMILLION, "mec": style.VERMILLION},
    }
    squares = {name: square | fill for name, fill in fills.items()}
    same, other, luck = squares.values()
    changed = changes(robustness)
    parts = dict(list(changed.groupby("part", sort=False)))
    claims = changed.drop_duplicates("claim").set_index("claim")["about"]
    columns = {
        part: ["base case", *rows["factor"].unique()] for part, rows in parts.items()
    }
    size = {
        "columns": len(parts),
        "sharey": True,
        "width_ratios": [*map(len, columns.values())],
    }
    figure, (panels,) = style.panels(
        style.TWO_COLUMNS, 1.9 + 0.135 * len(claims), **size
    )
    place = {claim: y for y, claim in enumerate(claims.index)}
    for axes, (part, names) in zip(panels, columns.items(), strict=True):
        for row in parts[part].drop_duplicates("claim").itertuples():
            axes.plot([0], [place[row.claim]], ls="none", ms=4.2, **bases[row.base])
        for row in parts[part].itertuples():
            look = (
                (luck if row.factor == grid.CHANCE else other) if row.changed else same
            )
            axes.plot([names.index(row.factor)], [place[row.claim]], **look)
        labels = [NAMES.get(name, name.replace("_", " ")) for name in names]
        axes.set_xticks(range(len(names)), labels, rotation=90)
        axes.set(
            xlim=(-0.7, len(names) - 0.3), ylim=(len(claims) - 0.4, -0.6), title=part
        )
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
    labels = [
        name.replace("-", " ") + " *" * (about != "method")
        for name, about in claims.items()
    ]
    panels[0].set_yticks(range(len(claims)), labels, fontsize=7)
    looks = {name: {"ls": "none"} | look for name, look in (bases | squares).items()}
    entries = [Line2D([], [], label=name, **look) for name, look in looks.items()]
    figure.legend(
        handles=entries, loc="outside lower center", ncols=7, columnspacing=1.0
    )
    return figure
