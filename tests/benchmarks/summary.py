"""Writes reports/benchmarks.md from what the benchmarks left in reports/benchmarks: ``python
tests/benchmarks/summary.py``.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import pandas as pd

REPORTS = Path(__file__).parents[2] / "reports"
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
    ordered = sorted(benchmarks, key=lambda benchmark: benchmark["group"])
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
    """The parameter of a test that has one, else its name in words."""
    return benchmark["param"] or benchmark["name"].removeprefix("test_").replace("_", " ")


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


def compilation(folder: Path) -> str:
    """What the first use of compiled functions costs."""
    measured = json.loads((folder / "compilation.json").read_text())
    verdict = "met" if measured["seconds"] < measured["limit"] else "**missed**"
    rows = [
        [stage, f"{seconds:.1f} s"] for stage, seconds in measured["stages"].items() if seconds > 0
    ]
    return (
        "With nothing compiled before, all stages, each a process of its own, compile for "
        f"{measured['seconds']:.1f} s of processor time "
        f"(< {measured['limit']} s: {verdict}), by the medians of {measured['rounds']} "
        f"rounds:\n\n{table(['stage', 'compiling'], rows)}"
    )


def growth(folder: Path) -> str:
    """The slopes of cost over size, and the figure."""
    slopes = pd.read_csv(folder / "cost_growth.csv").drop_duplicates("over")
    rows = [
        [
            row.over,
            f"{row.time_slope:.2f}",
            "–" if pd.isna(row.memory_slope) else f"{row.memory_slope:z.2f}",
        ]
        for row in slopes.itertuples()
    ]
    return (
        "Slopes of the logarithm of processor time and of peak memory beyond what was there "
        "before, over the logarithm of the size, "
        "by least squares over the larger half of the sizes; – where memory stays below what can "
        "be told.\n\n"
        f"{table(['over', 'slope of time', 'slope of memory'], rows)}\n\n![Time and memory over "
        "size](benchmarks/cost_growth.png)"
    )


def experiment(folder: Path) -> str:
    """Processor time of the stages against that of the work itself, and their memory."""
    file = folder / "experiment.json"
    if not file.exists():
        return "Not measured yet: `make bench-experiment`."
    measured = json.loads(file.read_text())
    stages, work = measured["stages"], measured["work"]
    rooms: Counter[str] = Counter()
    for of_stage in work.values():
        rooms.update(of_stage)
    total, alone = sum(stage["cpu"] for stage in stages), sum(rooms.values())
    ratio, peak = total / alone, max(stage["memory"] for stage in stages)
    rows = [
        [
            stage["stage"],
            f"{stage['elapsed']:.1f} s",
            f"{stage['cpu']:.1f} s",
            f"{sum(work[stage['stage']].values()):.1f} s",
            f"{stage['memory'] / 1e9:.2f} GB",
        ]
        for stage in stages
    ]
    parts = ", ".join(f"{room} {seconds:.1f} s" for room, seconds in rooms.items())
    verdict = "met" if ratio <= measured["ratio_limit"] else "**missed**"
    spare = "met" if peak < measured["memory_limit"] else "**missed**"
    return (
        f"Scale `{measured['scale']}`, {measured['machine']}. The stages take {ratio:.2f} times "
        "the processor time of the work itself "
        f"(≤ {measured['ratio_limit']}: {verdict}), {total:.0f} s against {alone:.0f} s "
        f"({parts}), and {measured['elapsed']:.0f} s by the "
        f"clock. The largest process has {peak / 1e9:.2f} GB (< {measured['memory_limit'] / 1e9} "
        f"GB: {spare}). The work is what passes "
        "in the rooms of `pipeline` when the stages call them, in one process in which "
        "everything is imported and compiled.\n\n"
        f"{table(['stage', 'by the clock', 'processor time', 'of it work', 'peak memory'], rows)}"
    )


def report(folder: Path) -> str:
    """The text of reports/benchmarks.md from the files in ``folder``."""
    contests = json.loads((folder / "contests.json").read_text())
    info = contests["machine_info"]
    libraries = ", ".join(f"{name} {number}" for name, number in info["versions"].items())
    header = [
        "contest",
        "against",
        "ratio (median times an item)",
        "target",
        "",
        "quality (less is better)",
    ]
    return f"""# Benchmarks

Written by `make bench`, measured side by side in one run on one machine: {info["machine"]}. On
another the times differ, the ratios less. A peer runs in its own process and environment, free of
the settings that hold our own arithmetic to equal bits.

## Contests

{table(header, [line.cells() for line in lines(contests["benchmarks"])])}

Versions: {libraries}.

## First use

{compilation(folder)}

## How cost grows

{growth(folder)}

## The whole experiment

{experiment(folder)}
"""


if __name__ == "__main__":
    (REPORTS / "benchmarks.md").write_text(report(REPORTS / "benchmarks"))
    print(f"bench: {REPORTS / 'benchmarks.md'}")
