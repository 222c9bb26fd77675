"""Who is how much faster an item than whom: the lines of the report's table of contests."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from statistics import median

from writing import duration, significant

# a quality that differs by less is the same one
SAME_QUALITY = 0.01


@dataclass(frozen=True)
class Line:
    """A contest with one peer, a line of the table."""

    contest: str
    against: str
    ratio: str
    target: str
    met: list[bool]  # run by run; none where there is no target
    quality: str = ""

    def cells(self) -> list[str]:
        """As the table has them, in the order of its columns."""
        return [
            self.contest,
            self.against,
            self.ratio,
            self.target,
            self.verdict,
            self.quality or "–",
        ]

    @property
    def verdict(self) -> str:
        """Met is what every run meets."""
        if not self.met:
            return "–"
        if all(self.met):
            return "met"
        runs = f"**met in {sum(self.met)} of {len(self.met)} runs**"
        return runs if any(self.met) else "**missed**"


def lines(benchmarks: list[dict]) -> Iterator[Line]:
    """The table's lines of ``benchmarks`` as repeats.py wrote them, contest by contest."""
    ordered = sorted(benchmarks, key=lambda benchmark: benchmark["group"])
    for contest, members in groupby(ordered, key=lambda benchmark: benchmark["group"]):
        members = list(members)
        (ours,) = (member for member in members if member["extra_info"]["role"] == "ours")
        # the fastest opponent first
        others = (member for member in members if member is not ours)
        for other in sorted(others, key=lambda other: median(an_item(other))):
            yield against(contest, ours, other)


def against(contest: str, ours: dict, other: dict) -> Line:
    """The line of ``ours`` against one peer."""
    target, here, there = other["extra_info"].get("target"), an_item(ours), an_item(other)
    ratios = [b / a for a, b in zip(here, there, strict=True)]
    spread = f"{significant(min(ratios))} to {significant(max(ratios))}"
    times = f"{duration(median(here))} against {duration(median(there))}"
    ratio = f"{significant(median(ratios))} ({spread}) times as fast, {times}"
    quality, same = "", True
    for kind in ("error", "objective"):
        if kind in ours["extra_info"] and kind in other["extra_info"]:
            mine, theirs = ours["extra_info"][kind], other["extra_info"][kind]
            quality = f"{kind} {mine:.4g} against {theirs:.4g}"
            # speed at the cost of quality meets nothing
            same = mine <= theirs + SAME_QUALITY * abs(theirs)
    met = [] if target is None else [same and ratio >= target for ratio in ratios]
    return Line(contest, name_of(other), ratio, f"≥ {target}" if target else "–", met, quality)


def an_item(benchmark: dict) -> list[float]:
    """Run by run the least time in s for one of the items that a call treats."""
    return [seconds / benchmark["extra_info"]["items"] for seconds in benchmark["least"]]


def name_of(benchmark: dict) -> str:
    """What the test states itself ``against``, else its parameter, else its name in words."""
    stated = benchmark["extra_info"].get("against") or benchmark["param"]
    return stated or benchmark["name"].removeprefix("test_").replace("_", " ")
