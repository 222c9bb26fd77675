"""Writes reports/benchmarks.md from what the benchmarks left in reports/benchmarks: ``python
tests/benchmarks/summary.py``.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pandas as pd
from contests import an_item, duration, lines, table

REPORTS = Path(__file__).parents[2] / "reports"


def parts(benchmarks: list[dict]) -> str:
    """What the filter's time for a particle and step is made of, arm by arm."""
    header = ["numbers", "arithmetic", "weights and moments", "resampling", "sum", "filter"]
    rows, seconds = [], {}
    for one in benchmarks:
        if one["extra_info"]["role"] == "part":
            seconds.setdefault(one["extra_info"]["arm"], {})[one["extra_info"]["part"]] = an_item(
                one
            )
    for arm, part in seconds.items():
        part["arithmetic"] = part["moves"] - part["numbers"]
        part["sum"] = sum(part[name] for name in header[:4])
        times = [duration(part[name]) for name in (*header, "circular functions")]
        rows.append([arm, *times, f"{part['filter'] / part['numbers']:.1f}"])
    columns = [*header, "sines, cosines and roots alone", "filter over numbers"]
    return (
        "Of a particle and step, each part done alone; the numbers are those that the law draws, "
        f"block by block:\n\n{table(['arm', *columns], rows)}"
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
            f"{row.time_slope:.2f}" + limited(row.time_slope, row.time_limit),
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


def limited(slope: float, limit: float) -> str:
    """Whether a slope is within its limit, where it has one."""
    if pd.isna(limit):
        return ""
    return f" (≤ {limit:g}: {'met' if slope <= limit else '**missed**'})"


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

## Where the filter's time goes

{parts(contests["benchmarks"])}

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
