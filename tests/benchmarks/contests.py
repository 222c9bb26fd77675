"""Who is how much faster an item than whom: the lines of the report's table of contests."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

# a quality that differs by less is the same one
SAME_QUALITY = 0.01


@dataclass(frozen=True)
class Line:
    """A contest with one opponent, or with a limit, as it stands in the table."""

    contest: str
    against: str
    ratio: str
    target: str
    met: bool | None  # None where there is no target
    quality: str = ""

    def cells(self) -> list[str]:
        """As the table has them, in the order of its columns."""
        verdict = {True: "met", False: "**missed**", None: "–"}[self.met]
        return [self.contest, self.against, self.ratio, self.target, verdict, self.quality or "–"]


def lines(benchmarks: list[dict]) -> Iterator[Line]:
    """The table's lines of ``benchmarks`` as pytest-benchmark wrote them, contest by contest."""
    contests = [one for one in benchmarks if one["extra_info"]["role"] != "part"]
    ordered = sorted(contests, key=lambda benchmark: benchmark["group"])
    for contest, members in groupby(ordered, key=lambda benchmark: benchmark["group"]):
        members = list(members)
        (ours,) = (member for member in members if member["extra_info"]["role"] == "ours")
        if limit := ours["extra_info"].get("limit"):
            yield Line(
                contest,
                "limit",
                f"{duration(an_item(ours))} an item",
                f"≤ {duration(limit)}",
                an_item(ours) <= limit,
            )
        # the fastest opponent first
        for other in sorted((member for member in members if member is not ours), key=an_item):
            yield against(contest, ours, other)


def against(contest: str, ours: dict, other: dict) -> Line:
    """The line of ``ours`` against one peer or floor."""
    target = other["extra_info"].get("target")
    times = f"({duration(an_item(ours))} against {duration(an_item(other))})"
    if other["extra_info"]["role"] == "floor":
        ratio = an_item(ours) / an_item(other)
        met = None if target is None else ratio <= target
        return Line(
            contest,
            name_of(other),
            f"{ratio:.2f} times as long {times}",
            f"≤ {target}" if target else "–",
            met,
        )
    ratio = an_item(other) / an_item(ours)
    met = None if target is None else ratio >= target
    quality = ""
    for kind in ("error", "objective"):
        if kind in ours["extra_info"] and kind in other["extra_info"]:
            here, there = ours["extra_info"][kind], other["extra_info"][kind]
            quality = f"{kind} {here:.4g} against {there:.4g}"
            # speed at the cost of quality meets nothing
            met = met and here <= there + SAME_QUALITY * abs(there)
    return Line(
        contest,
        name_of(other),
        f"{significant(ratio)} times as fast {times}",
        f"≥ {target}" if target else "–",
        met,
        quality,
    )


def an_item(benchmark: dict) -> float:
    """Median time in s for one of the items that a call treats."""
    return benchmark["stats"]["median"] / benchmark["extra_info"]["items"]


def name_of(benchmark: dict) -> str:
    """What the test states itself ``against``, else its parameter, else its name in words."""
    stated = benchmark["extra_info"].get("against") or benchmark["param"]
    return stated or benchmark["name"].removeprefix("test_").replace("_", " ")


def significant(value: float) -> str:
    """Two significant digits, all digits before the point kept."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def duration(seconds: float) -> str:
    """Three significant digits in the unit that suits."""
    scale, unit = next(
        pair
        for pair in ((1, "s"), (1e3, "ms"), (1e6, "µs"), (1e9, "ns"))
        if seconds * pair[0] >= 1 or pair[1] == "ns"
    )
    return f"{seconds * scale:.3g} {unit}"


def table(header: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(
        "| " + " | ".join(cells) + " |" for cells in [header, ["---"] * len(header), *rows]
    )
