"""What a survey says in short: verdicts by factor and level, what a condition costs, and the base
condition against the whole pipeline.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import pandas as pd

from pipeline.cases.evidence import Evidence
from pipeline.cases.verdict import FAILS, HOLDS, WORDS, decided
from pipeline.studies.survey.conditions import BASE, FACTORS
from pipeline.studies.survey.points import MOTION, WRENCH, decidable
from pipeline.verdicts.claims import Claim
from pipeline.verdicts.reference import ArmNames

VARIED = {
    "motion": ("trajectory", "particles", *FACTORS),
    "wrench": ("agents", "kappa", "tension_std"),
}
CONDITION = [
    "point",
    "seed",
    "study",
    *dict.fromkeys(name for names in VARIED.values() for name in names),
    "cpu_seconds",
]
MANY = 1_000_000  # conditions of a study that one machine outgrows
HOUR = 3600.0  # s
PART = 10_000  # points whose words are turned into numbers at a time


class Tally:
    """What is kept of a survey's points as they pass: of each its condition and a word for every
    claim, of the base condition all rows.
    """

    def __init__(self) -> None:
        self.base: list[pd.DataFrame] = []
        self.about: dict[str, str] = {}
        self._bases: dict[str, pd.Series] = {}
        self._parts: list[pd.DataFrame] = []
        self._waiting: list[dict[str, object]] = []

    def passing(self, tables: Iterable[pd.DataFrame]) -> Iterator[pd.DataFrame]:
        """``tables``, one of a point each, as they are; each is noted."""
        for table in tables:
            self._note(table)
            yield table

    def _note(self, table: pd.DataFrame) -> None:
        condition = table[CONDITION].iloc[0]
        varied = list(VARIED[condition["study"]])
        # every factor as in the first condition of its study, those that are numbers 1
        base = self._bases.setdefault(
            condition["study"],
            condition[varied].map(lambda level: 1.0 if isinstance(level, float) else level),
        )
        at_base = bool((condition[varied] == base).all())
        if at_base:
            self.base.append(table)
        claims = table.drop_duplicates("claim")
        self.about |= dict(zip(claims["claim"], claims["about"], strict=True))
        self._waiting.append(
            {
                **condition,
                "at_base": at_base,
                **dict(zip(claims["claim"], claims["verdict"], strict=True)),
            }
        )
        if len(self._waiting) == PART:
            self._turn()

    def _turn(self) -> None:
        self._parts.append(
            pd.DataFrame(self._waiting).reindex(columns=[*CONDITION, "at_base", *self.about])
        )
        self._parts[-1] = self._parts[-1].astype(
            dict.fromkeys(self.about, pd.CategoricalDtype(WORDS))
        )
        self._waiting = []

    @property
    def points(self) -> pd.DataFrame:
        """A row for each point: the columns CONDITION, whether it is the base condition, and the
        verdict on every claim of its study.
        """
        if self._waiting:
            self._turn()
        points = pd.concat(self._parts, ignore_index=True)
        return points.astype(dict.fromkeys(self.about, pd.CategoricalDtype(WORDS)))


def _levels(
    points: pd.DataFrame, factors: Sequence[str], design: str
) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Factor, level and points of the conditions that have it, the base condition first; its levels
    again only where all are combined.
    """
    yield BASE, "", points[points["at_base"]]
    for factor in factors:
        for level, having in points.groupby(factor, sort=points[factor].dtype == float):
            others = having[~having["at_base"]] if design == "one_at_a_time" else having
            known = points.loc[points["at_base"], factor].eq(level).any()
            if points[factor].nunique() > 1 and not (design == "one_at_a_time" and known):
                yield factor, f"{level:g}" if isinstance(level, float) else str(level), others


def verdict_counts(tally: Tally, design: str) -> pd.DataFrame:
    """In how many conditions with a factor at a level a claim holds in all its cases, and in how
    many it does not.

    Columns study, factor, level, claim, about, conditions, holds, fails; what is missing to
    ``conditions`` has no evidence.
    """
    rows = []
    for study, points in tally.points.groupby("study", sort=False):
        for factor, level, having in _levels(points, VARIED[study], design):
            for claim, about in tally.about.items():
                verdicts = having[claim].dropna()
                if len(verdicts):
                    counts = {
                        "conditions": len(verdicts),
                        "holds": (verdicts == HOLDS).sum(),
                        "fails": (verdicts == FAILS).sum(),
                    }
                    rows.append(
                        {
                            "study": study,
                            "factor": factor,
                            "level": level,
                            "claim": claim,
                            "about": about,
                        }
                        | counts
                    )
    return pd.DataFrame(rows)


def cost(points: pd.DataFrame, size: int) -> dict[str, float]:
    """Measured processor time by kind of condition, and what a million of each would take; ``size``
    in bytes is that of all ``points``.
    """
    numbers: dict[str, float] = {
        "conditions": len(points),
        "cpu_seconds": points["cpu_seconds"].sum(),
    }
    for study, seconds in points.groupby("study", sort=False)["cpu_seconds"]:
        numbers[f"{study}_conditions"] = len(seconds)
        for name, value in {
            "mean": seconds.mean(),
            "least": seconds.min(),
            "greatest": seconds.max(),
        }.items():
            numbers[f"{study}_cpu_seconds_per_condition_{name}"] = value
            # conditions × seconds per condition / seconds per hour
            numbers[f"{study}_core_hours_of_{MANY}_conditions_{name}"] = MANY * value / HOUR
    per_condition = size / len(points)
    return numbers | {
        "bytes_per_condition": per_condition,
        f"gigabytes_of_{MANY}_conditions": MANY * per_condition / 1e9,
    }


def against_the_pipeline(
    tally: Tally, claims: Sequence[Claim], evidence: Evidence, arm: ArmNames
) -> pd.DataFrame:
    """The base condition's verdicts beside those of a run of the whole pipeline, decided by the
    same rules from the ``evidence`` of the run, of an ``arm``.

    A row for each case: the run's value and word, the survey's with its first seed, and in how many
    of its seeds the rule holds.
    """
    run = decided(decidable(claims, MOTION + WRENCH), evidence, arm)[
        ["claim", "about", "case", "value", "than", "holds"]
    ]
    parts = []
    for _, base in pd.concat(tally.base, ignore_index=True).groupby("study", sort=False):
        first = base[base["seed"] == base["seed"].iloc[0]][
            ["claim", "case", "value", "than", "holds"]
        ]
        seeds = base.groupby(["claim", "case"], sort=False).agg(
            seeds=("seed", "size"), holding=("holds", lambda words: (words == HOLDS).sum())
        )
        parts.append(first.merge(seeds.reset_index(), on=["claim", "case"]))
    both = run.merge(pd.concat(parts), on=["claim", "case"], suffixes=("_pipeline", "_survey"))
    return both.assign(agrees=both["holds_pipeline"] == both["holds_survey"])
