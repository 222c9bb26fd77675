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
    """A contest with one opponent, or with a limit, as it stands in the table."""

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
    contests = [one for one in benchmarks if one["extra_info"]["role"] != "part"]
    ordered = sorted(contests, key=lambda benchmark: benchmark["group"])
    for contest, members in groupby(ordered, key=lambda benchmark: benchmark["group"]):
        members = list(members)
        (ours,) = (member for member in members if member["extra_info"]["role"] == "ours")
        if limit := ours["extra_info"].get("limit"):
            times = an_item(ours)
            spread = f"{duration(min(times))} to {duration(max(times))}"
            yield Line(
                contest,
                "limit",
                f"{duration(median(times))} an item ({spread})",
                f"≤ {duration(limit)}",
                [time <= limit for time in times],
            )
        # the fastest opponent first
        others = (member for member in members if member is not ours)
        for other in sorted(others, key=lambda other: median(an_item(other))):
            yield against(contest, ours, other)


def against(contest: str, ours: dict, other: dict) -> Line:
    """The line of ``ours`` against one peer or floor."""
    target, floor = other["extra_info"].get("target"), other["extra_info"]["role"] == "floor"
    here, there = an_item(ours), an_item(other)
    ratios = [a / b if floor else b / a for a, b in zip(here, there, strict=True)]
    times = f"{duration(median(here))} against {duration(median(there))}"
    written = "{:.2f}".format if floor else significant
    ratio = (
        f"{written(median(ratios))} ({written(min(ratios))} to {written(max(ratios))}) times as "
        f"{'long' if floor else 'fast'}, {times}"
    )
    quality, same = "", True
    for kind in ("error", "objective"):
        if not floor and kind in ours["extra_info"] and kind in other["extra_info"]:
            mine, theirs = ours["extra_info"][kind], other["extra_info"][kind]
            quality = f"{kind} {mine:.4g} against {theirs:.4g}"
            # speed at the cost of quality meets nothing
            same = mine <= theirs + SAME_QUALITY * abs(theirs)
    if target is None:
        return Line(contest, name_of(other), ratio, "–", [], quality)
    met = [same and (ratio <= target if floor else ratio >= target) for ratio in ratios]
    return Line(contest, name_of(other), ratio, f"{'≤' if floor else '≥'} {target}", met, quality)


def an_item(benchmark: dict) -> list[float]:
    """Run by run the least time in s for one of the items that a call treats."""
    return [seconds / benchmark["extra_info"]["items"] for seconds in benchmark["least"]]


def name_of(benchmark: dict) -> str:
    """What the test states itself ``against``, else its parameter, else its name in words."""
    stated = benchmark["extra_info"].get("against") or benchmark["param"]
    return stated or benchmark["name"].removeprefix("test_").replace("_", " ")
