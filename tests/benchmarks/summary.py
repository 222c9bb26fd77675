"""Writes reports/benchmarks.md from the files in reports/benchmarks: ``python
tests/benchmarks/summary.py``.
"""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
from contests import duration, lines, name_of, table, verdict
from equal_bytes import CONTROL
from repeats import CALLS, SECONDS

REPORTS = Path(__file__).parents[2] / "reports"
STARTS = {  # what, and its limit in s
    "imports_seconds": ("imports of models and filter, numba included", 1.0),
    "cached_seconds": ("first filters of three arms, machine code from the cache", 0.2),
    "compiled_seconds": ("first filters of three arms, everything compiled", 15.0),
}


def read(folder: Path, name: str) -> dict | None:
    """A file of measurements; None where it has not been measured."""
    file = folder / f"{name}.json"
    return json.loads(file.read_text()) if file.exists() else None


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
        f"{table(header, list(lines(benchmarks)))}\n\n"
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
    speeds = [
        [name, *(f"{ns:.0f}" for kind, ns in each.items() if kind != "plain loop")]
        for name, each in measured["nanoseconds"].items()
    ]
    header = ["draws of a step, ns a particle", "kernel", "with the C library's functions"]
    return f"{table(['processor time', '', 'limit', ''], rows)}\n\n{table(header, speeds)}"


def growth(folder: Path) -> str:
    """Slopes of cost over size."""
    rows = [
        [
            row.over,
            f"{row._2} to {row.to}",
            f"{row.time_slope:.2f}"
            + ("" if pd.isna(row.time_limit) else f" (≤ {row.time_limit:g}: "
               f"{verdict(row.time_slope <= row.time_limit)})"),
            "–" if pd.isna(row.memory_slope) else f"{row.memory_slope:z.2f}",
        ]
        for row in pd.read_csv(folder / "growth.csv").itertuples()
    ]  # fmt: skip
    return (
        "Slopes of the logarithm of processor time and of peak memory over that of the size, by "
        "least squares over the larger half of the sizes; – where memory hardly grows.\n\n"
        + table(["over", "sizes", "slope of time", "slope of memory"], rows)
    )


def scale(folder: Path) -> str:
    """Runs at scale."""
    if (measured := read(folder, "scale")) is None:
        return "Not measured: `make bench-scale`."
    some, takes, lost = (measured[name] for name in ("particles", "takes", "cluster"))
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
    names = [name for name in measured["hashes"] if name != CONTROL.name]
    reference, *others = names
    rows = []
    for piece, value in measured["hashes"][reference].items():
        equal = [measured["hashes"][name].get(piece) == value for name in others]
        control = measured["hashes"][CONTROL.name][piece] == value
        words = ["equal" if same else "**other**" for same in equal]
        rows.append([piece, *words, "equal" if control else "other"])
    skipped = "; ".join(measured["skipped"]) or "none"
    return (
        f"Compared with `{reference}` on {measured['machine']}; the control has another arithmetic "
        f"({CONTROL.environment}), by which some bytes have to differ. Settings whose instructions "
        f"this processor lacks: {skipped}.\n\n{table(['piece', *others, 'control'], rows)}"
    )


SECTIONS = {
    "Contests": contests,
    "First use and the kernel": start,
    "Growth of cost": growth,
    "At scale": scale,
    "Equal bytes": equal_bytes,
}


def report(folder: Path) -> str:
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
    (REPORTS / "benchmarks.md").write_text(report(REPORTS / "benchmarks"))
    print(f"bench: {REPORTS / 'benchmarks.md'}")
