"""Writes reports/benchmarks.md from the files in reports/benchmarks: ``python
tests/benchmarks/summary.py``.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from statistics import median

from contests import CALLS, RESULTS, SECONDS

import pandas as pd  # isort: skip
from equal_bytes import CONTROL, OTHER

VECTORISED = 1.3  # least ratio of the kernel's time without vectorised loops to its own
SAME_QUALITY = 0.01  # greatest relative difference of a quality that counts as none
STARTS = {  # what, and its limit in s
    "imports_seconds": ("imports of models and filter, numba included", 1.0),
    "cached_seconds": ("first filters of three arms, machine code from the cache", 0.2),
    "compiled_seconds": ("first filters of three arms, everything compiled", 15.0),
}


def read(folder: Path, name: str) -> dict:
    """A file of measurements."""
    return json.loads((folder / f"{name}.json").read_text())


def table(header: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [header, ["---"] * len(header), *rows])


def verdict(met: bool) -> str:
    """The page's word on a limit."""
    return "met" if met else "**missed**"


def significant(value: float) -> str:
    """Two significant digits, all digits before the point kept."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def duration(seconds: float) -> str:
    """Three significant digits in the unit that suits."""
    units = ((1, "s"), (1e3, "ms"), (1e6, "µs"), (1e9, "ns"))
    scale, unit = next(pair for pair in units if seconds * pair[0] >= 1 or pair[1] == "ns")
    return f"{seconds * scale:.3g} {unit}"


def an_item(benchmark: dict) -> list[float]:
    """Least time in s of each run for one of the items that a call treats."""
    return [seconds / benchmark["extra_info"]["items"] for seconds in benchmark["least"]]


def name_of(benchmark: dict) -> str:
    """Name of an opponent: its test states it as ``against``."""
    return benchmark["extra_info"]["against"]


def contest_rows(benchmarks: list[dict]) -> Iterator[list[str]]:
    """Yield the cells of each row, contest by contest, the fastest opponent first."""
    ordered = sorted(benchmarks, key=lambda benchmark: benchmark["group"])
    for contest, group in groupby(ordered, key=lambda benchmark: benchmark["group"]):
        members = sorted(group, key=lambda benchmark: median(an_item(benchmark)))
        (ours,) = (member for member in members if member["extra_info"]["role"] == "ours")
        yield from ([contest, *against(ours, other)] for other in members if other is not ours)


def against(ours: dict, other: dict) -> list[str]:
    """Cells of the row of ``ours`` against one peer: name, ratio, target, verdict, quality."""
    mine, theirs = ours["extra_info"], other["extra_info"]
    here, there = an_item(ours), an_item(other)
    ratios = [b / a for a, b in zip(here, there, strict=True)]
    middle, *ends = (significant(f(ratios)) for f in (median, min, max))
    ratio = f"{middle} ({' to '.join(ends)}) times as fast, "
    ratio += f"{duration(median(here))} against {duration(median(there))}"
    quality, same = "–", True
    for kind in {"error", "objective"} & mine.keys() & theirs.keys():
        quality = f"{kind} {mine[kind]:.4g} against {theirs[kind]:.4g}"
        # speed at the cost of quality meets nothing
        same = mine[kind] <= theirs[kind] + SAME_QUALITY * abs(theirs[kind])
    met = [same and value >= theirs["target"] for value in ratios]
    some = any(met) and not all(met)
    result = f"**met in {sum(met)} of {len(met)} runs**" if some else verdict(all(met))
    return [name_of(other), ratio, f"≥ {theirs['target']}", result, quality]


def contests(folder: Path) -> str:
    """Ratios to other libraries."""
    measured = read(folder, "contests")
    benchmarks, info = measured["benchmarks"], measured["machine_info"]
    versions = ", ".join(f"{name} {number}" for name, number in info["versions"].items())
    header = ["contest", "against", "ratio (range over the runs), times an item", "target", ""]
    header.append("quality (less is better)")
    peers = [one for one in benchmarks if "configuration" in one["extra_info"]]
    stated = [f"- {name_of(one)}: {one['extra_info']['configuration']}" for one in peers]
    return (
        f"{len(benchmarks[0]['least'])} runs of all contests. A time is the least of at least "
        f"{CALLS} calls and {SECONDS} s; a ratio is one of two times of the same run, with its "
        "median over the runs and its range. Met is what every run meets.\n\n"
        f"{table(header, list(contest_rows(benchmarks)))}\n\n"
        "The configuration of each peer:\n\n" + "\n".join(dict.fromkeys(stated)) + "\n\n"
        f"Versions: {versions}."
    )


def start(folder: Path) -> str:
    """First use, and the speed of a step of every law."""
    measured = read(folder, "start")
    rows = [
        [what, duration(measured[key]), f"≤ {limit:g} s", verdict(measured[key] <= limit)]
        for key, (what, limit) in STARTS.items()
    ]
    speeds = []
    for name, each in measured["nanoseconds"].items():
        ratio = each["scalar"] / each["kernel"]
        met = f"{ratio:.1f} times (≥ {VECTORISED:g}: {verdict(ratio >= VECTORISED)})"
        speeds.append([name, *(f"{ns:.0f}" for ns in each.values()), met])
    header = ["draws of a step, ns a particle", "kernel", "with the C library's functions"]
    header += ["loops that are not vectorised", "vectorised, so many times as fast"]
    return f"{table(['processor time', '', 'limit', ''], rows)}\n\n{table(header, speeds)}"


def growth(folder: Path) -> str:
    """Slopes of cost over size."""
    rows = []
    for _, row in pd.read_csv(folder / "growth.csv").iterrows():
        slope, limit = row["time_slope"], row["time_limit"]
        bound = "" if pd.isna(limit) else f" (≤ {limit:g}: {verdict(slope <= limit)})"
        memory = "–" if pd.isna(row["memory_slope"]) else f"{row['memory_slope']:z.2f}"
        rows.append([row["over"], f"{row['from']} to {row['to']}", f"{slope:.2f}{bound}", memory])
    return (
        "Slopes of the logarithm of processor time and of peak memory over that of the size, by "
        "least squares over the larger half of the sizes; – where memory hardly grows.\n\n"
        + table(["over", "sizes", "slope of time", "slope of memory"], rows)
    )


def scale(folder: Path) -> str:
    """Runs at scale."""
    if not (folder / "scale.json").exists():
        return "Not measured: `make bench-scale`."
    some, takes, lost = (read(folder, "scale")[name] for name in ("particles", "takes", "cluster"))
    few, many = takes["few"], takes["many"]
    return (
        f"**{some['many']:,} particles**: {duration(some['seconds_many'])} a particle and step, "
        f"{duration(some['seconds_few'])} of {some['few']:,}; "
        f"{some['bytes_of_a_particle']:.0f} bytes a particle.\n\n"
        f"**{many['takes']:,} takes** drawn, fitted and filtered in blocks: "
        f"{duration(many['seconds'])} and {many['peak_bytes'] / 1e6:.0f} MB at the peak; "
        f"{few['takes']:,} takes {duration(few['seconds'])} and {few['peak_bytes'] / 1e6:.0f} MB."
        "\n\n"
        f"**A Dask cluster** of {lost['workers']} workers, one killed: {lost['equal_bytes']} of "
        f"{lost['trials']} posteriors have the bytes of a single process."
    )


def equal_bytes(folder: Path) -> str:
    """Bytes of results on other processors and threads."""
    measured = read(folder, "equal_bytes")
    hashes = pd.DataFrame(measured["hashes"])
    reference, *others = hashes.columns.drop(CONTROL)
    same = hashes[[*others, CONTROL]].eq(hashes[reference], axis=0)
    words = same.replace({True: "equal", False: "**other**"})
    words[CONTROL] = same[CONTROL].map({True: "equal", False: "other"})
    rows = [[piece, *cells] for piece, *cells in words.itertuples()]
    skipped = "; ".join(measured["skipped"]) or "none"
    return (
        f"Compared with `{reference}` on {measured['machine']}; the control has another arithmetic "
        f"({OTHER}), by which some bytes have to differ. Settings whose instructions "
        f"this processor lacks: {skipped}.\n\n{table(['piece', *others, CONTROL], rows)}"
    )


SECTIONS = {
    "Contests": contests,
    "First use and the kernel": start,
    "Growth of cost": growth,
    "At scale": scale,
    "Equal bytes": equal_bytes,
}


def page(folder: Path) -> str:
    """Text of reports/benchmarks.md from the files in ``folder``."""
    machine = read(folder, "contests")["machine_info"]["machine"]
    sections = "\n".join(f"\n## {title}\n\n{one(folder)}" for title, one in SECTIONS.items())
    return f"""# Benchmarks

Written by `make bench`, measured side by side on one machine: {machine}. Times differ on another,
ratios less. A peer runs in a process and environment of its own, without the settings that hold our
arithmetic to equal bytes.
{sections}
"""


if __name__ == "__main__":
    file = RESULTS.with_suffix(".md")
    file.write_text(page(RESULTS))
    print(f"bench: {file}")
