"""What a survey says in short: verdicts by factor and level, what a condition costs, and the base condition against the whole pipeline."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pandas as pd

from pipeline.audit.claims import Claim
from pipeline.audit.evidence import Evidence
from pipeline.audit.sensitivity import FAILS, HOLDS
from pipeline.survey.conditions import FACTORS
from pipeline.survey.points import MOTION, WRENCH, decided

VARIED = {"motion": ("trajectory", "particles", *FACTORS), "wrench": ("agents", "kappa", "tension_std")}
BASE = "base condition"
MANY = 1_000_000  # conditions of a study that one machine outgrows
HOUR = 3600.0  # s


def _base(rows: pd.DataFrame, factors: Sequence[str]) -> pd.Series:
    """Which rows are of the base condition: every factor as in the first row, those that are numbers 1."""
    base = {factor: 1.0 if rows[factor].dtype == float else rows[factor].iloc[0] for factor in factors}
    return (rows[list(factors)] == pd.Series(base)).all(axis=1)


def _levels(rows: pd.DataFrame, factors: Sequence[str], design: str) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Factor, level and rows of the conditions that have it, the base condition first; its levels again only where all are combined."""
    at_base = _base(rows, factors)
    yield BASE, "", rows[at_base]
    for factor in factors:
        for level, of_level in rows.groupby(factor, sort=rows[factor].dtype == float):
            others = of_level[~at_base[of_level.index]] if design == "one_at_a_time" else of_level
            known = rows.loc[at_base, factor].eq(level).any()
            if rows[factor].nunique() > 1 and not (design == "one_at_a_time" and known):
                yield factor, f"{level:g}" if isinstance(level, float) else str(level), others


def verdict_counts(table: pd.DataFrame, design: str) -> pd.DataFrame:
    """In how many conditions with a factor at a level a claim holds in all its cases, and in how many it does not.

    Columns study, factor, level, claim, about, conditions, holds, fails; what is missing to ``conditions`` has no evidence.
    """
    rows = []
    for study, of_study in table.drop_duplicates(["point", "claim"]).groupby("study", sort=False):
        for factor, level, of_level in _levels(of_study, VARIED[study], design):
            for (claim, about), verdicts in of_level.groupby(["claim", "about"], sort=False)["verdict"]:
                counts = {"conditions": len(verdicts), "holds": (verdicts == HOLDS).sum(), "fails": (verdicts == FAILS).sum()}
                rows.append({"study": study, "factor": factor, "level": level, "claim": claim, "about": about} | counts)
    return pd.DataFrame(rows)


def cost(table: pd.DataFrame, size: int) -> dict[str, float]:
    """Measured processor time by kind of condition, and what a million of each would take; ``size`` in bytes is that of all points."""
    points = table.drop_duplicates("point")
    found: dict[str, float] = {"conditions": len(points), "cpu_seconds": points["cpu_seconds"].sum()}
    for study, seconds in points.groupby("study", sort=False)["cpu_seconds"]:
        found[f"{study}_conditions"] = len(seconds)
        for name, value in {"mean": seconds.mean(), "least": seconds.min(), "greatest": seconds.max()}.items():
            found[f"{study}_cpu_seconds_per_condition_{name}"] = value
            # conditions × seconds per condition / seconds per hour
            found[f"{study}_core_hours_of_{MANY}_conditions_{name}"] = MANY * value / HOUR
    per_condition = size / len(points)
    return found | {"bytes_per_condition": per_condition, f"gigabytes_of_{MANY}_conditions": MANY * per_condition / 1e9}


def against_the_pipeline(table: pd.DataFrame, claims: Sequence[Claim], evidence: Evidence) -> pd.DataFrame:
    """The base condition's verdicts beside those of a run of the whole pipeline, decided by the same rules from the run's ``evidence``.

    A row for each case: the run's value and word, the survey's with its first seed, and in how many of its seeds the rule holds.
    """
    run = decided(claims, evidence, MOTION + WRENCH)[["claim", "about", "case", "value", "than", "holds"]]
    parts = []
    for study, of_study in table.groupby("study", sort=False):
        base = of_study[_base(of_study, VARIED[study])]
        first = base[base["seed"] == base["seed"].iloc[0]][["claim", "case", "value", "than", "holds"]]
        seeds = base.groupby(["claim", "case"], sort=False).agg(
            seeds=("seed", "size"), holding=("holds", lambda words: (words == HOLDS).sum())
        )
        parts.append(first.merge(seeds.reset_index(), on=["claim", "case"]))
    both = run.merge(pd.concat(parts), on=["claim", "case"], suffixes=("_pipeline", "_survey"))
    return both.assign(agrees=both["holds_pipeline"] == both["holds_survey"])
