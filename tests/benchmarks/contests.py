"""Table of the report's contests, durations and verdicts in words, and the machine."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from statistics import median

SAME_QUALITY = 0.01  # greatest relative difference of a quality that counts as none


def lines(benchmarks: list[dict]) -> Iterator[list[str]]:
    """Yield the cells of the table's lines of ``benchmarks`` as repeats.py wrote them, contest by
    contest, the fastest opponent first.
    """
    ordered = sorted(benchmarks, key=lambda benchmark: benchmark["group"])
    for contest, members in groupby(ordered, key=lambda benchmark: benchmark["group"]):
        members = list(members)
        (ours,) = (member for member in members if member["extra_info"]["role"] == "ours")
        others = [member for member in members if member is not ours]
        for other in sorted(others, key=lambda other: median(an_item(other))):
            yield [contest, *against(ours, other)]


def against(ours: dict, other: dict) -> list[str]:
    """Cells of the line of ``ours`` against one peer: name, ratio, target, verdict, quality."""
    mine, theirs = ours["extra_info"], other["extra_info"]
    target, here, there = theirs.get("target"), an_item(ours), an_item(other)
    ratios = [b / a for a, b in zip(here, there, strict=True)]
    spread = f"{significant(min(ratios))} to {significant(max(ratios))}"
    times = f"{duration(median(here))} against {duration(median(there))}"
    ratio = f"{significant(median(ratios))} ({spread}) times as fast, {times}"
    quality, same = "–", True
    for kind in ("error", "objective"):
        if kind in mine and kind in theirs:
            quality = f"{kind} {mine[kind]:.4g} against {theirs[kind]:.4g}"
            # speed at the cost of quality meets nothing
            same = mine[kind] <= theirs[kind] + SAME_QUALITY * abs(theirs[kind])
    if target is None:
        return [name_of(other), ratio, "–", "–", quality]
    met = [same and value >= target for value in ratios]
    result = verdict(all(met))
    if any(met) and not all(met):
        result = f"**met in {sum(met)} of {len(met)} runs**"
    return [name_of(other), ratio, f"≥ {target}", result, quality]


def an_item(benchmark: dict) -> list[float]:
    """Least time in s of each run for one of the items that a call treats."""
    return [seconds / benchmark["extra_info"]["items"] for seconds in benchmark["least"]]


def name_of(benchmark: dict) -> str:
    """Name that the test states as ``against``, else its parameter, else its name in words."""
    stated = benchmark["extra_info"].get("against") or benchmark["param"]
    return stated or benchmark["name"].removeprefix("test_").replace("_", " ")


def table(header: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [header, ["---"] * len(header), *rows])


def verdict(met: bool) -> str:
    """The report's word on a limit."""
    return "met" if met else "**missed**"


def significant(value: float) -> str:
    """Two significant digits, all digits before the point kept."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def duration(seconds: float) -> str:
    """Three significant digits in the unit that suits."""
    units = ((1, "s"), (1e3, "ms"), (1e6, "µs"), (1e9, "ns"))
    scale, unit = next(pair for pair in units if seconds * pair[0] >= 1 or pair[1] == "ns")
    return f"{seconds * scale:.3g} {unit}"


def machine() -> str:
    """Processor, cores that may be used, memory and system."""
    processor = re.search(r"model name\s*: (.+)", Path("/proc/cpuinfo").read_text())[1]
    cores = len(os.sched_getaffinity(0))
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30
    return f"{processor}, {cores} cores, {memory:.0f} GiB of memory, {platform.system()}"
