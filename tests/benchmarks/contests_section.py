"""The report's table of contests, and in what configuration each peer was measured."""

from __future__ import annotations

import json
from pathlib import Path

from contests import lines, name_of
from repeats import CALLS, SECONDS
from writing import table

TITLE = "Contests"
HEADER = [
    "contest",
    "against",
    "ratio (range over the runs), times an item",
    "target",
    "",
    "quality (less is better)",
]


def section(folder: Path) -> str:
    """Of contests.json, as repeats.py wrote it."""
    measured = json.loads((folder / "contests.json").read_text())
    benchmarks, info = measured["benchmarks"], measured["machine_info"]
    libraries = ", ".join(f"{name} {number}" for name, number in info["versions"].items())
    return (
        f"{len(benchmarks[0]['least'])} runs, each of all contests. A time is the least of the "
        "run's calls, as what else the machine does only adds to it; either side is called for "
        f"{SECONDS} s and at least {CALLS} times, twice where a call takes seconds. A ratio is one "
        "of two times of the same run; it stands with its median over the runs and its range. Met "
        f"is what every run meets.\n\n{table(HEADER, [line.cells() for line in lines(benchmarks)])}"
        "\n\n"
        f"{stated(benchmarks, 'floor', 'What a floor is')}\n\n"
        f"{stated(benchmarks, 'peer', 'The best configuration of each peer')}\n\n"
        f"Versions: {libraries}."
    )


def stated(benchmarks: list[dict], role: str, title: str) -> str:
    """What those of a ``role`` say of themselves, no line twice."""
    said = [
        f"- {name_of(one)}: {one['extra_info']['configuration']}"
        for one in benchmarks
        if one["extra_info"]["role"] == role and "configuration" in one["extra_info"]
    ]
    return "\n".join([f"{title}:\n", *dict.fromkeys(said)])
